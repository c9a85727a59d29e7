"""Noise as a pure function of (seed, step)."""

import numpy as np
import pytest

from proxops.systems.common.counter_noise import derived_seed, generator


def test_same_key_same_numbers_whatever_was_drawn_before():
    first = generator(3, 7).standard_normal(20)
    generator(3, 6).standard_normal(1000)
    assert np.array_equal(first, generator(3, 7).standard_normal(20))


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


def test_numbers_along_steps_are_standard_normal():
    """The first number of each step, as a slow process sees them."""
    numbers = np.array([generator(0, step).standard_normal() for step in range(4000)])
    assert abs(numbers.mean()) < 4.0 / np.sqrt(4000)
    assert numbers.std() == pytest.approx(1.0, abs=4.0 / np.sqrt(8000))
    assert abs(np.corrcoef(numbers[1:], numbers[:-1])[0, 1]) < 4.0 / np.sqrt(4000)


def test_derived_seeds_are_whole_numbers_that_a_parameter_holds_exactly():
    seeds = [derived_seed(a, b, c) for a in range(5) for b in range(5) for c in range(5)]
    assert len(set(seeds)) == 125
    assert all(isinstance(seed, int) and 0 <= seed < 2**32 for seed in seeds)
    assert derived_seed(1, 2, 3) == derived_seed(1, 2, 3) != derived_seed(3, 2, 1)
