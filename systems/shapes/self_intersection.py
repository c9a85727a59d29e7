"""Self-intersection of a mesh: facets that meet elsewhere than at their common vertices and edges.

The decisions are exact. Signs of determinants come from float64 arithmetic where its error bound is
small enough, otherwise from integers of any length: every float64 is an integer times a power of
two.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from proxops.systems.common import InputError, Values, Vectors3, kernel
from proxops.systems.shapes.mesh_checks import area_vectors

# Relative error bounds of the plain determinants below: Shewchuk, "Adaptive Precision
# Floating-Point Arithmetic and Fast Robust Geometric Predicates" (1997), doubled for safety.
_BOUND_3 = 2.0 * (7.0 + 56.0 * np.finfo(float).eps / 2.0) * np.finfo(float).eps / 2.0
_BOUND_2 = 2.0 * (3.0 + 16.0 * np.finfo(float).eps / 2.0) * np.finfo(float).eps / 2.0
# Most pairs that may be close together: the greater of this and the next, times the facets.
_MOST_PAIRS = 20_000_000
_MOST_EACH = 40
# Pairs tested at a time, so that memory does not grow with the mesh.
_BLOCK = 500_000


def self_intersections(vertices: Vectors3, facets: Vectors3) -> np.ndarray:
    """Pairs (N, 2) of facets, the lesser index first, that meet where they should not.

    Facets without a common vertex must not meet at all. Facets with one common vertex may meet only
    there; with two, only along that edge. Facets with the same three vertices count as meeting. The
    mesh must have no facets without area.

    Args:
      vertices: (V, 3), all finite. facets: (F, 3).

    Raises:
      InputError: over 20 million pairs of facets, and over 40 for each facet, are close together.
    """
    corners = vertices[facets]
    low, high = corners.min(axis=1), corners.max(axis=1)
    axis = int(np.argmax(np.ptp(vertices, axis=0)))
    order = np.argsort(low[:, axis], kind="stable")
    roll = [axis, (axis + 1) % 3, (axis + 2) % 3]
    most = max(_MOST_PAIRS, _MOST_EACH * len(facets))
    boxes = _overlaps(low[order][:, roll], high[order][:, roll], most)
    if len(boxes) == most:
        raise InputError(
            f"the mesh is a tangle: over {most / 1e6:.0f} million pairs of facets are close to "
            "each other"
        )
    pairs = np.sort(order[boxes])
    numbers = _Numbers(vertices)
    blocks = range(0, len(pairs), _BLOCK)
    found = [_meeting(numbers, facets, pairs[start : start + _BLOCK]) for start in blocks]
    met = np.concatenate(found) if found else pairs
    return met[np.lexsort(met.T[::-1])]


def _meeting(numbers: _Numbers, facets: np.ndarray, pairs: np.ndarray) -> np.ndarray:
    """Those of pairs (N, 2) of facets that meet where they should not."""
    # For each pair, which corners of the two facets are the same vertex.
    equal = facets[pairs[:, 0], :, None] == facets[pairs[:, 1], None, :]
    common = equal.sum(axis=(1, 2))
    meet = common == 3
    for shared in range(3):
        some = np.flatnonzero(common == shared)
        first, second = facets[pairs[some, 0]], facets[pairs[some, 1]]
        if shared:
            first = _put_last(first, equal[some].any(axis=2), shared)
            second = _put_last(second, equal[some].any(axis=1), shared)
        if shared == 2:
            meet[some] = _fold_onto(numbers, first, second)
        else:
            meet[some] = _meet(numbers, first, second, (0,) if shared else (0, 1, 2))
    return pairs[meet]


@kernel
def _overlaps(low, high, most):
    """Pairs (N, 2) of boxes (n, 3) that overlap, sorted by their low ends along the first axis."""
    room = 1024
    pairs = np.empty((room, 2), dtype=np.int64)
    count = 0
    for i in range(len(low)):
        for j in range(i + 1, len(low)):
            if low[j, 0] > high[i, 0]:
                break
            if low[j, 1] > high[i, 1] or low[i, 1] > high[j, 1]:
                continue
            if low[j, 2] > high[i, 2] or low[i, 2] > high[j, 2]:
                continue
            if count == room:
                room *= 2
                longer = np.empty((room, 2), dtype=np.int64)
                for k in range(count):  # A slice on the left takes seconds to compile.
                    longer[k, 0], longer[k, 1] = pairs[k, 0], pairs[k, 1]
                pairs = longer
            pairs[count, 0], pairs[count, 1] = i, j
            count += 1
            if count == most:
                return pairs[:count]
    return pairs[:count]


def _put_last(facets: np.ndarray, shared: np.ndarray, count: int) -> np.ndarray:
    """Rotates the corners of facets (N, 3) so that the `count` shared corners are last."""
    start = np.argmax(shared, axis=1) if count == 1 else np.argmin(shared, axis=1) + 1
    shift = (start + count) % 3
    return np.take_along_axis(facets, (shift[:, None] + np.arange(3)) % 3, axis=1)


class _Numbers:
    """Exact signs of the orientation of vertices, which are given by their indices."""

    def __init__(self, vertices: np.ndarray):
        self.floats = vertices
        mantissa, exponent = np.frexp(vertices)
        whole = np.ldexp(mantissa, 53).astype(np.int64).astype(object)
        used = exponent[mantissa != 0.0]
        lowest = used.min() if used.size else 0
        self._wholes = whole << np.where(mantissa != 0.0, exponent - lowest, 0).astype(object)

    def side(self, a, b, c, d) -> Values:
        """On which side of the plane of a, b, c the vertex d is.

        Args:
          a, b, c, d: indices of vertices (N,).

        Returns:
          Signs (N,) int of det(a - d, b - d, c - d).
        """
        corners = [self.floats[k] for k in (a, b, c, d)]
        value, size = _determinant_3(*corners)
        unsure = np.flatnonzero(np.abs(value) <= _BOUND_3 * size)
        signs = np.sign(value).astype(int)
        if unsure.size:
            exact, _ = _determinant_3(*(self._wholes[k[unsure]] for k in (a, b, c, d)))
            signs[unsure] = _signs(exact)
        return signs

    def turn(self, drop: Values, a, b, c) -> Values:
        """Signs (N,) int of the turn from a over b to c, seen along the axis `drop` (N,)."""
        keep = np.stack([(drop + 1) % 3, (drop + 2) % 3], axis=1)
        flat = [np.take_along_axis(self.floats[k], keep, axis=1) for k in (a, b, c)]
        value, size = _determinant_2(*flat)
        unsure = np.flatnonzero(np.abs(value) <= _BOUND_2 * size)
        signs = np.sign(value).astype(int)
        if unsure.size:
            rows, columns = [k[unsure] for k in (a, b, c)], keep[unsure]
            exact, _ = _determinant_2(*(self._wholes[row[:, None], columns] for row in rows))
            signs[unsure] = _signs(exact)
        return signs


def _determinant_3(a, b, c, d):
    """det(a - d, b - d, c - d) for rows (N, 3), and the sum of its terms' sizes."""
    (ax, ay, az), (bx, by, bz), (cx, cy, cz) = ((p - d).T for p in (a, b, c))
    terms = ((ax, by * cz, bz * cy), (bx, cy * az, cz * ay), (cx, ay * bz, az * by))
    values = [x * (plus - minus) for x, plus, minus in terms]
    sizes = [abs(x) * (abs(plus) + abs(minus)) for x, plus, minus in terms]
    return values[0] + values[1] + values[2], sizes[0] + sizes[1] + sizes[2]


def _determinant_2(a, b, c):
    """det(a - c, b - c) for rows (N, 2), and the sum of its terms' sizes."""
    (ax, ay), (bx, by) = (a - c).T, (b - c).T
    return ax * by - ay * bx, abs(ax * by) + abs(ay * bx)


def _signs(wholes: np.ndarray) -> np.ndarray:
    return (wholes > 0).astype(int) - (wholes < 0).astype(int)


def _meet(
    numbers: _Numbers, first: np.ndarray, second: np.ndarray, edges: Sequence[int]
) -> np.ndarray:
    """Whether triangles (N, 3) have a point in common, other than a last vertex that they share.

    If two triangles in different planes do, an edge of one meets the other. It is one of `edges`,
    which run from the corners of these numbers to the next: all, or the one opposite to the vertex.
    """
    meet = np.zeros(len(first), dtype=bool)
    for one, other in ((first, second), (second, first)):
        for k in edges:
            rest = np.flatnonzero(~meet)
            meet[rest] = _edge_meets(numbers, one[rest, k], one[rest, (k + 1) % 3], other[rest])
    rest = np.flatnonzero(~meet)
    same = rest[_in_plane(numbers, first[rest], second[rest])]
    drop = _thin_axis(numbers, first[same])
    for one, other in ((first[same], second[same]), (second[same], first[same])):
        for k in edges:
            ends = one[:, k], one[:, (k + 1) % 3]
            meet[same] |= _edge_meets_in_plane(numbers, drop, *ends, other)
    return meet


def _fold_onto(numbers: _Numbers, first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Whether triangles (N, 3) whose last two vertices are common overlap."""
    meet = numbers.side(first[:, 0], first[:, 1], first[:, 2], second[:, 0]) == 0
    some = np.flatnonzero(meet)
    drop = _thin_axis(numbers, first[some])
    a, b = first[some, 1], first[some, 2]
    sides = [numbers.turn(drop, a, b, facets[some, 0]) for facets in (first, second)]
    meet[some] = sides[0] == sides[1]
    return meet


def _edge_meets(numbers: _Numbers, p, q, facets: np.ndarray) -> np.ndarray:
    """Whether segments p q (N,) that are not in their triangle's plane meet it, rim included."""
    a, b, c = facets.T
    side_p, side_q = numbers.side(a, b, c, p), numbers.side(a, b, c, q)
    meet = (side_p * side_q <= 0) & ((side_p != 0) | (side_q != 0))
    some = np.flatnonzero(meet)
    p, q, a, b, c = (k[some] for k in (p, q, a, b, c))
    turns = np.stack([numbers.side(p, q, *pair) for pair in ((a, b), (b, c), (c, a))])
    meet[some] = ~((turns > 0).any(axis=0) & (turns < 0).any(axis=0))
    return meet


def _in_plane(numbers: _Numbers, first: np.ndarray, second: np.ndarray) -> np.ndarray:
    a, b, c = first.T
    sides = [numbers.side(a, b, c, corner) for corner in second.T]
    return (np.stack(sides) == 0).all(axis=0)


def _thin_axis(numbers: _Numbers, facets: np.ndarray) -> np.ndarray:
    """The axis (N,) along which the projection of each triangle is largest."""
    return np.argmax(np.abs(area_vectors(numbers.floats, facets)), axis=1)


def _edge_meets_in_plane(numbers: _Numbers, drop, p, q, facets: np.ndarray) -> np.ndarray:
    """Whether segments p q (N,) in the plane of their triangle meet it, rim included."""
    meet = np.zeros(len(p), dtype=bool)
    for end in (p, q):
        turns = np.stack(
            [numbers.turn(drop, facets[:, k], facets[:, (k + 1) % 3], end) for k in range(3)]
        )
        meet |= ~((turns > 0).any(axis=0) & (turns < 0).any(axis=0))
    for k in range(3):
        a, b = facets[:, k], facets[:, (k + 1) % 3]
        split = numbers.turn(drop, p, q, a) * numbers.turn(drop, p, q, b) < 0
        meet |= split & (numbers.turn(drop, a, b, p) * numbers.turn(drop, a, b, q) < 0)
    return meet
