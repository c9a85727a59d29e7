"""The least change of a command that makes it safe, where safety is a function of the command."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

Margin = Callable[[np.ndarray], float]
"""How safe a command (3,) is: safe from 0 on; -inf if nothing is known."""
Box = tuple[np.ndarray, np.ndarray]
"""Least and greatest command, (3,) each."""

# The search may end at this share of the shortfall; how many commands a search along
# a path tries at most; and how many gradients are followed.
_NEAR_ENOUGH = 0.03
_TRIES = 6
_ROUNDS = 2
# Share of the box's half width by which it is tried how the margin changes.
_PROBE = 0.05
# A path ends where an axis that counts for a tenth has gone through the box.
_FAR = 20.0


def least_change(
    margin: Margin, start: np.ndarray, shortfall: float, box: Box, limit: float, enough: float
) -> np.ndarray | None:
    """The safe command nearest to one that is not, to first order; None if none was found.

    Up the gradient of the margin: there, to first order, lies the least change. First that at the
    start, then that at what was found.

    Args:
      start: (3,), within the box.
      shortfall: how far its margin is below 0; inf if nothing is known of it.
      limit: the box is within these, either way.
      enough: a margin this far above 0 is as good as 0.
    """
    found: np.ndarray | None = None
    at, margin_at, least = start, -shortfall, math.inf
    for _ in range(_ROUNDS):
        if margin_at == -math.inf:
            break
        gradient = _gradient(margin, at, margin_at, box[1], _PROBE * limit)
        steepness = float(gradient @ gradient)
        if steepness == 0.0:
            break
        far = _FAR * limit / math.sqrt(steepness)
        along = float(gradient @ (at - start))
        first = min(max(along - margin_at, 0.0) / steepness, far)
        at, margin_at = along_path(margin, start, gradient, shortfall, box, first, far, enough)
        change = float((at - start) @ (at - start))
        if margin_at < 0.0 or change >= least:
            break
        found, least = at, change
    return found


def along_path(
    margin: Margin,
    start: np.ndarray,
    toward: np.ndarray,
    shortfall: float,
    box: Box,
    first: float,
    far: float,
    enough: float,
) -> tuple[np.ndarray, float]:
    """The nearest point of a path that is safe, and its margin; -inf where none was found.

    The path is start + share toward, kept within the box, for a share of up to `far`; its start has
    a margin of `-shortfall`, below 0. By false position (the Illinois rule), from `first` on.
    """
    if shortfall < math.inf:
        enough = max(enough, _NEAR_ENOUGH * shortfall)

    def point(share: float) -> np.ndarray:
        return np.minimum(np.maximum(start + share * toward, box[0]), box[1])

    bad, good, share, slope = 0.0, math.inf, first, 0.0
    margin_bad, margin_good, margin_found = -shortfall, 0.0, -math.inf
    for _ in range(_TRIES):
        there = margin(point(share))
        if there >= 0.0:
            if good < math.inf:
                margin_bad *= 0.5
            good, margin_good, margin_found = share, there, there
            if there <= enough:
                break
        elif share >= far:
            break
        else:
            if good < math.inf:
                margin_good *= 0.5
            slope = (there - margin_bad) / (share - bad) if share > bad else 0.0
            bad, margin_bad = share, there
        if good == math.inf:
            step = (0.5 * enough - there) / slope if slope > 0.0 else math.inf
            share = min(share + min(max(1.1 * step, 0.1 * share), 3.0 * share), far)
        elif margin_bad > -math.inf:
            rise = max(margin_good - margin_bad, 0.5 * enough)
            share = bad + (good - bad) * min((0.5 * enough - margin_bad) / rise, 0.95)
        else:
            share = 0.5 * (bad + good)
    return point(good if good < math.inf else share), margin_found


def _gradient(
    margin: Margin, at: np.ndarray, margin_at: float, high: np.ndarray, probe: float
) -> np.ndarray:
    """Of the margin, by differences within the box; 0 along an axis where it is not known."""
    gradient = np.zeros(3)
    for i in range(3):
        step = probe if at[i] + probe <= high[i] else -probe
        tried = at.copy()
        tried[i] += step
        there = margin(tried)
        if there > -math.inf:
            gradient[i] = (there - margin_at) / step
    return gradient
