"""`halves`: a body cut by a plane into two closed bodies."""

from __future__ import annotations

import numpy as np

from proxops.systems.common import InputError
from proxops.systems.shapes.mesh_checks import flat_facets, shell_labels, six_volumes
from proxops.systems.shapes.polyhedron import Polyhedron

# Shares of the body's length. A vertex nearer to the plane than the first would leave slivers
# without area; then the plane moves, by the second at most.
_CLEAR = 1e-5
_MOST_SHIFT = 1e-4


def halves(shape: Polyhedron, axis: int, at: float) -> tuple[Polyhedron, Polyhedron]:
    """The two parts of a body below and above the plane where the coordinate `axis` is `at`.

    Facets across the plane are split on it, so both parts together are the body to rounding. The
    cut of each part is closed by triangles from one point to all its edges. Where the cut is not
    star-shaped some of them overlap with opposite signs; volumes, moments and gravity are exact
    all the same, because they are sums over signed triangles.

    If a vertex is closer to the plane than 1e-5 of the body's length, the plane moves to the
    widest gap between vertices within 1e-4 of the length.

    Args:
      shape: the body. axis: 0, 1 or 2. at: coordinate of the plane in m.

    Raises:
      InputError: there is no such axis, the plane misses the body, or the body has voids.
    """
    if axis not in (0, 1, 2):
        raise InputError(f"axis must be 0, 1 or 2, got {axis}")
    places = shape.vertices[:, axis]
    low, high = places.min(), places.max()
    if not low < at < high:
        raise InputError(
            f"the plane at {at:.6g} m along axis {axis} does not cut {shape.name}, which reaches "
            f"from {low:.6g} to {high:.6g} m"
        )
    count, labels = shell_labels(shape.facets, len(shape.vertices))
    six = six_volumes(shape.vertices, shape.facets)
    if (np.bincount(labels, six, count) < 0.0).any():
        raise InputError(f"{shape.name} has a void inside; only a body without voids can be cut")
    plane = _clear_place(places, float(at))
    vertices, facets, segments = _split(shape, axis, plane)
    upper = vertices[facets].mean(axis=1)[:, axis] > plane
    return (
        _closed(vertices, facets[~upper], segments, axis, f"{shape.name} (lower part)"),
        _closed(vertices, facets[upper], segments[:, ::-1], axis, f"{shape.name} (upper part)"),
    )


def _clear_place(places: np.ndarray, at: float) -> float:
    """The coordinate nearest to `at` that is clear of the vertices' coordinates (V,)."""
    size = np.ptp(places)
    if np.abs(places - at).min() > _CLEAR * size:
        return at
    ends = np.array(
        [max(at - _MOST_SHIFT * size, places.min()), min(at + _MOST_SHIFT * size, places.max())]
    )
    between = places[(places > ends[0]) & (places < ends[1])]
    marks = np.sort(np.r_[ends, between])
    widest = int(np.argmax(np.diff(marks)))
    return float(marks[widest : widest + 2].mean())


def _split(shape: Polyhedron, axis: int, at: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The mesh with the facets across the plane split on it; no vertex may be on the plane.

    Returns:
      Vertices (V + C, 3); facets, each on one side; the cut's segments (C, 2) as indices of
      vertices, in the direction in which the lower side's facets run along them.
    """
    above = shape.vertices[:, axis] > at
    sides = above[shape.facets]
    across = sides.any(axis=1) & ~sides.all(axis=1)
    facets, sides = shape.facets[across], sides[across]
    # Rotates each facet so that its first corner is the one that is alone on its side.
    alone_above = sides.sum(axis=1) == 1
    first = np.argmax(sides == alone_above[:, None], axis=1)
    a, b, c = np.take_along_axis(facets, (first[:, None] + np.arange(3)) % 3, axis=1).T
    count = len(shape.vertices)
    ends = np.sort(np.concatenate([np.stack([a, b], 1), np.stack([c, a], 1)]), axis=1)
    keys, places = np.unique(ends[:, 0] * count + ends[:, 1], return_inverse=True)
    p, q = np.split(count + places, 2)
    one, other = shape.vertices[keys // count], shape.vertices[keys % count]
    share = (at - one[:, axis]) / (other[:, axis] - one[:, axis])
    cuts = one + share[:, None] * (other - one)
    cuts[:, axis] = at
    pieces = [np.stack(corners, axis=1) for corners in ((a, p, q), (p, b, c), (p, c, q))]
    # The tip a, p, q runs from p to q, and the rest from q to p.
    segments = np.where(alone_above[:, None], np.stack([q, p], 1), np.stack([p, q], 1))
    vertices = np.vstack([shape.vertices, cuts])
    return vertices, np.concatenate([shape.facets[~across], *pieces]), segments


def _closed(
    vertices: np.ndarray, facets: np.ndarray, segments: np.ndarray, axis: int, name: str
) -> Polyhedron:
    """One side's facets and, for each of its shells, a fan over its segments.

    All cuts of a shell have one apex: two of them may be rings about the same centre.
    """
    count, labels = shell_labels(facets, len(vertices))
    of_vertex = np.empty(len(vertices), dtype=int)
    of_vertex[facets] = labels[:, None]
    shells = of_vertex[segments[:, 0]]
    fans, apexes = [], []
    for shell in range(count):
        rim = segments[shells == shell]
        if not len(rim):
            continue  # A shell that the plane misses.
        index = len(vertices) + len(apexes)
        fans.append(np.column_stack([rim[:, 1], rim[:, 0], np.full(len(rim), index)]))
        apexes.append(_apex(vertices, rim, axis))
    vertices = np.vstack([vertices, *apexes])
    used, renumbered = np.unique(np.concatenate([facets, *fans]), return_inverse=True)
    return Polyhedron(vertices[used], renumbered.reshape(-1, 3), name)


def _apex(vertices: np.ndarray, rim: np.ndarray, axis: int) -> np.ndarray:
    """A point of the plane (3,) near the middle of a cut, on the line of none of its segments."""
    start, end = vertices[rim[:, 0]], vertices[rim[:, 1]]
    lengths = np.linalg.norm(end - start, axis=1)
    middle = lengths @ (start + end) / (2.0 * lengths.sum())
    middle[axis] = start[0, axis]
    spread = np.ptp(start, axis=0)
    fan = np.column_stack([rim, np.full(len(rim), len(vertices))])
    apex = middle
    for k in range(8):
        apex = middle + 0.03 * k * spread * np.roll([0.0, np.cos(k), np.sin(k)], axis)
        if not flat_facets(np.vstack([vertices, apex]), fan).size:
            break
    return apex
