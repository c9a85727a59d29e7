"""Counter-based random numbers: a pure function of (seed, step), with nothing to store."""

import numpy as np

from proxops.systems.common.errors import InputError


def generator(seed: int, step: int, stream: int = 0) -> np.random.Generator:
    """A generator for one step: numpy's Philox, keyed by seed and step.

    Equal (seed, step) give equal numbers, and different ones independent numbers. The streams of
    one key are 2^192 numbers apart. So several effects can draw at the same step, and each gets the
    same numbers whether or not the others draw.

    Raises:
      InputError: a number is negative, or 2^64 or more.
    """
    for name, number in (("seed", seed), ("step", step)):
        if not 0 <= number < 2**64:
            raise InputError(f"the {name} must be from 0 to 2^64 - 1, got {number}")
    key = np.array([seed, step], dtype=np.uint64)
    counter = np.array([0, 0, 0, stream], dtype=np.uint64)
    return np.random.Generator(np.random.Philox(key=key, counter=counter))


def derived_seed(*parts: int) -> int:
    """A 32-bit seed derived from several numbers, for instance (user's seed, transit, sensor)."""
    return int(np.random.SeedSequence(parts).generate_state(1)[0])
