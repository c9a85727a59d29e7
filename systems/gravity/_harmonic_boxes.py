"""Makes the boxes of a `TabulatedField`: harmonic polynomials, fitted to a field and checked."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache
from typing import NamedTuple

import numpy as np

from proxops.systems.gravity import _table_kernel as kernel

DEGREE = 16
"""Degree of the polynomials; the page on gravity compares others."""

# Chebyshev nodes along each edge of a face, for the fit. With potential, acceleration and gradient
# there are then two to three independent numbers for each coefficient.
_NODES = 4
# A box is good if its error where it is checked is below this share of the bound. A harmonic error
# is greatest on the surface, and that of a truncated series in the corners, which are checked.
_SHARE = 0.5
# Random points on a box's surface where it is checked, besides its corners.
_CHECKS = 12
# A box's part of the cube's edge is at least 2 to the power of minus this.
_DEEPEST = 14
# Coefficients of all boxes together, at most: 60 MB.
_MOST_NUMBERS = 7_500_000

Evaluate = Callable[[np.ndarray], np.ndarray]
"""Gives the columns (N, 14) of the exact kernel at points (N, 3)."""


class Boxes(NamedTuple):
    """An octree about the origin; see `_table_kernel`."""

    children: np.ndarray
    """(K, 8) int32, of each node: the node of a child, -2 - i for box i, or -1 for no box."""
    boxes: np.ndarray
    """(B, 4): centre in m, and 1 over the half edge."""
    coefficients: np.ndarray
    """(B, C, 2): real and imaginary part."""


def make_boxes(evaluate: Evaluate, semi_axes: np.ndarray, half: float, error: float) -> Boxes:
    """Divides a cube until every box outside the ellipsoid has a relative error below the bound.

    A cell of the octree that the ellipsoid cuts gets the smallest box that contains the part
    outside, and that box lies as far out as it can. Cells that would take too much memory or are
    too small have no box.

    Args:
      evaluate: the exact field.
      semi_axes: (3,) in m. half: half of the cube's edge in m.
      error: the bound, for potential and acceleration.
    """
    octants = np.array(list(np.ndindex(2, 2, 2))) - 0.5
    numbers = 2 * entries(DEGREE)
    children = [np.full((1, 8), -1, dtype=np.int32)]
    boxes, coefficients = [np.empty((0, 4))], [np.empty((0, entries(DEGREE), 2))]
    centres, nodes, made = np.zeros((1, 3)), 1, 0
    for _ in range(_DEEPEST):
        half *= 0.5
        cells = (centres[:, None] + 2.0 * half * octants).reshape(-1, 3)
        entry = np.full(len(cells), -1, dtype=np.int32)
        some = np.sum(((np.abs(cells) + half) / semi_axes) ** 2, axis=1) > 1.0
        # No cell sticks out, or the table would be too large.
        if not some.any() or (made + np.count_nonzero(some)) * numbers > _MOST_NUMBERS:
            break
        places, halves = _outer_boxes(cells[some], half, semi_axes)
        fitted, errors = _fit(evaluate, places, halves)
        good = errors <= _SHARE * error
        boxes.append(np.column_stack([places, 1.0 / halves])[good])
        coefficients.append(fitted[good])
        which = np.flatnonzero(some)
        entry[which[good]] = -2 - made - np.arange(np.count_nonzero(good))
        made += np.count_nonzero(good)
        entry[which[~good]] = nodes + np.arange(np.count_nonzero(~good))
        children[-1] = entry.reshape(-1, 8)
        centres = cells[which[~good]]
        if len(centres) == 0:
            break
        nodes += len(centres)
        children.append(np.full((len(centres), 8), -1, dtype=np.int32))
    return Boxes(np.concatenate(children), np.concatenate(boxes), np.concatenate(coefficients))


def recursion(degree: int) -> np.ndarray:
    """Factors (C, 2) of z and r^2 in the step from T_nm to T_(n+1)m; see `_table_kernel`."""
    m, n, _ = _columns(degree)
    under = ((n + 1.0) ** 2 - m**2).clip(1.0)
    return np.column_stack([(2.0 * n + 1.0) / under, 1.0 / under])


def entries(degree: int) -> int:
    """The number of entries C of a box."""
    return (degree + 3) * (degree + 4) // 2


def _columns(degree: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Order m, degree n, and whether it is used, of each entry (C,) of a box."""
    pairs = [(m, n) for m in range(degree + 3) for n in range(m, degree + 3)]
    m, n = np.array(pairs).T
    return m, n, n <= degree


def _outer_boxes(
    cells: np.ndarray, half: float, semi_axes: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Centres (N, 3) and half edges (N,) of boxes for what the ellipsoid leaves of cells (N, 3)."""
    sign = np.where(cells >= 0.0, 1.0, -1.0)
    low, high = np.abs(cells) - half, np.abs(cells) + half
    squares = (high / semi_axes) ** 2
    others = squares.sum(axis=1, keepdims=True) - squares
    low = np.maximum(low, semi_axes * np.sqrt(np.maximum(1.0 - others, 0.0)))
    halves = 0.5 * (high - low).max(axis=1)
    return sign * (low + halves[:, None]), halves


def _fit(
    evaluate: Evaluate, places: np.ndarray, halves: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Coefficients (N, C, 2) of boxes and their greatest relative error (N,) where checked."""
    points, inverse = _inverse()
    wanted = _samples(evaluate, places, halves, points)
    # Summed by einsum and not by BLAS, so that the last bits do not depend on the threads.
    short = np.einsum("br,rc->bc", wanted[:, :, :10].reshape(len(places), -1), inverse)
    coefficients = _spread(short)
    checks = _checks()
    wanted = _samples(evaluate, places, halves, checks)[:, :, :4]
    found = np.empty((len(places), len(checks), 14))
    kernel.expand(checks, coefficients, recursion(DEGREE), DEGREE, found)
    off = found[:, :, :4] - wanted
    potential = np.abs(off[:, :, 0]) / np.abs(wanted[:, :, 0])
    acceleration = np.linalg.norm(off[:, :, 1:], axis=2) / np.linalg.norm(wanted[:, :, 1:], axis=2)
    return coefficients, np.maximum(potential, acceleration).max(axis=1)


def _samples(
    evaluate: Evaluate, places: np.ndarray, halves: np.ndarray, points: np.ndarray
) -> np.ndarray:
    """The numbers (N, P, 10) that a fit uses, in each box's units, at its points (P, 3)."""
    found = evaluate((places[:, None] + halves[:, None, None] * points).reshape(-1, 3))
    found = found.reshape(len(places), len(points), 14)
    h = halves[:, None, None]
    return np.concatenate(
        [found[:, :, :1], h * found[:, :, 1:4], h**2 * found[:, :, [4, 5, 6, 8, 9, 12]]], axis=2
    )


def _spread(short: np.ndarray) -> np.ndarray:
    """Coefficients (N, C, 2) from their (p + 1)^2 free numbers (N, (p + 1)^2)."""
    m, n, used = _columns(DEGREE)
    factorial = np.array([math.factorial(k) for k in range(2 * DEGREE + 1)], dtype=float)
    # Harmonics of size about 1 in the corners.
    size = np.zeros(len(m))
    m, n = m[used], n[used]
    size[used] = np.sqrt(factorial[n + m] * factorial[n - m]) / 3.0 ** (0.5 * n)
    real, imaginary = np.flatnonzero(used), np.flatnonzero(used)[m > 0]
    wide = np.zeros((len(short), len(size), 2))
    wide[:, real, 0] = short[:, : len(real)] * size[real]
    wide[:, imaginary, 1] = short[:, len(real) :] * size[imaginary]
    return wide


@cache
def _inverse() -> tuple[np.ndarray, np.ndarray]:
    """The points (P, 3) of the fit on a box's surface, and the pseudo-inverse (10 P, (p + 1)^2)."""
    nodes = np.cos(np.pi * (np.arange(_NODES) + 0.5) / _NODES)
    face = np.array([(a, b, s) for s in (-1.0, 1.0) for a in nodes for b in nodes])
    points = np.concatenate([np.roll(face, k, axis=1) for k in range(3)])
    count = (DEGREE + 1) ** 2
    found = np.empty((count, len(points), 14))
    kernel.expand(points, _spread(np.eye(count)), recursion(DEGREE), DEGREE, found)
    basis = found[:, :, [0, 1, 2, 3, 4, 5, 6, 8, 9, 12]].reshape(count, -1)
    return points, _pseudo_inverse(basis)


def _pseudo_inverse(rows: np.ndarray) -> np.ndarray:
    """X (R, C) with rows @ X = 1, in the span of rows (C, R), by Gram and Schmidt, twice.

    Not by LAPACK, whose last bits depend on the number of threads.
    """
    direction, combination = rows.copy(), np.eye(len(rows))
    for k in range(len(rows)):
        for _ in range(2):
            along = np.einsum("ir,r->i", direction[:k], direction[k])
            direction[k] -= np.einsum("i,ir->r", along, direction[:k])
            combination[k] -= np.einsum("i,ij->j", along, combination[:k])
        length = math.sqrt(float(np.einsum("r,r->", direction[k], direction[k])))
        direction[k] /= length
        combination[k] /= length
    return np.einsum("kr,kc->rc", direction, combination)


@cache
def _checks() -> np.ndarray:
    """Points (N, 3) on a box's surface that the fit does not use."""
    random = np.random.default_rng(1)
    points = random.uniform(-1.0, 1.0, (_CHECKS, 3))
    faces = np.arange(_CHECKS) % 3
    points[np.arange(_CHECKS), faces] = np.where(np.arange(_CHECKS) % 2 == 0, 1.0, -1.0)
    return np.concatenate([2.0 * np.array(list(np.ndindex(2, 2, 2))) - 1.0, points])
