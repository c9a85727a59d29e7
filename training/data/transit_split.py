"""Which transits are for training, which for validation, which for testing."""

import numpy as np

from proxops.systems.common import derived_seed

PARTS = ("training", "validation", "test")
# Of each block of five transits: 60 %, 20 %, 20 %.
_BLOCK = ("training", "training", "training", "validation", "test")


def part_of_transit(seed: int, transit: int, split_seed: int = 0) -> str:
    """The part of transit number `transit` of the set of `seed`: a function of these alone.

    Each block of five transits in a row (0 … 4, 5 … 9, …) is dealt out anew: three for training,
    one for validation, one for testing. So the shares are exact over whole blocks, flights that
    are added later move no earlier transit to another part, and all flights of one transit,
    however disturbed, share a part.
    """
    block, place = divmod(transit, len(_BLOCK))
    order = np.random.default_rng(derived_seed(split_seed, seed, block)).permutation(len(_BLOCK))
    return _BLOCK[order[place]]
