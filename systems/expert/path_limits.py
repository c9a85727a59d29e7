"""Speed limit and keep-out along a plan, as linear rows of a condensed program.

At each knot after the first, the half-space n.r >= b touches the keep-out ellipsoid below the knot
of the last plan. With slacks s, which are not negative::

    n.r + s_keep_out >= b        -v_limit - s_speed <= v <= v_limit + s_speed, per axis

The states x = R z + d are affine in z, the controls and the stretch. So each limit is a row over
(z, s).
"""

from __future__ import annotations

from typing import NamedTuple

import numba
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
    normals, offsets = tangent_half_spaces(
        limits.keep_out_semi_axes, np.ascontiguousarray(states[:, :3])
    )
    speed = limits.speed / units[3]
    return PathLimits(*_limits(normals, offsets / units[0], speed, units, motion, drift, states))


@numba.njit(cache=True, error_model="numpy")
def _limits(normals, offsets, speed, units, motion, drift, states):
    """The fields of `PathLimits`, from half-spaces and a speed limit in scaled units."""
    n, size = len(states), motion.shape[2]
    rows, bounds, room = np.zeros((7 * n, size + 2 * n)), np.empty(7 * n), np.empty(7 * n)
    for k in range(n):
        height, above = -offsets[k], 0.0
        for i in range(3):
            normal = normals[k, i]
            above += normal * drift[k, i]
            height += normal * states[k, i] / units[0]
            for m in range(size):
                rows[k, m] += normal * motion[k, i, m]
        bounds[k], room[k] = offsets[k] - above, height
        rows[k, size + k] = 1.0
        for i in range(3):
            most = n + 3 * k + i
            least = most + 3 * n
            for m in range(size):
                rows[most, m] = -motion[k, 3 + i, m]
                rows[least, m] = motion[k, 3 + i, m]
            rows[most, size + n + k] = rows[least, size + n + k] = 1.0
            velocity = states[k, 3 + i] / units[3]
            bounds[most], bounds[least] = drift[k, 3 + i] - speed, -drift[k, 3 + i] - speed
            room[most], room[least] = speed - velocity, speed + velocity
    return rows, bounds, room
