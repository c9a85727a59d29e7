"""Which transits a learned policy flies to be taught by its own mistakes."""

from __future__ import annotations

from proxops.diagrams.scenario import is_blocked

# Of the transits that are not blocked one in this many is flown, because those are easy.
_CLEAR_EVERY = 7


def hard_transits(count: int) -> list[int]:
    """Numbers of `count` transits of a set: all blocked ones, and a few of the others."""
    chosen: list[int] = []
    index = 0
    while len(chosen) < count:
        if is_blocked(index) or index % _CLEAR_EVERY == 0:
            chosen.append(index)
        index += 1
    return chosen
