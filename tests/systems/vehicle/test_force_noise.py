"""Noise on the command against a digital filter."""

import numpy as np
import pytest
from random_walks import PERIOD, clone_replays_and_seed_counts, constant, walks
from scipy.signal import lfilter

from proxops.systems import ForceNoise
from proxops.systems.common import generator


def noise(source: ForceNoise, steps: int, seed: int = 0) -> np.ndarray:
    """Noise (steps, 3) on a command of zero."""
    return walks(source, constant([0.0, 0.0, 0.0], steps), seed)


@pytest.mark.parametrize("correlation_time", [0.0, 30.0])
def test_it_is_a_stationary_gauss_markov_sequence(correlation_time):
    """Of independent normal draws, by a digital filter: with its deviation from step 0 on."""
    found = noise(ForceNoise(1e9, std=0.4, correlation_time=correlation_time), 200, seed=5)
    kept = np.exp(-PERIOD / correlation_time) if correlation_time else 0.0
    drawn = np.array([generator(5, step).standard_normal(3) for step in range(200)])
    drawn[1:] *= np.sqrt(1.0 - kept**2)
    np.testing.assert_allclose(found, lfilter([0.4], [1.0, -kept], drawn, axis=0), atol=1e-12)


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
