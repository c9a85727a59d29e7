"""Which transits a learned policy flies to be taught by its own mistakes."""

from __future__ import annotations

import itertools

from proxops.diagrams.scenario import is_blocked

# Of the transits that are not blocked one in this many is flown, because those are easy.
_CLEAR_EVERY = 7


def hard_transits(count: int) -> list[int]:
    """Numbers of `count` transits of a set: all blocked ones, and a few of the others."""
    hard = (each for each in itertools.count() if is_blocked(each) or each % _CLEAR_EVERY == 0)
    return list(itertools.islice(hard, count))
