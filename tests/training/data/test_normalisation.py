"""Constants of data that come in portions, and their way through JSON."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from proxops.training.data.normalisation import Moments


@given(
    st.lists(st.integers(0, 30), min_size=1, max_size=8),
    st.floats(-1e6, 1e6),
    st.floats(1e-2, 1e3),
    st.integers(0, 2**32),
)
def test_portions_join(sizes: list[int], mean: float, spread: float, seed: int) -> None:
    random = np.random.default_rng(seed)
    portions = [mean + spread * random.standard_normal((size, 2)) for size in sizes]
    moments = Moments(2)
    for portion in portions:
        moments.add(portion)
    rows = np.concatenate(portions)
    if len(rows) < 2:
        return
    scale = moments.scale()
    np.testing.assert_allclose(scale.mean, rows.mean(axis=0), rtol=1e-12, atol=1e-9 * spread)
    np.testing.assert_allclose(scale.std, rows.std(axis=0), rtol=1e-6)


@pytest.mark.parametrize("value", [0.0, 0.1, -7.3e5])
def test_what_never_varies_can_be_divided_by(value: float) -> None:
    moments = Moments(1)
    for count in (3, 1, 5):
        moments.add(np.full((count, 1), value))
    assert moments.scale().std == (1.0,)
    np.testing.assert_allclose(moments.scale().mean, [value], rtol=1e-12, atol=1e-9)
