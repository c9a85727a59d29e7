"""Polygons of mesh files, cut into triangles."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

# A corner may lie this share of the polygon's size off its plane: the quadrilaterals of a rough
# surface do.
_WARP = 0.03
_MOST_CORNERS = 200


def triangulated(
    vertices: np.ndarray, polygons: Sequence[Sequence[int]], where: Callable[[int], str]
) -> np.ndarray:
    """The triangles (F, 3) of polygons, in the order of the polygons.

    A polygon of n corners becomes n - 2 triangles with its winding: a fan from its first corner
    where that covers it once, else the best triangles of its plane.

    Args:
      vertices: (V, 3).
      polygons: of each its corners, as indices of vertices.
      where: says of the index of a polygon where it is in the file.

    Raises:
      ValueError: a polygon has fewer than three corners, names a vertex that is not there, is not
        planar, or crosses itself.
    """
    sizes = np.array([len(corners) for corners in polygons], dtype=np.int64)
    if (sizes < 3).any():
        raise ValueError(f"{where(int(np.argmax(sizes < 3)))}: a facet has fewer than 3 corners")
    ends = np.cumsum(sizes - 2)
    facets = np.empty((int(ends[-1]) if ends.size else 0, 3), dtype=np.int64)
    for size in np.unique(sizes):
        some = np.flatnonzero(sizes == size)
        corners = np.array([polygons[int(k)] for k in some], dtype=np.int64)
        strange = ((corners < 0) | (corners >= len(vertices))).any(axis=1)
        if strange.any():
            raise ValueError(
                f"{where(int(some[np.argmax(strange)]))}: a facet names a vertex that is not "
                f"there; there are {len(vertices)}"
            )
        rows = (ends[some] - (size - 2))[:, None] + np.arange(size - 2)
        middle = np.arange(1, size - 1)
        fan = np.stack([0 * middle, middle, middle + 1], axis=1)
        facets[rows] = corners[:, fan]
        if size == 3:
            continue
        points = vertices[corners]
        normals = _area_vectors(points)
        a, b, c = np.moveaxis(vertices[facets[rows]], 2, 0)
        parts = np.einsum("kfi,ki->kf", np.cross(b - a, c - a), normals)
        covered = (parts > 1e-9 * np.sum(normals**2, axis=1)[:, None]).all(axis=1)
        off = np.einsum("kci,ki->kc", points - points.mean(axis=1, keepdims=True), normals)
        lengths = np.linalg.norm(normals, axis=1) * np.ptp(points, axis=1).max(axis=1)
        flat = np.abs(off).max(axis=1) <= _WARP * lengths
        for k in np.flatnonzero(~covered | ~flat):
            try:
                facets[rows[k]] = corners[k][_in_plane(points[k], normals[k], bool(flat[k]))]
            except ValueError as error:
                raise ValueError(f"{where(int(some[k]))}: {error}") from error
    return facets


def _area_vectors(points: np.ndarray) -> np.ndarray:
    """Twice the area vectors (N, 3) of polygons (N, n, 3), by Newell's sums."""
    about = points - points.mean(axis=1, keepdims=True)
    return np.cross(about, np.roll(about, -1, axis=1)).sum(axis=1)


def _in_plane(points: np.ndarray, normal: np.ndarray, flat: bool) -> np.ndarray:
    """Triangles (n - 2, 3), as places in points (n, 3), that cover a polygon once.

    Raises:
      ValueError: the polygon is not planar, or no such triangles exist because it crosses itself.
    """
    if not normal.any():
        raise ValueError("a polygon has no area")
    if not flat:
        raise ValueError(
            "a polygon is not planar, so the file does not say which surface it is; split it into "
            "triangles"
        )
    if len(points) > _MOST_CORNERS:
        raise ValueError(f"a polygon that is not convex has over {_MOST_CORNERS} corners")
    free = np.ones((len(points),) * 2, dtype=bool)
    found = best_triangles(points / np.ptp(points, axis=0).max(), free, normal)
    if found is None:
        raise ValueError("a polygon crosses itself")
    return found


def best_triangles(
    points: np.ndarray, free: np.ndarray, normal: np.ndarray | None = None
) -> np.ndarray | None:
    """Triangles (n - 2, 3), as places in points, over a closed line of points (n, 3) of size 1.

    Of all triangulations without new points, the one with the least sum of (sum of squared
    sides)^2 / area, which avoids large and thin triangles. Dynamic programming over the parts of
    the line finds it (Klincsek, Annals of Discrete Math. 9 (1980) 121).

    Args:
      points: in the order of the winding.
      free: (n, n) whether a triangle may have the side from one point to the other.
      normal: (3,) if given, each triangle must turn to this side. Those of a planar line then cover
        its inside once.

    Returns:
      None if there is no such triangulation.
    """
    n = len(points)
    cost = np.zeros((n, n))
    apex = np.zeros((n, n), dtype=int)
    for length in range(2, n):
        for i in range(n - length):
            k = i + length
            middle = np.arange(i + 1, k)
            tried = cost[i, middle] + cost[middle, k] + _costs(points, i, middle, k, normal)
            best = int(np.argmin(tried))
            cost[i, k] = tried[best] if free[i, k] else np.inf
            apex[i, k] = middle[best]
    if not np.isfinite(cost[0, n - 1]):
        return None
    found, stretches = [], [(0, n - 1)]
    while stretches:
        i, k = stretches.pop()
        if k - i >= 2:
            j = int(apex[i, k])
            found.append([i, j, k])
            stretches += [(i, j), (j, k)]
    return np.array(found)


def _costs(
    points: np.ndarray, i: int, middle: np.ndarray, k: int, normal: np.ndarray | None
) -> np.ndarray:
    a, b, c = points[i], points[middle], points[k]
    across = np.cross(b - a, c - a)
    squares = np.sum((b - a) ** 2, axis=1) + np.sum((c - b) ** 2, axis=1) + np.sum((a - c) ** 2)
    # A facet without area is expensive but possible: it closes a crack and is removed later.
    costs = squares**2 / (0.5 * np.linalg.norm(across, axis=1) + 1e-9 * squares)
    if normal is None:
        return costs
    turned = across @ normal / np.linalg.norm(normal)
    return np.where(turned < -1e-12, np.inf, costs)
