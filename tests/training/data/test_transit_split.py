"""60, 20 and 20 % of the transits, decided once and for all for each."""

from collections import Counter

from hypothesis import given
from hypothesis import strategies as st

from proxops.training.data.packed_flights import part_of_transit

SEEDS = st.integers(0, 2**40)


@given(SEEDS, st.integers(0, 40), st.integers(1, 40))
def test_shares_are_exact_over_whole_blocks(seed: int, block: int, blocks: int) -> None:
    transits = range(5 * block, 5 * (block + blocks))
    counts = Counter(part_of_transit(seed, transit) for transit in transits)
    assert counts == {"training": 3 * blocks, "validation": blocks, "test": blocks}


def test_no_sort_of_transit_is_favoured() -> None:
    """Transits repeat a pattern every ten: each place in it meets each part as often."""
    for place in range(10):
        parts = Counter(part_of_transit(0, transit) for transit in range(place, 6000, 10))
        assert abs(parts["training"] - 360) < 60  # 5 standard deviations
        assert abs(parts["test"] - 120) < 49


def test_known_split() -> None:
    """A split that changed would let tested transits into the training of a shipped policy."""
    letters = {"training": "t", "validation": "v", "test": "e"}
    split = "".join(letters[part_of_transit(0, transit)] for transit in range(20))
    assert split == "tetvttevtttetvtetttv"
