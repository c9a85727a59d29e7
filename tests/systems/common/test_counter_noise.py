"""Noise as a pure function of (seed, step)."""

import numpy as np
import pytest

from proxops.systems.common.counter_noise import derived_seed, generator


def test_it_is_numpys_philox_keyed_by_both():
    bits = np.random.Philox(key=[11, 5])
    assert generator(11, 5).random() == np.random.Generator(bits).random()


@pytest.mark.parametrize(("seed", "step"), [(3, 8), (4, 7), (7, 3), (3, 2**64 - 8)])
def test_another_key_gives_independent_numbers(seed, step):
    count = 20_000
    correlation = np.corrcoef(
        generator(3, 7).standard_normal(count), generator(seed, step).standard_normal(count)
    )[0, 1]
    assert abs(correlation) < 4.0 / np.sqrt(count)


def test_derived_seeds_are_whole_numbers_that_a_parameter_holds_exactly():
    seeds = [derived_seed(a, b, c) for a in range(5) for b in range(5) for c in range(5)]
    assert len(set(seeds)) == 125
    assert all(isinstance(seed, int) and 0 <= seed < 2**32 for seed in seeds)
    assert derived_seed(1, 2, 3) == derived_seed(1, 2, 3) != derived_seed(3, 2, 1)
