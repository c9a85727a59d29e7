"""When the hybrid checks next: the fixed period, and how the adaptive one depends on agreement."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from proxops.systems import CheckSchedule, PeriodRule
from proxops.systems.hybrid.agreement_gates import Agreement

ADAPTIVE = CheckSchedule(PeriodRule.ADAPTIVE)
differences = st.floats(0.0, 12.0)


def agreed(difference: float) -> Agreement:
    return Agreement(True, difference, 0.0)


@pytest.mark.parametrize(
    ("difference", "following"), [(0.0, 100), (0.5, 77), (1.0, 10), (3.0, 10), (0.25, 94)]
)
def test_the_closer_the_longer(difference: float, following: int) -> None:
    assert ADAPTIVE.next_period(100, agreed(difference), 1.0, 1000) == following
    # It is the difference over the limit that counts.
    assert ADAPTIVE.next_period(100, agreed(2.0 * difference), 2.0, 1000) == following


def test_bounds() -> None:
    assert ADAPTIVE.next_period(100, agreed(0.0), 1.0, 31) == 31
    assert ADAPTIVE.next_period(100, agreed(1.0), 1.0, 4) == 4
    assert ADAPTIVE.next_period(100, agreed(0.0), 1.0, 0) == 1
    assert ADAPTIVE.next_period(100, Agreement(False, 0.0, 1.0), 1.0, 1000) == 10
    assert ADAPTIVE.next_period(100, Agreement(False, 2.0, 1.0), 1.0, 2) == 2
    short = CheckSchedule(PeriodRule.ADAPTIVE, check_period=10, longest=6)
    assert short.next_period(100, agreed(1.0), 1.0, 1000) == 6


@given(differences, st.booleans(), st.integers(0, 200))
def test_never_beyond_what_is_in_hand(difference: float, agrees: bool, steps: int) -> None:
    period = ADAPTIVE.next_period(100, Agreement(agrees, difference, 0.0), 1.0, steps)
    assert 1 <= period <= max(1, min(steps, 100))


@given(differences, differences, st.integers(0, 200), st.integers(0, 200))
def test_better_is_longer(one: float, other: float, near: int, far: int) -> None:
    (one, other), (near, far) = sorted((one, other)), sorted((near, far))
    best = ADAPTIVE.next_period(100, agreed(one), 1.0, far)
    assert best >= ADAPTIVE.next_period(100, agreed(other), 1.0, far)
    assert best >= ADAPTIVE.next_period(100, agreed(one), 1.0, near)
    assert best >= ADAPTIVE.next_period(100, Agreement(False, one, 0.0), 1.0, far)


@pytest.mark.parametrize(("last", "following"), [(0, 20), (3, 20), (10, 20), (25, 50), (60, 100)])
def test_trust_is_earned(last: int, following: int) -> None:
    assert ADAPTIVE.next_period(last, agreed(0.0), 1.0, 1000) == following
    assert ADAPTIVE.next_period(last, agreed(1.0), 1.0, 1000) == 10
