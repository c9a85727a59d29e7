"""Noise on the command against the closed forms of a Gauss-Markov sequence."""

import numpy as np
import pytest
from random_walks import PERIOD, clone_replays_and_seed_counts, constant, walks
from scipy import stats

from proxops.systems import ForceNoise


def noise(source: ForceNoise, steps: int, seed: int = 0) -> np.ndarray:
    """Noise (steps, 3) on a command of zero."""
    return walks(source, constant([0.0, 0.0, 0.0], steps), seed)


@pytest.mark.parametrize("correlation_time", [0.0, 30.0])
def test_a_command_of_zero_is_disturbed_by_the_stated_deviation(correlation_time):
    found = noise(ForceNoise(1e9, std=0.4, correlation_time=correlation_time), 3000)
    # So many independent numbers are a correlated sequence's worth.
    kept = np.exp(-PERIOD / correlation_time) if correlation_time else 0.0
    worth = found.size * (1 - kept**2) / (1 + kept**2)
    assert abs(found.mean()) < 4.0 * 0.4 * np.sqrt((1 + kept) / (1 - kept) / found.size)
    assert found.std() == pytest.approx(0.4, abs=4.0 * 0.4 / np.sqrt(2 * worth))


def test_white_noise_is_normal_and_forgets_itself():
    found = noise(ForceNoise(1e9, std=2.0, correlation_time=0.0), 3000)
    assert stats.kstest(found.ravel() / 2.0, "norm").pvalue > 1e-3
    for axis in found.T:
        assert abs(np.corrcoef(axis[1:], axis[:-1])[0, 1]) < 4.0 / np.sqrt(3000)
    assert abs(np.corrcoef(found.T)[np.triu_indices(3, 1)]).max() < 4.0 / np.sqrt(3000)


def test_correlation_falls_by_e_in_the_correlation_time():
    found = noise(ForceNoise(1e9, std=1.0, correlation_time=50.0), 6000)
    for lag in (1, 2, 5):
        expected = np.exp(-lag * PERIOD / 50.0)
        products = found[lag:] * found[:-lag]
        assert products.mean() == pytest.approx(expected, abs=0.08)


def test_deviation_is_the_same_from_the_first_step():
    source = ForceNoise(1e9, std=1.0, correlation_time=100.0)
    first = np.array([noise(source, 4, seed) for seed in range(300)])
    spread = first.std(axis=(0, 2))
    assert spread == pytest.approx(np.ones(4), abs=4.0 / np.sqrt(2 * 900))


def test_noise_does_not_depend_on_the_command_and_the_sum_is_clipped():
    random = np.random.default_rng(0)
    commands = random.uniform(-6.0, 6.0, (200, 3))
    added = noise(ForceNoise(1e9, std=3.0), 200, seed=5)
    free = walks(ForceNoise(1e9, std=3.0), commands, seed=5)
    assert free - commands == pytest.approx(added, abs=1e-12)
    clipped = walks(ForceNoise(7.0, std=3.0), commands, seed=5)
    assert np.abs(free).max() > 7.0
    assert np.array_equal(clipped, np.clip(free, -7.0, 7.0))


def test_clone_replays_and_seed_is_a_parameter_of_the_context():
    clone_replays_and_seed_counts(lambda seed: ForceNoise(7.0, seed=seed), 40, 17)
