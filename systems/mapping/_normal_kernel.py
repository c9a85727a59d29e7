"""Compiled: sums the normal equations of the returns."""

import numpy as np

from proxops.systems.common import kernel
from proxops.systems.mapping.path import DEGREE

_SPLINE = 3 * (DEGREE + 1)
_TAIL = _SPLINE + 6
SHARED = 21
"""Unknowns on which all returns depend."""
LOCAL = _TAIL + SHARED
"""Global unknowns on which one return depends: path, attitude, and those that all depend on. There
are more where the body tumbles."""
_MOTION = 4


@kernel(error_model="numpy", fastmath={"reassoc", "contract"})
def add_returns(frames, starts, rows, residuals, weights, corners, motions, equations):
    """Adds the returns to the normal equations.

    Args:
      frames: (K,) int, ascending: the frame of each return.
      starts: (F, 2) int: where the unknowns of a frame's path and attitude begin.
      rows: (K, LOCAL or more): derivatives of the residuals by the global unknowns on which they
        depend.
      residuals, weights: (K,).
      corners: (K, 3) int: vertices of the facet. motions: (K, 3): derivatives by their heights.
      equations: (matrix (G, G), its upper triangle; cross (V, G); right side (G,)), added to.
    """
    matrix, cross, right = equations
    size = rows.shape[1]
    shared = size - _TAIL
    tail = matrix.shape[0] - shared - _MOTION
    local, side = np.zeros((size, size)), np.zeros(size)
    place = np.empty(size, dtype=np.int64)
    count = frames.size
    for k in range(count):
        first = k == 0 or frames[k] != frames[k - 1]
        if first:
            path, turn = starts[frames[k], 0], starts[frames[k], 1]
            for i in range(_SPLINE):
                place[i] = path + i
            for i in range(6):
                place[_SPLINE + i] = turn + i
            for i in range(shared):
                place[_TAIL + i] = tail + i
            local[:] = 0.0
            side[:] = 0.0
        weight = weights[k]
        for i in range(size):
            heavy = weight * rows[k, i]
            side[i] += heavy * residuals[k]
            for j in range(i, size):
                local[i, j] += heavy * rows[k, j]
            for corner in range(3):
                cross[corners[k, corner], place[i]] += heavy * motions[k, corner]
        if k == count - 1 or frames[k + 1] != frames[k]:
            for i in range(size):
                right[place[i]] += side[i]
                for j in range(i, size):
                    a, b = place[i], place[j]
                    matrix[min(a, b), max(a, b)] += local[i, j]
