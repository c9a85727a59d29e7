"""Compiled kernel: the Kalman update by many residuals of few quantities."""

import numba
import numpy as np


@numba.njit(cache=True, error_model="numpy")
def update(covariance, to_all, among, rows, innovations, variances):
    """The update in information form: with A = H^T R^-1 H, P loses P (I + A P)^-1 A P.

    Args:
      covariance: P (n, n). to_all: its columns (n, C) of the quantities that are measured.
      among: (C, C) its part between them.
      rows: H (K, C). innovations: (K,). variances: (K,) diagonal of R.

    Returns:
      What the mean moves by (n,), the new covariance, and the normalised innovation squared.
    """
    count, size = rows.shape
    n = covariance.shape[0]
    information, pull = np.zeros((size, size)), np.zeros(size)
    squares = 0.0
    for k in range(count):
        weight = 1.0 / variances[k]
        squares += weight * innovations[k] ** 2
        for i in range(size):
            scaled = weight * rows[k, i]
            pull[i] += scaled * innovations[k]
            for j in range(i + 1):
                information[i, j] += scaled * rows[k, j]
    for i in range(size):
        for j in range(i):
            information[j, i] = information[i, j]
    right = np.empty((size, n + 1))
    right[:, 0] = pull
    right[:, 1:] = information @ to_all.T
    solved = np.linalg.solve(np.eye(size) + information @ among, right)
    both = to_all @ solved
    moved = both[:, 0].copy()
    out = covariance - both[:, 1:]
    return moved, 0.5 * (out + out.T), squares
