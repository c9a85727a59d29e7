"""Compiled kernels: how the ranges of a frame depend on what the navigation estimates.

A ray from p along the unit vector d (K) meets a facet of unit normal n at the distance r. With
q = |n.d|, the residual is q times the difference of the measured range and the predicted one: eq.
11 to 14 of docs/method/equations.md.
"""

import math
from typing import NamedTuple

import numpy as np

from proxops.systems.common import kernel, turned_vector
from proxops.systems.navigation.estimate import MEASURED

# Rays that meet the surface at a flatter angle (cosine of the incidence) are not used: there the
# range changes too fast with everything.
FLATTEST = 0.05
_HEAD = MEASURED.size
# A beam on an edge between two facets does not read what it would read on one plane. The error is
# this share of what the beam's width changes the range by.
_EDGES = 0.25
# Sums may be taken in any order, so that they run on vector units.
_ANY_ORDER = {"reassoc", "contract"}


class Rays(NamedTuple):
    """K rays of a frame."""

    indices: np.ndarray
    """(K,) int: in the frame."""
    directions: np.ndarray
    """(K, 3) in K."""


class Surface(NamedTuple):
    """The map, and the shapes that its error has."""

    normals: np.ndarray
    """(F, 3) of all facets."""
    corners: np.ndarray
    """(F, 3) int: their vertices."""
    table: np.ndarray
    """(V, M): displacement of each vertex, in m, by each coefficient of the map's error."""


class RangeErrors(NamedTuple):
    """Errors of ranges that are not estimated."""

    sigma: float
    """Of the range noise, in m."""
    rest: float
    """Variance in m^2 of the surface beyond the coefficients."""
    beam: float
    """Half of the angle of the beams in rad, as far as it may be."""


class Comparison(NamedTuple):
    """A measured frame beside the one that the map predicts, for the K rays that both have."""

    rays: np.ndarray
    """(K,) int: index of the ray in the frame."""
    residuals: np.ndarray
    """(K,) in m: measured less predicted range, times the cosine of the incidence."""
    variances: np.ndarray
    """(K,) in m^2: of the residuals if the estimate were true; +inf for rays not to be used."""
    rows: np.ndarray
    """(K, 10 + M): derivative of the residuals in the order of `MEASURED` and coefficients."""


@kernel(error_model="numpy")
def returned_rays(ranges, farthest, rotation, directions):
    """The K rays of a frame that returned, turned into K.

    Args:
      ranges: (N,) in m. farthest: a longer range is none.
      rotation: R_KS (3, 3). directions: (N, 3) of all rays in S.

    Returns:
      `Rays`.
    """
    count = 0
    for ray in range(ranges.size):
        if ranges[ray] < farthest:
            count += 1
    rays, turned = np.empty(count, dtype=np.int64), np.empty((count, 3))
    k = 0
    for ray in range(ranges.size):
        if ranges[ray] < farthest:
            rays[k] = ray
            x, y, z = directions[ray, 0], directions[ray, 1], directions[ray, 2]
            turned[k, 0], turned[k, 1], turned[k, 2] = turned_vector(rotation, x, y, z)
            k += 1
    return Rays(rays, turned)


@kernel(error_model="numpy", fastmath=_ANY_ORDER)
def raised_origins(position, seen, hits, surface, coefficients):
    """Where rays begin to meet the map as they would, from a position, a surface farther out.

    It is raised along the normals: by as much as at the point of the map that the ray meets.

    Args:
      position: (3,) in m in K. seen: N `Rays`. hits: their `FirstHits` from there.
      surface: a `Surface`. coefficients: (M,) of its error.

    Returns:
      For the K of N rays that meet the map: `Rays`, origins (K, 3) in m, and heights (K,) in m.
    """
    rays, directions = seen
    _, facets, places = hits
    normals, corners, table = surface
    count, modes = 0, coefficients.size
    some, along = np.empty_like(rays), np.empty_like(directions)
    origins, heights = np.empty_like(directions), np.empty(rays.size)
    for i in range(rays.size):
        facet = facets[i]
        if facet < 0:
            continue
        u, v = places[i, 0], places[i, 1]
        a, b, c = corners[facet, 0], corners[facet, 1], corners[facet, 2]
        height = 0.0
        for m in range(modes):
            one = (1.0 - u - v) * table[a, m] + u * table[b, m] + v * table[c, m]
            height += one * coefficients[m]
        for j in range(3):
            along[count, j] = directions[i, j]
            origins[count, j] = position[j] - height * normals[facet, j]
        some[count], heights[count] = rays[i], height
        count += 1
    return Rays(some[:count], along[:count]), origins[:count], heights[:count]


@kernel(error_model="numpy", fastmath=_ANY_ORDER)
def rows_of_frame(position, seen, hits, heights, ranges, surface, believed):
    """Residuals and their derivatives for the K of N rays whose predictions meet the body.

    Eq. 11 to 14.

    Args:
      position: (3,) in m in K. seen: N `Rays`. hits: their predicted `FirstHits`.
      heights: (N,) in m: how far out the surface is in their distances already.
      ranges: the frame as measured, in m.
      surface: a `Surface`.
      believed: (4 + M,) size, bias, scale error and half beam, and the coefficients of the map's
        error; and `RangeErrors`.

    Returns:
      A `Comparison`. Of rays that are too flat, the variance is +inf and the rest 0.
    """
    rays, directions = seen
    found, facets, places = hits
    normals, corners, table = surface
    mean, (sigma, rest, beam) = believed
    count, modes = 0, table.shape[1]
    for i in range(facets.size):
        if facets[i] >= 0:
            count += 1
    met, rows = np.empty(count, dtype=np.int64), np.zeros((count, _HEAD + modes))
    residuals, variances = np.zeros(count), np.full(count, np.inf)
    size, bias, scale, half = mean[0], mean[1], mean[2], mean[3]
    k = -1
    for i in range(facets.size):
        facet = facets[i]
        if facet < 0:
            continue
        k += 1
        met[k] = rays[i]
        dx, dy, dz = directions[i, 0], directions[i, 1], directions[i, 2]
        nx, ny, nz = normals[facet, 0], normals[facet, 1], normals[facet, 2]
        r = found[i]
        q = -(nx * dx + ny * dy + nz * dz)
        if q < FLATTEST:
            continue
        slant = math.sqrt(max(1.0 - q * q, 0.0))
        px, py, pz = position[0] + r * dx, position[1] + r * dy, position[2] + r * dz
        level = nx * px + ny * py + nz * pz
        out = -heights[i]
        u, v = places[i, 0], places[i, 1]
        a, b, c = corners[facet, 0], corners[facet, 1], corners[facet, 2]
        for m in range(modes):
            height = (1.0 - u - v) * table[a, m] + u * table[b, m] + v * table[c, m]
            out += height * mean[4 + m]
            rows[k, _HEAD + m] = -height
        expected = (1.0 + scale) * (r - out / q) + bias - r * slant / q * half
        residuals[k] = q * (ranges[met[k]] - expected)
        edge = _EDGES * r * slant * beam
        variances[k] = q * q * sigma * sigma + rest + edge * edge
        rows[k, 0], rows[k, 1], rows[k, 2] = nx, ny, nz
        rows[k, 3] = r * (dy * nz - dz * ny)
        rows[k, 4] = r * (dz * nx - dx * nz)
        rows[k, 5] = r * (dx * ny - dy * nx)
        rows[k, 6] = -level / (1.0 + size)
        rows[k, 7] = q
        rows[k, 8] = q * r
        rows[k, 9] = -r * slant
    return Comparison(met, residuals, variances, rows)
