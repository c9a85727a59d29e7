"""Errors in the state that is known: their size, and that they are a function of seed and step."""

import numpy as np
from one_system import evaluated

from proxops.systems import StateNoise

STATE = np.array([1e5, -2e4, 3e4, 1.0, -2.0, 3.0])


def errors(noise: StateNoise, steps: int, seed: int | None = None) -> np.ndarray:
    times = 10.0 * np.arange(steps)
    return np.array([evaluated(noise, "state", time, seed, state=STATE) for time in times]) - STATE


def test_deviations() -> None:
    drawn = errors(StateNoise(300.0, 0.2), 4000)
    np.testing.assert_allclose(drawn.std(axis=0), 3 * [300.0] + 3 * [0.2], rtol=0.05)
    np.testing.assert_allclose(drawn.mean(axis=0) / drawn.std(axis=0), 0.0, atol=0.06)
    apart = np.corrcoef(np.hstack([drawn[1:], drawn[:-1]]).T) - np.eye(12)
    assert np.abs(apart).max() < 0.07


def test_function_of_seed_and_step() -> None:
    noise = StateNoise(300.0, 0.2, seed=3)
    one = errors(noise, 20)
    np.testing.assert_array_equal(one, errors(StateNoise(300.0, 0.2), 20, seed=3))
    assert (one != errors(noise, 20, seed=4)).all()
    for time in (70.0, 69.99999999999999, 74.0, 79.9):  # All within step 7.
        found = evaluated(noise, "state", time, state=STATE)
        np.testing.assert_array_equal(found - STATE, one[7])
