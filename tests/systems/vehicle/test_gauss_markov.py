"""Gauss-Markov processes: against a digital filter, and as functions of seed and time alone."""

import numpy as np
import pytest
from one_system import evaluated
from scipy.signal import lfilter

from proxops.systems import UnexplainedAcceleration
from proxops.systems.common import generator
from proxops.systems.vehicle.gauss_markov import _sequence, gauss_markov_at

SLOW = {"std": 2.0, "correlation_time": 100.0, "period": 10.0}


def at_steps(steps: int, seed: int = 0, **settings: float) -> np.ndarray:
    """Values (steps, 3) at the control steps."""
    all_settings = {**SLOW, **settings}
    times = all_settings["period"] * np.arange(steps)
    return np.array([gauss_markov_at(time, seed=seed, **all_settings) for time in times.tolist()])


@pytest.mark.parametrize("tau", [0.0, 100.0])
def test_at_steps_it_is_a_stationary_sequence(tau: float) -> None:
    """Of independent normal draws, by a digital filter: with its deviation from step 0 on."""
    kept = np.exp(-10.0 / tau) if tau else 0.0
    drawn = generator(6, 0).standard_normal((1500, 3))
    drawn[1:] *= np.sqrt(1.0 - kept**2)
    wanted = lfilter([2.0], [1.0, -kept], drawn, axis=0)
    np.testing.assert_allclose(at_steps(1500, 6, correlation_time=tau), wanted, atol=1e-11)


def test_linear_between_steps() -> None:
    values = at_steps(3, seed=5)
    for part in (0.25, 0.5, 0.9):
        between = gauss_markov_at(10.0 * (1.0 + part), seed=5, **SLOW)
        assert between == pytest.approx((1.0 - part) * values[1] + part * values[2], rel=1e-12)
    # Just before and after a step: no jump.
    close = [gauss_markov_at(time, seed=5, **SLOW) for time in (20.0 - 1e-9, 20.0 + 1e-9)]
    assert close[0] == pytest.approx(close[1], abs=1e-8)


def test_a_function_of_seed_and_time_alone() -> None:
    late = gauss_markov_at(20_480.0, seed=3, **SLOW)  # Needs a longer sequence.
    early = gauss_markov_at(55.0, seed=3, **SLOW)
    assert gauss_markov_at(55.0, seed=4, **SLOW) != early
    _sequence.cache_clear()
    assert gauss_markov_at(55.0, seed=3, **SLOW) == early
    assert gauss_markov_at(20_480.0, seed=3, **SLOW) == late
    assert _sequence(3, 0.9, 2048)[:1024] == _sequence(3, 0.9, 1024)


def test_unexplained_acceleration_is_constant_and_slow() -> None:
    constant = np.array([1e-5, -2e-5, 3e-5])
    always = evaluated(UnexplainedAcceleration(constant), "acceleration", 123.4)
    assert np.array_equal(always, constant)
    system = UnexplainedAcceleration(constant, 1e-4, 600.0)
    found = np.array([evaluated(system, "acceleration", 0.0, seed) for seed in range(300)])
    assert found.mean(axis=0) == pytest.approx(constant, abs=4e-4 / np.sqrt(300))
    assert found.std() == pytest.approx(1e-4, rel=0.1)
    slow = gauss_markov_at(77.0, std=1e-4, correlation_time=600.0, period=10.0, seed=9)
    assert evaluated(system, "acceleration", 77.0, 9) == pytest.approx(constant + slow, rel=1e-14)
