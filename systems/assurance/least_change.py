"""The least change of a command that makes it safe, where safety is a function of the command."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from proxops.systems.common import Vector3

Margin = Callable[[np.ndarray], float]
"""Gives the margin of a command (3,), which is safe if that is not negative. -inf means that the
distance to safety is not known."""
Box = tuple[np.ndarray, np.ndarray]
"""Least and greatest command, (3,) each."""


class Path(NamedTuple):
    """The commands start + share * toward, clipped to the box, with a share from 0 to `far`."""

    start: np.ndarray
    toward: Vector3
    """(3,) each."""
    first: float
    """The share to try first."""
    far: float


# The search ends at a margin below this share of the shortfall.
_NEAR_ENOUGH = 0.03
# Greatest number of commands that a search along a path tries.
_TRIES = 6
# Number of gradients that are followed.
_ROUNDS = 2
# Step of the differences for the gradient, as a share of the box's half width.
_PROBE = 0.05
# A path ends where an axis that has a tenth of the gradient has passed through the whole box.
_FAR = 20.0


def least_change(
    margin: Margin, start: Vector3, shortfall: float, box: Box, limit: float, enough: float
) -> np.ndarray | None:
    """Finds the safe command nearest to an unsafe one, to first order; None if the search fails.

    To first order the least change is up the gradient of the margin. The search follows the
    gradient at the start, then the gradient at the result.

    Args:
      margin: how safe a command is.
      start: (3,) the unsafe command, within the box.
      shortfall: how far its margin is below 0; inf if that is not known.
      box: bounds of the command.
      limit: the box lies within ± limit.
      enough: a margin up to this above 0 counts as 0.
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
        path = Path(start, gradient, first, far)
        at, margin_at = along_path(margin, path, shortfall, box, enough)
        change = float((at - start) @ (at - start))
        if margin_at < 0.0 or change >= least:
            break
        found, least = at, change
    return found


def along_path(
    margin: Margin, path: Path, shortfall: float, box: Box, enough: float
) -> tuple[np.ndarray, float]:
    """Finds the nearest safe point of a path, by false position (the Illinois rule).

    Args:
      margin, shortfall, box, enough: as in `least_change`, for the start of the path.
      path: where to search.

    Returns:
      The point and its margin; the margin is -inf if no safe point was found.
    """
    start, toward, first, far = path
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
    """The margin's gradient, by differences within the box; 0 along an axis where it is unknown."""
    gradient = np.zeros(3)
    for i in range(3):
        step = probe if at[i] + probe <= high[i] else -probe
        tried = at.copy()
        tried[i] += step
        there = margin(tried)
        if there > -math.inf:
            gradient[i] = (there - margin_at) / step
    return gradient
