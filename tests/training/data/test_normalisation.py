"""Constants of data that come in portions, and their way through JSON."""

import dataclasses
import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from proxops.training.data.normalisation import Moments, Normalisation, Scale

EXAMPLE = Normalisation(
    position=Scale((1e3, -2e3, 0.1), (9e4, 8e4, 7e4)),
    velocity=Scale((0.1, 0.2, 0.3), (5.0, 6.0, 1.0 / 3.0)),
    force=Scale((0.0, 0.0, -0.1), (1.5, 1.25, 1.0)),
    range=Scale((1.2e5,), (3e4,)),
)


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


def test_no_digits_are_lost_far_from_zero() -> None:
    rows = 1e8 + np.array([[-1.0], [0.0], [1.0]])
    moments = Moments(1)
    for row in rows:
        moments.add(row[None])
    assert moments.scale().std[0] == pytest.approx(np.sqrt(2.0 / 3.0), rel=1e-12)


@pytest.mark.parametrize("value", [0.0, 0.1, -7.3e5])
def test_what_never_varies_can_be_divided_by(value: float) -> None:
    moments = Moments(1)
    for count in (3, 1, 5):
        moments.add(np.full((count, 1), value))
    assert moments.scale().std == (1.0,)
    np.testing.assert_allclose(moments.scale().mean, [value], rtol=1e-12, atol=1e-9)


def test_through_json() -> None:
    text = json.dumps(dataclasses.asdict(EXAMPLE), allow_nan=False)
    assert Normalisation.of(json.loads(text)) == EXAMPLE
