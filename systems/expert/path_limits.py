"""Speed limit and keep-out along a plan, as linear rows of a condensed program.

At each knot after the first, the half-space n.r >= b touches the keep-out ellipsoid below the knot
of the last plan. With slacks s, which are not negative::

    n.r + s_keep_out >= b        -v_limit - s_speed <= v <= v_limit + s_speed, per axis

The states x = R z + d are affine in z, the controls and the stretch. So each limit is a row over
(z, s). For N knots there are 7 N limits: N of the keep-out, then 3 N of the greatest and 3 N of the
least velocity. Few of them are near a plan, so rows are made for those alone that are asked for.
"""

from __future__ import annotations

import numpy as np

from proxops.systems.common import States, kernel
from proxops.systems.shapes import tangent_half_spaces
from proxops.systems.vehicle import FlightLimits


class PathLimits:
    """The limits along a plan, in scaled units."""

    def __init__(self, limits: FlightLimits, units: np.ndarray, states: np.ndarray):
        """Puts the half-spaces below the plan.

        Args:
          limits: of the spacecraft and its path.
          units: (6,) in m and m/s that states are scaled by, the same along each axis.
          states: (N, 6) of the last plan at its knots after the first, in m and m/s.
        """
        self._normals, offsets = tangent_half_spaces(limits.keep_out_semi_axes, states[:, :3])
        self._offsets, self._speed = offsets / units[0], limits.speed / units[3]

    def room(self, states: States) -> np.ndarray:
        """Distances (7 N,) of scaled states (N, 6) at the knots to the limits without slack."""
        return _room(self._normals, self._offsets, self._speed, states)

    def rows(self, affine: np.ndarray, size: int, included: np.ndarray) -> np.ndarray:
        """The rows of some limits: the last column is the least value of the others times (z, s).

        Args:
          affine: (N, 6, M) coefficients of the scaled states in z and, in the last column, 1.
          size: number of those of z.
          included: (7 N,) bool: which limits.

        Returns:
          (K, size + 2 N + 1): of z, keep-out slacks, speed slacks, and the bounds.
        """
        return _rows(self._normals, self._offsets, self._speed, affine, size, included)


def slack_of_limits(slacks: np.ndarray) -> np.ndarray:
    """The slack (7 N,) of each limit, from the slacks (2 N,) of keep-out and speed."""
    out, fast = np.split(slacks, 2)
    return np.concatenate([out, np.tile(np.repeat(fast, 3), 2)])


@kernel(error_model="numpy")
def _room(normals, offsets, speed, states):
    n = offsets.size
    room = np.empty(7 * n)
    for k in range(n):
        room[k] = -offsets[k]
        for i in range(3):
            room[k] += normals[k, i] * states[k, i]
            room[n + 3 * k + i] = speed - states[k, 3 + i]
            room[4 * n + 3 * k + i] = speed + states[k, 3 + i]
    return room


@kernel(error_model="numpy")
def _rows(normals, offsets, speed, affine, size, included):
    n = offsets.size
    rows = np.zeros((np.count_nonzero(included), size + 2 * n + 1))
    last = affine.shape[2] - 1
    row = 0
    for limit in range(7 * n):
        if not included[limit]:
            continue
        now = rows[row]
        row += 1
        if limit < n:
            now[size + limit], now[size + 2 * n] = 1.0, offsets[limit]
            for i in range(3):
                for m in range(size):
                    now[m] += normals[limit, i] * affine[limit, i, m]
                now[size + 2 * n] -= normals[limit, i] * affine[limit, i, last]
            continue
        k, i = divmod((limit - n) % (3 * n), 3)
        sign = -1.0 if limit < 4 * n else 1.0
        now[size + n + k] = 1.0
        for m in range(size):
            now[m] = sign * affine[k, 3 + i, m]
        now[size + 2 * n] = -sign * affine[k, 3 + i, last] - speed
    return rows
