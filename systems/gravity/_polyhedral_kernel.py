"""Compiled kernel of polyhedral gravity (Werner & Scheeres 1997): sums over edges and facets.

``L`` is an edge's potential and ``w`` a facet's solid angle, both seen from the field point p.
Every quantity follows from p and from sums that are linear in ``L`` and ``w``: over the edges, with
the dyad E and a point a of each, less those over the facets, with F = n n^T::

    sum L E   (6 numbers)        sum L E a   (3)        sum L a.E a   (1)

E has trace 0 and F has trace 1, so five of the first six numbers are enough. The arguments of
``L = 2 atanh(x)`` with ``x = l / (r_a + r_b)`` and of ``w = 2 atan(t)`` are small for all but the
nearest edges and facets, so that short odd polynomials give both. If edges or facets of a unit are
near, a second loop adds them by the exact logarithm and arctangent. These are eq. 29 and 30 of
docs/method/equations.md; far away it is eq. 32.

A *unit* is two facets and three edges, two of the first facet and one of the second (see
`proxops.systems.gravity._polyhedral_tables`). It needs the six distances of its corners and nothing
that was stored before, and LLVM makes one loop over units of it, eight units at a time where the
processor has vectors of 512 bits. Each distance, division and polynomial is computed once.
"""

import math

import numpy as np

from proxops.systems.common import kernel

BLOCK = 128
"""Units whose distances are gathered at a time: few enough to stay in the fastest cache."""

# Largest argument for the polynomials below.
_SERIES_LIMIT = 0.08
# (atanh(sqrt q) / sqrt q - 1) / q and (atan(sqrt q) / sqrt q - 1) / q for q up to the square of
# that: Chebyshev interpolation, with relative errors of atanh and atan below 1e-16.
_LOG = (
    0.333333333333335,
    0.19999999998722195,
    0.14285715882038547,
    0.11110413618436935,
    0.09215103839287561,
)
_TAN = (
    -0.33333333333333176,
    0.1999999999875687,
    -0.14285712730898964,
    0.11110430003457741,
    -0.08968933126477183,
)
# A facet is near if its denominator is at most this many r_1 r_2 r_3 / 2 (far away it is 8): its
# vertices are then seen under wide angles, and the denominator from squared distances would lose
# digits.
_WIDE_FACET = 7.0
# r_a + r_b - l is kept above this share of l, so that the logarithm is finite on an edge. There E r
# vanishes, and with it the edge's share of potential and acceleration. The share is reached at
# 1e-15 l from the edge.
_EDGE_FLOOR = 1e-30

# Rows of a unit in ``units``. Of a facet: normal, height of its plane over the origin, four times
# its area, squares of the edges opposite to the corners. Of an edge: nine moments and the length.
ROWS = 46
"""Rows of a unit."""
# `nnan` is left out, so that a NaN position gives NaN.
_FAST = {"reassoc", "nsz", "arcp", "contract"}
# The helpers are always inlined. Otherwise each entry point would have its own compiled copy, which
# copy a process runs would depend on what it loaded first, and with reordered sums the copies
# differ in the last bit.
_fast = kernel(fastmath=_FAST, error_model="numpy", forceinline=True)
_exact = kernel(error_model="numpy", forceinline=True)


@_fast
def _distances(px, py, pz, vertices, r):
    for i in range(r.size):
        dx = vertices[0, i] - px
        dy = vertices[1, i] - py
        dz = vertices[2, i] - pz
        r[i] = math.sqrt(dx * dx + dy * dy + dz * dz)


@_fast
def _gather(corners, count, r, seen):
    """The distances of the corners of ``count`` units."""
    for u in range(count):
        seen[0, u], seen[1, u], seen[2, u] = r[corners[0, u]], r[corners[1, u]], r[corners[2, u]]
        seen[3, u], seen[4, u], seen[5, u] = r[corners[3, u]], r[corners[4, u]], r[corners[5, u]]


@_fast
def _half_edge(length, both):
    """Whether an edge is near, and L / 2, which is right if it is not."""
    x = length / both
    q = x * x
    series = _LOG[0] + q * (_LOG[1] + q * (_LOG[2] + q * (_LOG[3] + q * _LOG[4])))
    near = x > _SERIES_LIMIT
    return near, x + x * q * series


@_fast
def _half_angle(p, units, f, u, ra, rb, rc):
    """Whether a facet is near, and -w / 2, which is right if it is not.

    tan(w / 2) is r_a . (r_b x r_c), the height over the facet's plane times twice its area, over
    r_a r_b r_c + sum r_a (r_b . r_c), where r_b . r_c = (r_b^2 + r_c^2 - l_bc^2) / 2. Here both
    are doubled.
    """
    px, py, pz = p
    qa, qb, qc = ra * ra, rb * rb, rc * rc
    height = (units[f, u] * px + units[f + 1, u] * py + units[f + 2, u] * pz) - units[f + 3, u]
    cube = ra * rb * rc
    denominator = (cube + cube) + (
        ra * (qb + qc - units[f + 5, u])
        + rb * (qc + qa - units[f + 6, u])
        + rc * (qa + qb - units[f + 7, u])
    )
    t = height * units[f + 4, u] / denominator
    q = t * t
    series = _TAN[0] + q * (_TAN[1] + q * (_TAN[2] + q * (_TAN[3] + q * _TAN[4])))
    near = (abs(t) > _SERIES_LIMIT) | (denominator <= _WIDE_FACET * cube)
    return near, t + t * q * series


@_fast
def _sum_units(p, units, count, seen, near, sums):
    """Adds the shares of ``count`` units to ``sums`` (10,), without those that are near.

    Fills ``near`` with the parts of each unit that are near: 1 and 2, its facets; 4, 8 and 16, its
    edges.

    Returns:
      Whether there are any.
    """
    found = 0.0
    # What is near is left out here, not in the helpers: of a choice in their `return`, Python 3.12
    # makes two returns, and then LLVM makes no loop over several units at a time.
    xx = yy = xy = xz = yz = bx = by = bz = c = total = 0.0
    for u in range(count):
        ra, rb, rc, rd, re, rf = (
            seen[0, u],
            seen[1, u],
            seen[2, u],
            seen[3, u],
            seen[4, u],
            seen[5, u],
        )
        near_f, w = _half_angle(p, units, 0, u, ra, rb, rc)
        w = 0.0 if near_f else w
        nx, ny, nz, h = units[0, u], units[1, u], units[2, u], units[3, u]
        wx, wy, wh = w * nx, w * ny, w * h
        xx, yy, xy, xz, yz = xx + wx * nx, yy + wy * ny, xy + wx * ny, xz + wx * nz, yz + wy * nz
        bx, by, bz, c, total = bx + wh * nx, by + wh * ny, bz + wh * nz, c + wh * h, total + w
        near_g, w = _half_angle(p, units, 8, u, rd, re, rf)
        w = 0.0 if near_g else w
        nx, ny, nz, h = units[8, u], units[9, u], units[10, u], units[11, u]
        wx, wy, wh = w * nx, w * ny, w * h
        xx, yy, xy, xz, yz = xx + wx * nx, yy + wy * ny, xy + wx * ny, xz + wx * nz, yz + wy * nz
        bx, by, bz, c, total = bx + wh * nx, by + wh * ny, bz + wh * nz, c + wh * h, total + w
        near_0, v = _half_edge(units[25, u], ra + rb)
        v = 0.0 if near_0 else v
        xx, yy, xy = xx + units[16, u] * v, yy + units[17, u] * v, xy + units[18, u] * v
        xz, yz, bx = xz + units[19, u] * v, yz + units[20, u] * v, bx + units[21, u] * v
        by, bz, c = by + units[22, u] * v, bz + units[23, u] * v, c + units[24, u] * v
        near_1, v = _half_edge(units[35, u], rb + rc)
        v = 0.0 if near_1 else v
        xx, yy, xy = xx + units[26, u] * v, yy + units[27, u] * v, xy + units[28, u] * v
        xz, yz, bx = xz + units[29, u] * v, yz + units[30, u] * v, bx + units[31, u] * v
        by, bz, c = by + units[32, u] * v, bz + units[33, u] * v, c + units[34, u] * v
        near_2, v = _half_edge(units[45, u], rd + re)
        v = 0.0 if near_2 else v
        xx, yy, xy = xx + units[36, u] * v, yy + units[37, u] * v, xy + units[38, u] * v
        xz, yz, bx = xz + units[39, u] * v, yz + units[40, u] * v, bx + units[41, u] * v
        by, bz, c = by + units[42, u] * v, bz + units[43, u] * v, c + units[44, u] * v
        parts = (1.0 if near_f else 0.0) + (2.0 if near_g else 0.0) + (4.0 if near_0 else 0.0)
        parts += (8.0 if near_1 else 0.0) + (16.0 if near_2 else 0.0)
        near[u] = parts
        found += parts
    sums[0] += xx
    sums[1] += yy
    sums[2] += xy
    sums[3] += xz
    sums[4] += yz
    sums[5] += bx
    sums[6] += by
    sums[7] += bz
    sums[8] += c
    sums[9] += total
    return found > 0.0


@_exact
def _add_near(p, vertices, block, r, scale, near, sums):
    """Adds the shares of the parts of units that are near."""
    corners, units, count = block
    for u in range(count):
        parts = int(near[u])
        if parts == 0:
            continue
        for k in range(2):
            if parts & (1 << k):
                f = 8 * k
                i, j, m = corners[3 * k, u], corners[3 * k + 1, u], corners[3 * k + 2, u]
                nx, ny, nz, h = units[f, u], units[f + 1, u], units[f + 2, u], units[f + 3, u]
                facet = nx, ny, nz, units[f + 4, u]
                w = _near_angle(p, vertices, (i, j, m), r, facet, scale)
                sums[0] += w * nx * nx
                sums[1] += w * ny * ny
                sums[2] += w * nx * ny
                sums[3] += w * nx * nz
                sums[4] += w * ny * nz
                sums[5] += w * h * nx
                sums[6] += w * h * ny
                sums[7] += w * h * nz
                sums[8] += w * h * h
                sums[9] += w
        for k in range(3):
            if parts & (4 << k):
                e, first = 16 + 10 * k, k + k // 2  # The edges run from the corners 0, 1 and 3.
                i, j, length = corners[first, u], corners[first + 1, u], units[e + 9, u]
                v = _near_edge(p, vertices, i, j, length, r)
                for row in range(9):
                    sums[row] += units[e + row, u] * v


@_exact
def _near_edge(p, vertices, a, b, length, r):
    """L / 2 of an edge."""
    both = r[a] + r[b]
    gap = both - length
    if gap < 0.1 * length:
        gap = _edge_gap(p, vertices, a, b, length, r)
    return 0.5 * math.log((both + length) / max(gap, _EDGE_FLOOR * length))


@_exact
def _edge_gap(p, vertices, a, b, length, r):
    """r_a + r_b - l without cancellation beside an edge, from the distance to its line."""
    px, py, pz = p
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


@_exact
def _near_angle(p, vertices, corners, r, facet, scale):
    """-w / 2 of a facet, of normal (3 numbers) and four times the area; 0 on the facet.

    van Oosterom & Strackee, IEEE Trans. Biomed. Eng. 30 (1983) 125, eq. 8.
    """
    (px, py, pz), (i, j, k), (nx, ny, nz, area4) = p, corners, facet
    ax, ay, az = vertices[0, i] - px, vertices[1, i] - py, vertices[2, i] - pz
    bx, by, bz = vertices[0, j] - px, vertices[1, j] - py, vertices[2, j] - pz
    cx, cy, cz = vertices[0, k] - px, vertices[1, k] - py, vertices[2, k] - pz
    height = ax * nx + ay * ny + az * nz
    # In the facet's plane, to rounding: the mean of both sides.
    if abs(height) <= 1e-14 * scale:
        return 0.0
    denominator = (
        r[i] * r[j] * r[k]
        + r[i] * (bx * cx + by * cy + bz * cz)
        + r[j] * (cx * ax + cy * ay + cz * az)
        + r[k] * (ax * bx + ay * by + az * bz)
    )
    return -math.atan2(0.5 * height * area4, denominator)


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
        potential = masses[3, k] / math.sqrt(r2)
        slope = potential / r2
        curve = 3.0 * slope / r2
        u += potential
        gx, gy, gz = gx + slope * x, gy + slope * y, gz + slope * z
        xx += curve * x * x - slope
        yy += curve * y * y - slope
        xy, xz, yz = xy + curve * x * y, xz + curve * x * z, yz + curve * y * z
    out[0], out[1], out[2], out[3] = u, gx, gy, gz
    _fill_gradient(xx, yy, -xx - yy, xy, xz, yz, out)
    out[13] = 0.0


@_exact
def _evaluate_point(point, tables, masses, numbers, out):
    """Fills ``out`` (14,): see `evaluate_points`."""
    factor, scale, switch, cx, cy, cz = numbers
    px, py, pz = point[0] - cx, point[1] - cy, point[2] - cz
    if px * px + py * py + pz * pz >= switch * switch:
        _point_masses(px, py, pz, masses, out)
        return
    corners, vertices, units, count = tables
    r, seen = np.empty(vertices.shape[1]), np.empty((6, BLOCK))
    near, sums = np.empty(BLOCK), np.zeros(10)
    _distances(px, py, pz, vertices, r)
    for k in range(units.shape[0]):
        here = min(BLOCK, count - k * BLOCK)
        _gather(corners[k], here, r, seen)
        if _sum_units((px, py, pz), units[k], here, seen, near, sums):
            block = corners[k], units[k], here
            _add_near((px, py, pz), vertices, block, r, scale, near, sums)

    # Of the halves of L and -w.
    total = sums[9]
    xx, yy, xy, xz, yz = sums[0], sums[1], sums[2], sums[3], sums[4]
    zz = total - xx - yy
    bx, by, bz = sums[5], sums[6], sums[7]
    qx = xx * px + xy * py + xz * pz
    qy = xy * px + yy * py + yz * pz
    qz = xz * px + yz * py + zz * pz
    quadratic = sums[8] + (qx - 2.0 * bx) * px + (qy - 2.0 * by) * py + (qz - 2.0 * bz) * pz
    twice = 2.0 * factor
    out[0] = factor * quadratic
    out[1], out[2], out[3] = twice * (qx - bx), twice * (qy - by), twice * (qz - bz)
    _fill_gradient(twice * xx, twice * yy, twice * zz, twice * xy, twice * xz, twice * yz, out)
    out[13] = -2.0 * total


@kernel(error_model="numpy", nogil=True)
def evaluate_points(points, tables, masses, numbers, out):
    """Rows of ``out`` (N, 14) from points (N, 3) in the mesh's frame.

    Columns: potential, acceleration (3), gradient (9, row by row), solid angle.

    Args:
      tables: `proxops.systems.gravity._polyhedral_tables.Tables`, from the field's own origin.
      masses: (4, K), point masses that have the field from some distance on.
      numbers: G rho, the radius of the body, the distance from which the point masses are used, and
        the field's own origin (3).
    """
    for i in range(points.shape[0]):
        _evaluate_point(points[i], tables, masses, numbers, out[i])
