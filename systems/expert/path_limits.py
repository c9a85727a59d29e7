"""Speed limit and keep-out along a plan, as linear rows of a condensed program.

At each knot after the first, the half-space n.r >= b touches the keep-out ellipsoid below the knot
of the last plan. With slacks s, which are not negative::

    n.r + s_keep_out >= b        -v_limit - s_speed <= v <= v_limit + s_speed, per axis

The states x = R z + d are affine in z, the controls and the stretch. So each limit is a row over
(z, s).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from proxops.systems.expert.plan import TransitLimits
from proxops.systems.shapes import tangent_half_spaces


class PathLimits(NamedTuple):
    """The limits rows @ (z, keep-out slacks, speed slacks) >= bounds, in scaled units.

    For N knots there are N rows of the keep-out, then 3 N of the greatest and 3 N of the least
    velocity.
    """

    rows: np.ndarray
    """(7 N, M + 2 N), for z (M,)."""
    bounds: np.ndarray
    """(7 N,)."""
    room: np.ndarray
    """(7 N,): distance of the last plan to each limit."""


def path_limits(
    limits: TransitLimits,
    units: np.ndarray,
    motion: np.ndarray,
    drift: np.ndarray,
    states: np.ndarray,
) -> PathLimits:
    """The limits at the N knots whose scaled states are motion @ z + drift.

    Args:
      limits: of the spacecraft and its path.
      units: (6,) in m and m/s that states are scaled by, the same along each axis.
      motion, drift: (N, 6, M) and (N, 6).
      states: (N, 6) of the last plan at those knots, in m and m/s.
    """
    n = len(states)
    positions, velocities = states[:, :3], states[:, 3:].ravel() / units[3]
    normals, offsets = tangent_half_spaces(limits.keep_out_semi_axes, positions)
    offsets, limit = offsets / units[0], limits.speed / units[3]
    out = (normals[:, None] @ motion[:, :3])[:, 0]
    speeds, drifting = motion[:, 3:].reshape(3 * n, -1), drift[:, 3:].ravel()
    above = np.sum(normals * drift[:, :3], axis=1)
    height = np.sum(normals * positions, axis=1) / units[0] - offsets
    slacks = np.zeros((7 * n, 2 * n))
    slacks[:n, :n] = np.eye(n)
    slacks[n:, n:] = np.tile(np.repeat(np.eye(n), 3, axis=0), (2, 1))
    return PathLimits(
        rows=np.hstack([np.concatenate([out, -speeds, speeds]), slacks]),
        bounds=np.concatenate([offsets - above, drifting - limit, -drifting - limit]),
        room=np.concatenate([height, limit - velocities, limit + velocities]),
    )
