"""Counter-based random numbers: noise as a pure function of (seed, step), with nothing to store."""

import numpy as np


def generator(seed: int, step: int) -> np.random.Generator:
    """A generator for one step: numpy's Philox, keyed by seed and step.

    Two different (seed, step) give independent streams; the same give the same numbers.
    """
    return np.random.Generator(np.random.Philox(key=np.array([seed, step], dtype=np.uint64)))


def derived_seed(*parts: int) -> int:
    """One 32-bit seed from several numbers, for instance (user's seed, transit, sensor)."""
    return int(np.random.SeedSequence(parts).generate_state(1)[0])
