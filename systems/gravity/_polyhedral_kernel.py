"""Compiled kernel of polyhedral gravity (Werner & Scheeres 1997): sums over edges and facets.

``L`` is an edge's potential and ``w`` a facet's solid angle, both seen from the field point p.
Every quantity follows from p and from sums that are linear in ``L`` and ``w``: over the edges, with
the dyad E and a point a of each, and over the facets, with F = n n^T::

    sum L E   (6 numbers)        sum L E a   (3)        sum L a.E a   (1)

E has trace 0 and F has trace 1, so five of the first six numbers are enough. The arguments of
``L = 2 atanh(x)`` with ``x = l / (r_a + r_b)`` and of ``w = 2 atan(t)`` are small for all but the
nearest edges and facets. So distances are gathered first. Then short odd series are summed without
a branch over arrays, which LLVM vectorises. If there are near edges or facets, a second loop
replaces their values by the exact logarithm and arctangent.

All functions are in one file, because numba's cache on disk checks only the function's own file.
"""

import math

import numba
import numpy as np
from numba.core import config

# Largest argument for the series below: the first omitted term is then below 1e-17 of the sum.
_SERIES_LIMIT = 0.1
# A facet is near if its denominator is at most this many r_1 r_2 r_3 (far away it is 4): its
# vertices are then seen under wide angles, and the denominator from squared distances would lose
# digits.
_WIDE_FACET = 3.5
# r_a + r_b - l is kept above this share of l, so that the logarithm is finite on an edge. There E r
# vanishes, and with it the edge's share of potential and acceleration. The share is reached at
# 1e-15 l from the edge.
_EDGE_FLOOR = 1e-30
# Marks a near facet in place of its solid angle.
_NEAR = 2.0

# `nnan` is left out, so that a NaN position gives NaN.
_FAST = {"reassoc", "nsz", "arcp", "contract"}
# The helpers are always inlined. Otherwise each entry point would have its own compiled copy, which
# copy a process runs would depend on what it loaded first, and with reordered sums the copies
# differ in the last bit.
_fast = numba.njit(cache=True, fastmath=_FAST, error_model="numpy", forceinline=True)
_exact = numba.njit(cache=True, error_model="numpy", forceinline=True)


@_fast
def _distances(px, py, pz, vertices, r):
    for i in range(r.size):
        dx = vertices[0, i] - px
        dy = vertices[1, i] - py
        dz = vertices[2, i] - pz
        r[i] = math.sqrt(dx * dx + dy * dy + dz * dz)


@_fast
def _gather_edges(ends, r, s):
    """r_a + r_b of every edge."""
    for e in range(s.size):
        s[e] = r[ends[0, e]] + r[ends[1, e]]


@_fast
def _edge_potentials(edges, s, potential):
    """Fills 2 atanh(l / s) of every edge by series; returns the number of edges too near for it."""
    near = 0
    for e in range(s.size):
        x = edges[9, e] / s[e]
        near += x > _SERIES_LIMIT
        q = x * x
        series = 1 / 11 + q * (1 / 13 + q * (1 / 15))
        series = 1 / 3 + q * (1 / 5 + q * (1 / 7 + q * (1 / 9 + q * series)))
        potential[e] = 2.0 * x * (1.0 + q * series)
    return near


@_exact
def _redo_near_edges(px, py, pz, vertices, ends, edges, r, s, potential):
    for e in range(s.size):
        length = edges[9, e]
        if length > _SERIES_LIMIT * s[e]:
            gap = s[e] - length
            if gap < 0.1 * length:
                gap = _edge_gap(px, py, pz, vertices, ends[0, e], ends[1, e], length, r)
            potential[e] = math.log((s[e] + length) / max(gap, _EDGE_FLOOR * length))


@_exact
def _edge_gap(px, py, pz, vertices, a, b, length, r):
    """r_a + r_b - l without cancellation beside an edge, from the distance to its line."""
    ax, ay, az = vertices[0, a] - px, vertices[1, a] - py, vertices[2, a] - pz
    bx, by, bz = vertices[0, b] - px, vertices[1, b] - py, vertices[2, b] - pz
    ux = (vertices[0, b] - vertices[0, a]) / length
    uy = (vertices[1, b] - vertices[1, a]) / length
    uz = (vertices[2, b] - vertices[2, a]) / length
    # Lengths along the edge from its ends to the foot of the perpendicular; their sum is l.
    from_a = -(ax * ux + ay * uy + az * uz)
    from_b = bx * ux + by * uy + bz * uz
    # The nearer end loses fewest digits.
    if from_a < from_b:
        bx, by, bz = ax, ay, az
    cx, cy, cz = by * uz - bz * uy, bz * ux - bx * uz, bx * uy - by * ux
    d2 = cx * cx + cy * cy + cz * cz
    gap_a = d2 / (r[a] + from_a) if from_a > 0.0 else r[a] - from_a
    gap_b = d2 / (r[b] + from_b) if from_b > 0.0 else r[b] - from_b
    return gap_a + gap_b


@_fast
def _weigh_edges(edges, potential, sums):
    """Fills the nine sums over edges: rows 0 to 8 of ``edges`` times the potentials."""
    for k in range(0, 9, 3):
        s0 = s1 = s2 = 0.0
        for e in range(potential.size):
            v = potential[e]
            s0 += edges[k, e] * v
            s1 += edges[k + 1, e] * v
            s2 += edges[k + 2, e] * v
        sums[k], sums[k + 1], sums[k + 2] = s0, s1, s2


@_fast
def _gather_facets(corners, r, ra, rb, rc):
    for f in range(ra.size):
        ra[f], rb[f], rc[f] = r[corners[0, f]], r[corners[1, f]], r[corners[2, f]]


@_fast
def _solid_angles(px, py, pz, facets, a, b, c, angle):
    """Fills 2 atan(t) of every facet by series, or _NEAR; returns the number of near facets.

    t is r_a . (r_b x r_c), the height over the facet's plane times twice its area, over
    r_a r_b r_c + sum r_a (r_b . r_c), where r_b . r_c = (r_b^2 + r_c^2 - l_bc^2) / 2.
    """
    near = 0
    for f in range(angle.size):
        ra, rb, rc = a[f], b[f], c[f]
        qa, qb, qc = ra * ra, rb * rb, rc * rc
        height = facets[3, f] - (facets[0, f] * px + facets[1, f] * py + facets[2, f] * pz)
        numerator = height * facets[4, f]
        cube = ra * rb * rc
        denominator = cube + 0.5 * (
            ra * (qb + qc - facets[5, f])
            + rb * (qc + qa - facets[6, f])
            + rc * (qa + qb - facets[7, f])
        )
        is_near = (abs(numerator) > _SERIES_LIMIT * denominator) | (
            denominator <= _WIDE_FACET * cube
        )
        near += is_near
        t = numerator / denominator
        q = t * t
        series = -1 / 11 + q * (1 / 13 - q * (1 / 15))
        series = -1 / 3 + q * (1 / 5 + q * (-1 / 7 + q * (1 / 9 + q * series)))
        angle[f] = _NEAR if is_near else 2.0 * t * (1.0 + q * series)
    return near


@_exact
def _redo_near_facets(px, py, pz, vertices, corners, facets, r, scale, angle):
    """van Oosterom & Strackee, IEEE Trans. Biomed. Eng. 30 (1983) 125, eq. 8; 0 on the facet."""
    for f in range(angle.size):
        if angle[f] != _NEAR:
            continue
        i, j, k = corners[0, f], corners[1, f], corners[2, f]
        ax, ay, az = vertices[0, i] - px, vertices[1, i] - py, vertices[2, i] - pz
        bx, by, bz = vertices[0, j] - px, vertices[1, j] - py, vertices[2, j] - pz
        cx, cy, cz = vertices[0, k] - px, vertices[1, k] - py, vertices[2, k] - pz
        height = ax * facets[0, f] + ay * facets[1, f] + az * facets[2, f]
        # In the facet's plane, to rounding: the mean of both sides.
        if abs(height) <= 1e-14 * scale:
            angle[f] = 0.0
            continue
        denominator = (
            r[i] * r[j] * r[k]
            + r[i] * (bx * cx + by * cy + bz * cz)
            + r[j] * (cx * ax + cy * ay + cz * az)
            + r[k] * (ax * bx + ay * by + az * bz)
        )
        angle[f] = 2.0 * math.atan2(height * facets[4, f], denominator)


@_fast
def _weigh_facets(facets, angle, sums):
    """Fills the nine sums over facets, from normals and heights; returns the total solid angle."""
    xx = yy = xy = xz = yz = bx = by = bz = c = total = 0.0
    for f in range(angle.size):
        w, h = angle[f], facets[3, f]
        nx, ny, nz = facets[0, f], facets[1, f], facets[2, f]
        wx, wy, wh = w * nx, w * ny, w * h
        total += w
        xx += wx * nx
        yy += wy * ny
        xy += wx * ny
        xz += wx * nz
        yz += wy * nz
        bx += wh * nx
        by += wh * ny
        bz += wh * nz
        c += wh * h
    sums[0], sums[1], sums[2], sums[3], sums[4] = xx, yy, xy, xz, yz
    sums[5], sums[6], sums[7], sums[8] = bx, by, bz, c
    return total


@_exact
def _fill_gradient(xx, yy, zz, xy, xz, yz, out):
    out[4], out[5], out[6] = xx, xy, xz
    out[7], out[8], out[9] = xy, yy, yz
    out[10], out[11], out[12] = xz, yz, zz


@_fast
def _point_masses(px, py, pz, masses, out):
    """Fills ``out`` (14,) as `_evaluate_point` does, solid angle 0, from masses (4, K)."""
    u = gx = gy = gz = xx = yy = xy = xz = yz = 0.0
    for k in range(masses.shape[1]):
        x, y, z = masses[0, k] - px, masses[1, k] - py, masses[2, k] - pz
        r2 = x * x + y * y + z * z
        level = masses[3, k] / math.sqrt(r2)
        pull = level / r2
        steep = 3.0 * pull / r2
        u += level
        gx, gy, gz = gx + pull * x, gy + pull * y, gz + pull * z
        xx += steep * x * x - pull
        yy += steep * y * y - pull
        xy, xz, yz = xy + steep * x * y, xz + steep * x * z, yz + steep * y * z
    out[0], out[1], out[2], out[3] = u, gx, gy, gz
    _fill_gradient(xx, yy, -xx - yy, xy, xz, yz, out)
    out[13] = 0.0


@_exact
def _evaluate_point(point, ends, corners, vertices, edges, facets, masses, factor, limits, out):
    """Fills ``out`` (14,): see `evaluate_serial`."""
    px, py, pz = point[0], point[1], point[2]
    scale, switch = limits
    if px * px + py * py + pz * pz >= switch * switch:
        _point_masses(px, py, pz, masses, out)
        return
    r = np.empty(vertices.shape[1])
    _distances(px, py, pz, vertices, r)
    s, potential = np.empty(edges.shape[1]), np.empty(edges.shape[1])
    e, f = np.empty(9), np.empty(9)
    _gather_edges(ends, r, s)
    if _edge_potentials(edges, s, potential) > 0:
        _redo_near_edges(px, py, pz, vertices, ends, edges, r, s, potential)
    _weigh_edges(edges, potential, e)

    n = facets.shape[1]
    ra, rb, rc, angle = np.empty(n), np.empty(n), np.empty(n), np.empty(n)
    _gather_facets(corners, r, ra, rb, rc)
    if _solid_angles(px, py, pz, facets, ra, rb, rc, angle) > 0:
        _redo_near_facets(px, py, pz, vertices, corners, facets, r, scale, angle)
    total = _weigh_facets(facets, angle, f)

    xx, yy, xy, xz, yz = e[0] - f[0], e[1] - f[1], e[2] - f[2], e[3] - f[3], e[4] - f[4]
    zz = -total - xx - yy
    bx, by, bz = e[5] - f[5], e[6] - f[6], e[7] - f[7]
    qx = xx * px + xy * py + xz * pz
    qy = xy * px + yy * py + yz * pz
    qz = xz * px + yz * py + zz * pz
    quadratic = e[8] - f[8] + (qx - 2.0 * bx) * px + (qy - 2.0 * by) * py + (qz - 2.0 * bz) * pz
    out[0] = 0.5 * factor * quadratic
    out[1], out[2], out[3] = factor * (qx - bx), factor * (qy - by), factor * (qz - bz)
    _fill_gradient(
        factor * xx, factor * yy, factor * zz, factor * xy, factor * xz, factor * yz, out
    )
    out[13] = total


# A process that has used GNU OpenMP, numba's first choice, ends if it is forked, as by the workers
# of Gymnasium. A choice of the user's own (NUMBA_THREADING_LAYER) stays.
if config.THREADING_LAYER == "default":  # pyright: ignore[reportAttributeAccessIssue]
    config.THREADING_LAYER = "forksafe"  # pyright: ignore[reportAttributeAccessIssue]


# Two functions, not one compiled twice: numba's cache on disk does not tell the two apart.
@numba.njit(cache=True, error_model="numpy", nogil=True)
def evaluate_serial(points, ends, corners, vertices, edges, facets, masses, factor, limits, out):
    """Rows of ``out`` (N, 14) from points (N, 3), both relative to the field's own origin.

    Columns: potential, acceleration (3), gradient (9, row by row), solid angle.

    Args:
      ends, corners: (2, E) and (3, F), indices of vertices.
      vertices: (3, V). edges: (10, E), nine moments and the length. facets: (8, F), normal, height
        of the plane over the origin, twice the area, squares of the edges opposite to the corners.
      masses: (4, K), point masses that have the field from the distance limits[1] on.
      factor: G rho. limits: radius of the body, and distance from which the point masses are used.
    """
    for i in range(points.shape[0]):
        _evaluate_point(
            points[i], ends, corners, vertices, edges, facets, masses, factor, limits, out[i]
        )


@numba.njit(cache=True, error_model="numpy", nogil=True, parallel=True)
def evaluate_parallel(points, ends, corners, vertices, edges, facets, masses, factor, limits, out):
    """Does the same as `evaluate_serial`, with the points divided among threads."""
    for i in numba.prange(points.shape[0]):
        _evaluate_point(
            points[i], ends, corners, vertices, edges, facets, masses, factor, limits, out[i]
        )
