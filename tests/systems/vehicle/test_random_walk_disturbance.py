"""The random walk on the command, step by step, against what can be worked out by hand."""

import numpy as np
import pytest
from random_walks import STEPS, clone_replays_and_seed_counts, constant, walks
from scipy import stats

from proxops.systems import RandomWalkDisturbance
from proxops.systems.common.counter_noise import generator


def test_walk_is_the_sum_of_increments_since_the_reset():
    """With a command so strong that the bound never binds."""
    command = [1e6, 0.0, 0.0]
    added = (
        walks(RandomWalkDisturbance(1e9, increment_std=0.2), constant(command, 60), seed=3)
        - command
    )
    drawn = np.array([0.2 * generator(3, step).standard_normal(3) for step in range(60)])
    for stretch in range(6):
        rows = slice(STEPS * stretch, STEPS * (stretch + 1))
        assert added[rows] == pytest.approx(np.cumsum(drawn[rows], axis=0), abs=1e-9)


def bounds(seed: int, stretches: int, command) -> np.ndarray:
    """Bounds (stretches, STEPS), as multiples of the command: a wild walk always reaches them."""
    disturbance = RandomWalkDisturbance(1e9, increment_std=1e5)
    forces = walks(disturbance, constant(command, STEPS * stretches), seed)
    lengths = np.linalg.norm(forces - command, axis=1) / np.linalg.norm(command)
    return lengths.reshape(stretches, STEPS)


def test_bound_is_drawn_anew_each_100_s_and_constant_between():
    found = bounds(0, 150, [1.0, -2.0, 2.0])
    assert np.ptp(found, axis=1).max() < 1e-12
    drawn = found[:, 0]
    assert len(np.unique(drawn)) == 150
    assert 0.0 <= drawn.min() < 0.1
    assert 1.9 < drawn.max() <= 2.0
    assert stats.kstest(drawn / 2.0, "uniform").pvalue > 1e-3
    assert abs(np.corrcoef(drawn[1:], drawn[:-1])[0, 1]) < 4.0 / np.sqrt(150)


def test_bound_follows_the_command_within_a_stretch():
    random = np.random.default_rng(0)
    commands = random.normal(size=(200, 3)) * random.uniform(0.0, 3.0, (200, 1))
    wild = RandomWalkDisturbance(1e9, increment_std=1e5)
    ratios = np.linalg.norm(walks(wild, commands) - commands, axis=1)
    ratios = (ratios / np.linalg.norm(commands, axis=1)).reshape(-1, STEPS)
    assert ratios == pytest.approx(np.repeat(bounds(0, 20, [1.0, 0, 0])[:, :1], STEPS, axis=1))
    # And of the walk as the paper flew it, no step is beyond the bound.
    calm = np.linalg.norm(walks(RandomWalkDisturbance(1e9), commands) - commands, axis=1)
    allowed = (ratios[:, :1] * np.linalg.norm(commands, axis=1).reshape(-1, STEPS)).ravel()
    assert np.all(calm <= allowed * (1 + 1e-12))
    assert np.any(calm < 0.5 * allowed)
    assert np.all(calm <= 2.0 * np.linalg.norm(commands, axis=1))


def test_sum_is_clipped_to_the_thrusters():
    commands = constant([6.0, -6.0, 3.0], 400)
    disturbance = RandomWalkDisturbance(7.0, increment_std=3.0)
    free = RandomWalkDisturbance(1e9, increment_std=3.0)
    forces, unclipped = walks(disturbance, commands), walks(free, commands)
    assert np.abs(unclipped).max() > 10.0
    assert np.array_equal(forces, np.clip(unclipped, -7.0, 7.0))


def test_walk_starts_anew_after_a_pause_of_the_command():
    """While the command is zero so is the walk: it grows again from there."""
    commands = constant([1e6, 0.0, 0.0], 10)
    commands[4] = 0.0
    added = walks(RandomWalkDisturbance(1e9), commands) - commands
    drawn = np.array([0.5 * generator(0, step).standard_normal(3) for step in range(10)])
    assert np.array_equal(added[4], np.zeros(3))
    assert added[5:] == pytest.approx(np.cumsum(drawn[5:], axis=0), abs=1e-9)


def test_clone_replays_and_seed_is_a_parameter_of_the_context():
    clone_replays_and_seed_counts(lambda seed: RandomWalkDisturbance(7.0, seed=seed), 60, 37)
