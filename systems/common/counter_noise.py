"""Counter-based random numbers: a pure function of (seed, step), with nothing to store."""

import numpy as np
from numpy.random.bit_generator import ISeedSequence


class _Key(ISeedSequence):
    """A key of Philox. Given to it as `key`, numpy would first ask the system for random numbers."""

    def __init__(self, seed: int, step: int):
        self._key = (seed, step)

    def generate_state(self, n_words, dtype=np.uint32):
        return np.array(self._key, dtype=dtype)


def generator(seed: int, step: int, stream: int = 0) -> np.random.Generator:
    """A generator for one step: numpy's Philox, keyed by seed and step.

    Equal (seed, step) give equal numbers, and different ones independent numbers. The streams of
    one key are 2^192 numbers apart. So several effects can draw at the same step, and each gets the
    same numbers whether or not the others draw.
    """
    counter = np.array([0, 0, 0, stream], dtype=np.uint64)
    return np.random.Generator(np.random.Philox(_Key(seed, step), counter=counter))


def derived_seed(*parts: int) -> int:
    """A 32-bit seed derived from several numbers, for instance (user's seed, transit, sensor)."""
    return int(np.random.SeedSequence(parts).generate_state(1)[0])
