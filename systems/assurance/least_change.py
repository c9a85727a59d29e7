"""The least change of a command that makes it safe, where safety is a function of the command."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

Worth = Callable[[np.ndarray], float]
"""How safe a command (3,) is: safe from 0 on; -inf if nothing is known."""
Box = tuple[np.ndarray, np.ndarray]
"""Least and greatest command, (3,) each."""

# The search may end at this share of the worth that was missing; how many commands a search along
# a path tries at most; and how many gradients are followed.
_NEAR_ENOUGH = 0.03
_TRIES = 6
_ROUNDS = 2
# Share of the box's half width by which it is tried how the worth changes.
_PROBE = 0.05
# A path ends where an axis that counts for a tenth has gone through the box.
_FAR = 20.0


def least_change(
    worth: Worth, start: np.ndarray, missing: float, box: Box, limit: float, enough: float
) -> np.ndarray | None:
    """The safe command nearest to one that is not, to first order; None if none was found.

    Up the gradient of the worth: there, to first order, lies the least change. First that at the
    start, then that at what was found.

    Args:
      start: (3,), within the box.
      missing: its worth, below 0.
      limit: the box is within these, either way.
      enough: a worth this far above 0 is as good as 0.
    """
    found: np.ndarray | None = None
    at, worth_at, least = start, missing, math.inf
    for _ in range(_ROUNDS):
        if worth_at == -math.inf:
            break
        gradient = _gradient(worth, at, worth_at, box[1], _PROBE * limit)
        steepness = float(gradient @ gradient)
        if steepness == 0.0:
            break
        far = _FAR * limit / math.sqrt(steepness)
        along = float(gradient @ (at - start))
        first = min(max(along - worth_at, 0.0) / steepness, far)
        at, worth_at = along_path(worth, start, gradient, missing, box, first, far, enough)
        change = float((at - start) @ (at - start))
        if worth_at < 0.0 or change >= least:
            break
        found, least = at, change
    return found


def along_path(
    worth: Worth,
    start: np.ndarray,
    toward: np.ndarray,
    missing: float,
    box: Box,
    first: float,
    far: float,
    enough: float,
) -> tuple[np.ndarray, float]:
    """The nearest point of a path that is safe, and its worth; -inf where none was found.

    The path is start + share toward, kept within the box, for a share of up to `far`; its start has
    the worth `missing`, below 0. By false position (the Illinois rule), from `first` on.
    """
    if missing > -math.inf:
        enough = max(enough, -_NEAR_ENOUGH * missing)

    def point(share: float) -> np.ndarray:
        return np.minimum(np.maximum(start + share * toward, box[0]), box[1])

    bad, good, share, slope = 0.0, math.inf, first, 0.0
    worth_bad, worth_good, worth_found = missing, 0.0, -math.inf
    for _ in range(_TRIES):
        there = worth(point(share))
        if there >= 0.0:
            if good < math.inf:
                worth_bad *= 0.5
            good, worth_good, worth_found = share, there, there
            if there <= enough:
                break
        elif share >= far:
            break
        else:
            if good < math.inf:
                worth_good *= 0.5
            slope = (there - worth_bad) / (share - bad) if share > bad else 0.0
            bad, worth_bad = share, there
        if good == math.inf:
            step = (0.5 * enough - there) / slope if slope > 0.0 else math.inf
            share = min(share + min(max(1.1 * step, 0.1 * share), 3.0 * share), far)
        elif worth_bad > -math.inf:
            rise = max(worth_good - worth_bad, 0.5 * enough)
            share = bad + (good - bad) * min((0.5 * enough - worth_bad) / rise, 0.95)
        else:
            share = 0.5 * (bad + good)
    return point(good if good < math.inf else share), worth_found


def _gradient(
    worth: Worth, at: np.ndarray, worth_at: float, high: np.ndarray, probe: float
) -> np.ndarray:
    """Of the worth, by differences within the box; 0 along an axis where it is not known."""
    gradient = np.zeros(3)
    for i in range(3):
        step = probe if at[i] + probe <= high[i] else -probe
        tried = at.copy()
        tried[i] += step
        there = worth(tried)
        if there > -math.inf:
            gradient[i] = (there - worth_at) / step
    return gradient
