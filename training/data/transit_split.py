"""Divides transits into training, validation and test."""

import numpy as np

from proxops.systems.common import derived_seed

PARTS = ("training", "validation", "test")
# Of each block of five transits: 60 %, 20 %, 20 %.
_BLOCK = ("training", "training", "training", "validation", "test")


def part_of_transit(seed: int, transit: int) -> str:
    """The part of transit number `transit` of a seed; it depends on the arguments alone.

    Of each block of five transits (0 … 4, 5 … 9, …) three are drawn for training, one for
    validation and one for testing. So the shares are exact over whole blocks. Flights that are
    added later move no earlier transit to another part. All flights of one transit, disturbed or
    not, are in the same part.
    """
    block, place = divmod(transit, len(_BLOCK))
    order = np.random.default_rng(derived_seed(0, seed, block)).permutation(len(_BLOCK))
    return _BLOCK[order[place]]
