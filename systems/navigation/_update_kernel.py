"""Compiled kernels: which returns of a frame are used, and the Kalman update by them.

Rows are copied by loops: slices on the left take numba seconds to compile, and a solver eight. So
`update` itself is not compiled.
"""

from typing import NamedTuple

import numpy as np
import scipy  # Its parts are imported when they are used.

from proxops.systems.common import kernel

_compiled = kernel(error_model="numpy")


class Gate(NamedTuple):
    """Which residuals may be used."""

    sigmas: float
    """Gate: standard deviations of a residual beyond which it is rejected."""
    most: int
    """If the lesser of this and the number of usable residuals is below 2 C, they are thinned to at
    most this number."""
    uninformed: int
    """Number of the first measured quantities whose prior is uninformative: gate on the others
    alone, with variance 1, at the place where the frame was linearised. 0: gate on all of the
    prior."""


class Gated(NamedTuple):
    """The L of K residuals that pass the gate."""

    used: np.ndarray
    rejected: np.ndarray
    """Indices among the K: (L,) that pass, and those that do not."""
    rows: np.ndarray
    """H (L, C)."""
    cross_covariance: np.ndarray
    """H P (L, n) where residuals may be thinned, else (L, 0)."""
    innovations: np.ndarray
    """(L,) the residuals as they would be at the prior's mean if the model were linear."""
    variances: np.ndarray
    """(L,) of the noise."""


class Update(NamedTuple):
    """A linear update of the prior by K residuals."""

    moved: np.ndarray
    """(n,) what the mean moves by."""
    covariance: np.ndarray
    """(n, n) after it."""
    nis: float
    """Normalised innovation squared."""


@_compiled
def gated(covariance, columns, frame, moved, gate):
    """The residuals that pass the gate, eq. 16 of docs/method/equations.md: a `Gated`.

    Args:
      covariance: P (n, n). columns: (C,) where the measured quantities are in it.
      frame: a `Comparison` of K rays, linearised at a place.
      moved: (n,) that place less the prior's mean.
      gate: a `Gate`.
    """
    _, residuals, variances, rows = frame
    sigmas, most, own = gate
    size, n = rows.shape[1], covariance.shape[0]
    chosen = np.flatnonzero(variances < np.inf)
    few = size > min(chosen.size, most) // 2
    if few:
        chosen = chosen[:: max(1, -(-chosen.size // most))]
    kept = rows[chosen]
    cross_covariance = np.empty((chosen.size, 0))
    if few:
        to_all = np.empty((size, n))
        for i in range(size):
            for j in range(n):
                to_all[i, j] = covariance[columns[i], j]
        cross_covariance = kept @ to_all
    # What is exact adds nothing to the spread.
    among, known = np.empty((size, size)), np.empty(size, dtype=np.int64)
    count = 0
    for i in range(size):
        if covariance[columns[i], columns[i]] > 0.0:
            known[count] = i
            count += 1
    if not few:
        for i in range(count):
            for j in range(count):
                among[i, j] = covariance[columns[known[i]], columns[known[j]]]
    noise, innovations = variances[chosen], residuals[chosen]
    bad, used = np.empty_like(chosen), 0
    for k in range(chosen.size):
        residual, spread = innovations[k], noise[k]
        for j in range(size):
            innovations[k] += kept[k, j] * moved[columns[j]]
        if own:
            for j in range(own, size):
                spread += kept[k, j] ** 2
        else:
            residual = innovations[k]
            for i in range(count):
                row, total = kept[k, known[i]], 0.0
                if few:
                    total = cross_covariance[k, columns[known[i]]]
                else:
                    for j in range(count):
                        total += among[i, j] * kept[k, known[j]]
                spread += row * total
        if residual**2 < sigmas**2 * spread:
            if used < k:
                chosen[used], noise[used], innovations[used] = chosen[k], noise[k], innovations[k]
                for j in range(size):
                    kept[used, j] = kept[k, j]
                for j in range(cross_covariance.shape[1]):
                    cross_covariance[used, j] = cross_covariance[k, j]
            used += 1
        else:
            bad[k - used] = chosen[k]
    rejected = chosen.size - used
    return Gated(
        chosen[:used],
        bad[:rejected],
        kept[:used],
        cross_covariance[:used],
        innovations[:used],
        noise[:used],
    )


def update(covariance, columns, rows, innovations, variances):
    """The update in information form: with A = H^T R^-1 H, P loses P (I + A P)^-1 A P: eq. 18.

    What is exact stays as it is, and is left out.

    Args:
      covariance: P (n, n). columns: (C,) where the measured quantities are in it.
      rows: H (K, C). innovations: (K,). variances: (K,) diagonal of R.
    """
    live, places, to_all, information, vector, squares = _equations(
        covariance, columns, rows, innovations, variances
    )
    if not places.size:
        return Update(np.zeros(len(covariance)), covariance.copy(), squares)
    # BLAS takes columns: of arrays by rows it makes the transposed product.
    product = scipy.linalg.blas.dgemm
    left = product(1.0, to_all[:, places].T, information.T).T
    known = product(1.0, to_all.T, information.T).T
    left.flat[:: len(left) + 1] += 1.0  # On the diagonal.
    *_, solution, failed = scipy.linalg.lapack.dgesv(left, np.column_stack([vector, known]))
    if failed:
        raise np.linalg.LinAlgError("the information of the residuals has no inverse")
    both = product(1.0, solution, to_all.T, trans_a=1, trans_b=1).T
    return _subtracted(covariance, live, both, squares, vector, places)


@_compiled
def _equations(covariance, columns, rows, innovations, variances):
    """What `update` solves, without what is exact.

    Returns:
      Indices (L,) of what is not exact; places (M,) of what is measured among them; P (M, L), A
      (M, M), H^T R^-1 times the innovations (M,), and their square over R.
    """
    n, count = covariance.shape[0], 0
    live, place = np.empty(n, dtype=np.int64), np.empty(n, dtype=np.int64)
    for i in range(n):
        if covariance[i, i] > 0.0:
            live[count], place[i] = i, count
            count += 1
    size, measured = 0, np.empty(columns.size, dtype=np.int64)
    for j in range(columns.size):
        if covariance[columns[j], columns[j]] > 0.0:
            measured[size] = j
            size += 1
    information, vector = np.zeros((size, size)), np.zeros(size)
    squares = 0.0
    for k in range(innovations.size):
        weight = 1.0 / variances[k]
        squares += weight * innovations[k] ** 2
        for i in range(size):
            scaled = weight * rows[k, measured[i]]
            vector[i] += scaled * innovations[k]
            for j in range(i + 1):
                information[i, j] += scaled * rows[k, measured[j]]
    to_all, places = np.empty((size, count)), np.empty(size, dtype=np.int64)
    for i in range(size):
        places[i] = place[columns[measured[i]]]
        for j in range(i):
            information[j, i] = information[i, j]
        for j in range(count):
            to_all[i, j] = covariance[columns[measured[i]], live[j]]
    return live[:count], places, to_all, information, vector, squares


@_compiled
def _subtracted(covariance, live, both, squares, vector, places):
    """The `Update` by the step and the loss (L, 1 + L) that `update` has solved for."""
    moved, after = np.zeros(covariance.shape[0]), covariance.copy()
    for i in range(live.size):
        moved[live[i]] = both[i, 0]
        for j in range(i + 1):
            lost = 0.5 * (both[i, 1 + j] + both[j, 1 + i])
            now = covariance[live[i], live[j]] - lost
            after[live[i], live[j]] = after[live[j], live[i]] = now
    for i in range(places.size):
        squares -= vector[i] * both[places[i], 0]
    return Update(moved, after, squares)


@_compiled
def fit(columns, rows, innovations, before, after):
    """How well a correction explains its K residuals.

    Args:
      columns: (C,) where the measured quantities are among all. rows: (K, C) derivatives.
      innovations: (K,).
      before: (n,) place where the frame was linearised, less the prior's mean. after: (n,) the
        correction.

    Returns:
      Mean square of what the residuals change by from `before` to `after`, and of what is left.
    """
    changed, left = 0.0, 0.0
    for k in range(innovations.size):
        change, rest = 0.0, innovations[k]
        for j in range(columns.size):
            change += rows[k, j] * (after[columns[j]] - before[columns[j]])
            rest -= rows[k, j] * after[columns[j]]
        changed += change * change
        left += rest * rest
    return changed / innovations.size, left / innovations.size


@_compiled
def squared_deviation(covariance, columns, moved):
    """The square of a step (n,) of some quantities, over their covariance, which is in (n, n).

    Eq. 19. By Cholesky's decomposition, of a few rows, because numba takes long to compile a
    solver. What is known exactly, with variance 0, is left out.
    """
    count = columns.size
    root, white, total = np.zeros((count, count)), np.zeros(count), 0.0
    for i in range(count):
        step = moved[columns[i]]
        for j in range(i + 1):
            left = covariance[columns[i], columns[j]]
            for k in range(j):
                left -= root[i, k] * root[j, k]
            if j == i:
                root[i, i] = np.sqrt(left) if left > 0.0 else 0.0
            elif root[j, j] > 0.0:
                root[i, j] = left / root[j, j]
        for k in range(i):
            step -= root[i, k] * white[k]
        if root[i, i] > 0.0:
            white[i] = step / root[i, i]
            total += white[i] ** 2
    return total
