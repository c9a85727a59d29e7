"""Compiled kernels: which returns of a frame are used, and the Kalman update by them.

Rows are copied by loops: slices on the left take numba seconds to compile.
"""

import numba
import numpy as np

_compiled = numba.njit(cache=True, error_model="numpy")


@_compiled
def judged(covariance, columns, rows, residuals, variances, moved, gate, most, own):
    """The L of K residuals that are used: those that may be true.

    Args:
      covariance: P (n, n). columns: (C,) where the measured quantities are in it.
      rows: (K, C) derivatives. residuals: (K,), at the place where the frame was linearised.
      variances: (K,) of the noise; +inf: not to be used.
      moved: (n,) that place less the prior's mean.
      gate: so many standard deviations a residual may be off by.
      most: where there are not twice as many residuals as quantities, they are thinned to so many.
      own: if the prior knows next to nothing of the first so many quantities, residuals are judged
        by the others alone, of variance 1, at the place where the frame was linearised. Else 0.

    Returns:
      Indices of the residuals that are used (L,), and of those that are rejected; derivatives H
      (L, C); (L, n + 1): H P and, last, the residuals as they would be at the prior's mean if the
      model were linear; and variances of the noise (L,).
    """
    size, n = rows.shape[1], covariance.shape[0]
    chosen = np.flatnonzero(variances < np.inf)
    if size > chosen.size // 2:
        chosen = chosen[:: max(1, -(-chosen.size // most))]
    to_all = np.empty((size, n + 1))
    for i in range(size):
        for j in range(n):
            to_all[i, j] = covariance[columns[i], j]
        to_all[i, n] = moved[columns[i]]
    kept = rows[chosen]
    crossed = kept @ to_all
    noise = variances[chosen]
    bad, used = np.empty_like(chosen), 0
    for i in range(chosen.size):
        residual, spread = residuals[chosen[i]], noise[i]
        crossed[i, n] += residual
        if own:
            for j in range(own, size):
                spread += kept[i, j] ** 2
        else:
            residual = crossed[i, n]
            for j in range(size):
                spread += crossed[i, columns[j]] * kept[i, j]
        if residual**2 < gate**2 * spread:
            chosen[used], noise[used] = chosen[i], noise[i]
            for j in range(size):
                kept[used, j] = kept[i, j]
            for j in range(n + 1):
                crossed[used, j] = crossed[i, j]
            used += 1
        else:
            bad[i - used] = chosen[i]
    rejected = chosen.size - used
    return chosen[:used], bad[:rejected], kept[:used], crossed[:used], noise[:used]


@_compiled
def update(covariance, columns, rows, crossed, variances):
    """The update in information form: with A = H^T R^-1 H, P loses P (I + A P)^-1 A P.

    Args:
      covariance: P (n, n). columns: (C,) where the measured quantities are in it.
      rows: H (K, C). crossed: (K, n + 1), as `judged` gives it. variances: (K,) diagonal of R.

    Returns:
      What the mean moves by (n,), the new covariance, and the normalised innovation squared.
    """
    count, size = rows.shape
    n = covariance.shape[0]
    innovations = crossed[:, n]
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
    to_all, among = np.empty((size, n)), np.empty((size, size))
    for i in range(size):
        for j in range(i):
            information[j, i] = information[i, j]
        for j in range(n):
            to_all[i, j] = covariance[columns[i], j]
        for j in range(size):
            among[i, j] = to_all[i, columns[j]]
    left, known = information @ among, information @ to_all
    right = np.empty((size, n + 1))
    for i in range(size):
        left[i, i] += 1.0
        right[i, 0] = pull[i]
        for j in range(n):
            right[i, 1 + j] = known[i, j]
    both = to_all.T @ np.linalg.solve(left, right)
    moved, after = both[:, 0].copy(), np.empty((n, n))
    for i in range(n):
        for j in range(i + 1):
            lost = 0.5 * (both[i, 1 + j] + both[j, 1 + i])
            after[i, j] = after[j, i] = covariance[i, j] - lost
    for i in range(size):
        squares -= pull[i] * moved[columns[i]]
    return moved, after, squares


@_compiled
def fit(rows, innovations, before, after):
    """How well a correction explains its K residuals.

    Args:
      rows: (K, C) derivatives. innovations: (K,).
      before: (C,) place where the frame was linearised, less the prior's mean. after: (C,) the
        correction.

    Returns:
      Mean square of what the residuals change by from `before` to `after`, and of what is left.
    """
    changed, left = 0.0, 0.0
    for k in range(innovations.size):
        change, rest = 0.0, innovations[k]
        for j in range(after.size):
            change += rows[k, j] * (after[j] - before[j])
            rest -= rows[k, j] * after[j]
        changed += change * change
        left += rest * rest
    return changed / innovations.size, left / innovations.size


@_compiled
def squared_deviation(covariance, columns, moved):
    """The square of a step (n,) of some quantities, over their covariance, which is in (n, n).

    By Cholesky's decomposition, of a few rows, because numba takes long to compile a solver.
    """
    count = columns.size
    root, white, total = np.zeros((count, count)), np.zeros(count), 0.0
    for i in range(count):
        step = moved[columns[i]]
        for j in range(i + 1):
            left = covariance[columns[i], columns[j]]
            for k in range(j):
                left -= root[i, k] * root[j, k]
            root[i, j] = left / root[j, j] if j < i else np.sqrt(left)
        for k in range(i):
            step -= root[i, k] * white[k]
        white[i] = step / root[i, i]
        total += white[i] ** 2
    return total
