"""An axis-aligned ellipsoid about the origin: the keep-out zone, its normals and distances."""

from __future__ import annotations

import math

import numpy as np

from proxops.systems.common import Values, Vector3, Vectors3, kernel


@kernel(error_model="numpy")
def closest_point(semi_axes, point):
    """The point (3,) of the ellipsoid's surface nearest to `point` (3,), all in one length unit.

    Eberly, "Distance from a Point to an Ellipse, an Ellipsoid, or a Hyperellipsoid" (2013): the
    nearest point is a_i^2 y_i / (s + a_i^2) with s the greatest root of a function that is convex
    and falling to the right of its last pole. Bisection finds it to the last bit. Inside the
    ellipsoid, on the planes of symmetry, that form degenerates: there the coordinate along the
    shortest axis is moved off the plane by a rounding error.
    """
    shortest = 0  # By loops, here and below: whole arrays take numba seconds to compile.
    for i in range(3):
        if semi_axes[i] < semi_axes[shortest]:
            shortest = i
    scale = semi_axes[shortest]
    y, scaled, beyond, nearest = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    for i in range(3):
        axis = semi_axes[i]
        y[i] = abs(point[i])
        if i == shortest and y[i] < 1e-14 * scale:
            y[i] = 1e-14 * scale
        scaled[i] = (axis / scale) ** 2 * (y[i] / axis)
        # The pole of the shortest axis is the greatest. s is measured from there, so that it keeps
        # its digits close to the pole.
        beyond[i] = (axis - scale) * (axis + scale) / scale**2
    # g(s) = sum (scaled / (s + beyond))^2 - 1 changes sign in [low, high].
    low = y[shortest] / scale
    high = max(math.sqrt(scaled[0] ** 2 + scaled[1] ** 2 + scaled[2] ** 2), low)
    s = low
    for _ in range(200):
        s = 0.5 * (low + high)
        if s in (low, high):
            break
        total = 0.0
        for i in range(3):
            total += (scaled[i] / (s + beyond[i])) ** 2
        if total > 1.0:
            low = s
        else:
            high = s
    for i in range(3):
        nearest[i] = (semi_axes[i] / scale) ** 2 * y[i] / (s + beyond[i])
        if point[i] < 0.0:
            nearest[i] = -nearest[i]
    return nearest


@kernel(error_model="numpy", forceinline=True)
def squared_norm(semi_axes, point):
    """The square of |(x/a, y/b, z/c)| of a point (3,): below 1 inside, 1 on the surface."""
    total = 0.0
    for i in range(3):
        total += (point[i] / semi_axes[i]) ** 2
    return total


def ellipsoidal_norms(semi_axes: np.ndarray, points: Vectors3) -> np.ndarray:
    """|(x/a, y/b, z/c)| (N,) of points (N, 3): below 1 inside, 1 on the surface."""
    return np.linalg.norm(points / semi_axes, axis=1)


def clearances(semi_axes: Vector3, points: Vectors3) -> Values:
    """Signed Euclidean distances (N,) of points (N, 3) to the surface, negative inside."""
    return _clearances(semi_axes, np.ascontiguousarray(points))  # Others are compiled once more.


@kernel(error_model="numpy")
def _clearances(semi_axes, points):
    out = np.empty(len(points))
    for k in range(len(points)):
        nearest = closest_point(semi_axes, points[k])
        away = 0.0
        for i in range(3):
            away += (points[k, i] - nearest[i]) ** 2
        inside = squared_norm(semi_axes, points[k]) < 1.0
        out[k] = -math.sqrt(away) if inside else math.sqrt(away)
    return out


@kernel(error_model="numpy", forceinline=True)
def _fill_normal(semi_axes, place, normal):
    """Fills the outward unit normal (3,) at a place (3,) of the surface; it may be the place."""
    size = 0.0
    for i in range(3):
        normal[i] = place[i] / semi_axes[i] ** 2
        size += normal[i] ** 2
    for i in range(3):
        normal[i] /= math.sqrt(size)


@kernel(error_model="numpy")
def normal_below(semi_axes, point):
    """The unit normal (3,) below an outside point (3,); for an inside point, its direction."""
    if squared_norm(semi_axes, point) > 1.0:
        normal = closest_point(semi_axes, point)
        _fill_normal(semi_axes, normal, normal)
        return normal
    normal, square = point.copy(), 0.0
    for i in range(3):
        square += normal[i] ** 2
    for i in range(3):
        normal[i] /= math.sqrt(square)
    return normal


def outward_normals(semi_axes: np.ndarray, points: Vectors3) -> Vectors3:
    """Outward unit normals (N, 3), at points (N, 3), of the ellipsoids of these proportions."""
    normals = points / semi_axes**2
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    return normals


def tangent_half_spaces(semi_axes: Vector3, points: Vectors3) -> tuple[np.ndarray, np.ndarray]:
    """Half-spaces n.r >= b, one for each point, that touch the ellipsoid and lie outside it.

    For a point outside, the half-space touches the ellipsoid where the line from the origin to the
    point leaves it; for a point inside, at the nearest point of the surface.

    Args:
      semi_axes: (3,) in any unit of length. points: (N, 3) in the same unit.

    Returns:
      Unit normals (N, 3) and offsets (N,).
    """
    return _tangents(semi_axes, np.ascontiguousarray(points))


@kernel(error_model="numpy")
def _tangents(semi_axes, points):
    normals, offsets = np.empty(points.shape), np.zeros(points.shape[0])
    for k in range(offsets.size):
        point = points[k]
        norm = math.sqrt(squared_norm(semi_axes, point))
        touching = closest_point(semi_axes, point) if norm < 1.0 else point / norm
        _fill_normal(semi_axes, touching, normals[k])
        for i in range(3):
            offsets[k] += normals[k, i] * touching[i]
    return normals, offsets


def blocks_segment(semi_axes: np.ndarray, start: Vector3, end: Vector3) -> bool:
    """Whether the segment from start (3,) to end (3,) passes through the ellipsoid's inside."""
    a, d = start / semi_axes, (end - start) / semi_axes
    t = np.clip(-(a @ d) / (d @ d), 0.0, 1.0) if d @ d > 0 else 0.0
    return bool(np.sum((a + t * d) ** 2) < 1.0)
