"""Compiled kernels: how the ranges of a frame depend on what the navigation estimates.

A ray from p along the unit vector d (K) meets a facet of unit normal n at the distance r. With
q = |n.d|, the measured range z differs from the predicted one by

    q (z - r) = n.dp + r (d x n).da - h - s n.x + q b + q r e - r sqrt(1 - q^2) w + q noise

to first order in the errors of position (dp) and attitude (da, a rotation vector in K), for a
surface that lies h farther out along its normal, a body larger by the share s, a bias b and a scale
error e of the lidar, and beams of half angle w, which read the nearest surface in their cone; x is
the point that the ray meets.
"""

import math

import numba
import numpy as np

# Rays that meet the surface at a flatter angle (cosine of the incidence) are not used: there the
# range changes too fast with everything.
FLATTEST = 0.15
_HEAD = 10
# A beam on an edge between two facets does not read what it would read on one plane. The error is
# this share of what the beam's width changes the range by.
_EDGES = 0.25


@numba.njit(cache=True, error_model="numpy")
def heights_at(corners, places, table, coefficients):
    """How far out the surface lies (K,) in m at points of facets: see `rows_of_frame`."""
    out = np.zeros(len(corners))
    for k in range(len(corners)):
        u, v = places[k, 0], places[k, 1]
        a, b, c = corners[k, 0], corners[k, 1], corners[k, 2]
        for m in range(coefficients.size):
            height = (1.0 - u - v) * table[a, m] + u * table[b, m] + v * table[c, m]
            out[k] += height * coefficients[m]
    return out


@numba.njit(cache=True, error_model="numpy")
def rows_of_frame(
    position, directions, found, measured, normals, corners, places, heights, table, mean, sigma,
    rest, beam, rows,
):  # fmt: skip
    """Residuals and their derivatives for the K rays whose predictions meet the body.

    Args:
      position: (3,) in m in K. directions: (K, 3) in K. found: (K,) predicted distances in m.
      measured: (K,) ranges in m. normals: (K, 3) of the facets met.
      corners: (K, 3) vertices of the facets met. places: (K, 2) weights of the second and third.
      heights: (K,) in m: how far out the surface is in `found` already.
      table: (V, M): displacement of each vertex, in m, by each coefficient of the map's error.
      mean: (4 + M,) size, bias, scale error and half beam, and these coefficients.
      sigma: of the range noise, in m. rest: variance in m^2 of the surface beyond the coefficients.
      beam: half of the angle of the beams in rad, as far as it may be.
      rows: (K, 10 + M), filled with the derivatives, in the order of `MEASURED` and coefficients.

    Returns:
      Residuals q (z - r) in m (K,), and their variances in m^2 (K,): +inf where the ray is too
      flat.
    """
    count, modes = found.size, table.shape[1]
    residuals, variances = np.zeros(count), np.full(count, np.inf)
    size, bias, scale, half = mean[0], mean[1], mean[2], mean[3]
    for k in range(count):
        dx, dy, dz = directions[k, 0], directions[k, 1], directions[k, 2]
        nx, ny, nz = normals[k, 0], normals[k, 1], normals[k, 2]
        r = found[k]
        q = -(nx * dx + ny * dy + nz * dz)
        if q < FLATTEST:
            continue
        slant = math.sqrt(max(1.0 - q * q, 0.0))
        px, py, pz = position[0] + r * dx, position[1] + r * dy, position[2] + r * dz
        level = nx * px + ny * py + nz * pz
        out = -heights[k]
        u, v = places[k, 0], places[k, 1]
        a, b, c = corners[k, 0], corners[k, 1], corners[k, 2]
        for m in range(modes):
            height = (1.0 - u - v) * table[a, m] + u * table[b, m] + v * table[c, m]
            out += height * mean[4 + m]
            rows[k, _HEAD + m] = -height
        expected = (1.0 + scale) * (r - out / q) + bias - r * slant / q * half
        residuals[k] = q * (measured[k] - expected)
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
    return residuals, variances
