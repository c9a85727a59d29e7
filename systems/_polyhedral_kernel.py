"""Compiled kernel of polyhedral gravity (Werner & Scheeres 1997), one pass over edges and facets.

With ``L_e`` the edge potentials and ``w_f`` the facets' solid angles seen from the field point p,
every quantity is a sum that is linear in ``L_e`` and ``w_f`` once the point is split off::

    sum_e L_e E_e            (6 numbers)      and the same three sums over facets with F_f = n n^T
    sum_e L_e E_e p_e        (3 numbers)
    sum_e L_e p_e.E_e p_e    (1 number)

so an edge costs one reciprocal, one odd series and ten multiply-adds on structure-of-arrays, with
no branch: LLVM vectorises the loop. ``L = 2 atanh(x)``, ``x = l / (r_a + r_b)``, and
``w = 2 atan(t)`` have small arguments for all but the nearest edges and facets; a second loop,
entered only if there are such, replaces those by the exact logarithm and arctangent.
"""

import math

import numba
import numpy as np

from proxops.systems._far_field import point_masses

# Largest argument that the series below are used for: the first omitted term is then under
# 1e-17 of the sum.
_SERIES_LIMIT = 0.1
# Facets whose vertices are seen under wide angles: there the denominator from squared distances
# would lose digits. It is 4 r_1 r_2 r_3 far away.
_WIDE_FACET = 3.5
# r_a + r_b - l is kept above this share of l, so that the logarithm stays finite on an edge
# (where E_e r vanishes and with it the edge's share of potential and acceleration). It is reached
# at 1e-15 l from the edge.
_EDGE_FLOOR = 1e-30

# Not `nnan`: a NaN position must come out as NaN.
_FAST = {"reassoc", "nsz", "arcp", "contract"}


@numba.njit(cache=True, fastmath=_FAST, error_model="numpy", inline="always")
def _two_atanh(x):
    """2 atanh(x) for |x| <= _SERIES_LIMIT."""
    s = x * x
    series = 1 / 11 + s * (1 / 13 + s * (1 / 15))
    series = 1 / 3 + s * (1 / 5 + s * (1 / 7 + s * (1 / 9 + s * series)))
    return 2.0 * x * (1.0 + s * series)


@numba.njit(cache=True, fastmath=_FAST, error_model="numpy", inline="always")
def _two_atan(t):
    """2 atan(t) for |t| <= _SERIES_LIMIT."""
    s = t * t
    series = -1 / 11 + s * (1 / 13 - s * (1 / 15))
    series = -1 / 3 + s * (1 / 5 + s * (-1 / 7 + s * (1 / 9 + s * series)))
    return 2.0 * t * (1.0 + s * series)


@numba.njit(cache=True, fastmath=_FAST, error_model="numpy")
def _distances(px, py, pz, vertices, r, r2):
    for i in range(r.size):
        dx = vertices[0, i] - px
        dy = vertices[1, i] - py
        dz = vertices[2, i] - pz
        r2[i] = dx * dx + dy * dy + dz * dz
        r[i] = math.sqrt(r2[i])


@numba.njit(cache=True, fastmath=_FAST, error_model="numpy")
def _edge_arguments(edge_ab, edge_length, r, x):
    """x = l / (r_a + r_b) for every edge; returns how many are too large for the series."""
    near = 0
    for e in range(x.size):
        x[e] = edge_length[e] / (r[edge_ab[0, e]] + r[edge_ab[1, e]])
        near += x[e] > _SERIES_LIMIT
    return near


@numba.njit(cache=True, fastmath=_FAST, error_model="numpy")
def _edge_potentials(x, value):
    for e in range(x.size):
        value[e] = _two_atanh(x[e])


@numba.njit(cache=True, error_model="numpy")
def _redo_near_edges(px, py, pz, vertices, edge_ab, edge_length, r, x, value):
    for e in range(x.size):
        if x[e] > _SERIES_LIMIT:
            length = edge_length[e]
            s = r[edge_ab[0, e]] + r[edge_ab[1, e]]
            gap = s - length
            if gap < 0.1 * length:
                gap = _edge_gap(px, py, pz, vertices, edge_ab[0, e], edge_ab[1, e], length, r)
            value[e] = math.log((s + length) / max(gap, _EDGE_FLOOR * length))


@numba.njit(cache=True, error_model="numpy")
def _edge_gap(px, py, pz, vertices, a, b, length, r):
    """r_a + r_b - l without cancellation beside an edge, from the distance to its line."""
    ax, ay, az = vertices[0, a] - px, vertices[1, a] - py, vertices[2, a] - pz
    bx, by, bz = vertices[0, b] - px, vertices[1, b] - py, vertices[2, b] - pz
    ux = (vertices[0, b] - vertices[0, a]) / length
    uy = (vertices[1, b] - vertices[1, a]) / length
    uz = (vertices[2, b] - vertices[2, a]) / length
    # Lengths along the edge from its ends to the foot of the perpendicular; they add up to l.
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


@numba.njit(cache=True, fastmath=_FAST, error_model="numpy")
def _facet_arguments(px, py, pz, facet_abc, facet_side, r, r2, t):
    """tan(w / 2) for every facet, 2 where the series does not serve; returns how many those are."""
    near = 0
    for f in range(t.size):
        a, b, c = facet_abc[0, f], facet_abc[1, f], facet_abc[2, f]
        ra, rb, rc = r[a], r[b], r[c]
        ra2, rb2, rc2 = r2[a], r2[b], r2[c]
        # r_a . (r_b x r_c) is the height over the facet's plane times twice its area, and
        # r_b . r_c = (r_b^2 + r_c^2 - l_bc^2) / 2.
        num = facet_side[0, f] - (
            facet_side[1, f] * px + facet_side[2, f] * py + facet_side[3, f] * pz
        )
        cube = ra * rb * rc
        den = cube + 0.5 * (
            ra * (rb2 + rc2 - facet_side[4, f])
            + rb * (rc2 + ra2 - facet_side[5, f])
            + rc * (ra2 + rb2 - facet_side[6, f])
        )
        is_near = (abs(num) > _SERIES_LIMIT * den) | (den <= _WIDE_FACET * cube)
        near += is_near
        t[f] = 2.0 if is_near else num / den
    return near


@numba.njit(cache=True, fastmath=_FAST, error_model="numpy")
def _solid_angles(t, value):
    for f in range(t.size):
        value[f] = _two_atan(t[f])


@numba.njit(cache=True, error_model="numpy")
def _redo_near_facets(px, py, pz, vertices, facet_abc, facet_side, r, t, value):
    for f in range(t.size):
        if t[f] == 2.0:
            value[f] = _solid_angle(px, py, pz, vertices, facet_abc, facet_side, r, f)


@numba.njit(cache=True, fastmath=_FAST, error_model="numpy")
def _weigh(moments, value, sums):
    """sums = moments @ value for moments (9, n), in two sweeps of few enough streams."""
    for k in range(0, 9, 3):
        s0 = s1 = s2 = 0.0
        for e in range(value.size):
            v = value[e]
            s0 += moments[k, e] * v
            s1 += moments[k + 1, e] * v
            s2 += moments[k + 2, e] * v
        sums[k], sums[k + 1], sums[k + 2] = s0, s1, s2


@numba.njit(cache=True, fastmath=_FAST, error_model="numpy")
def _total(value):
    s = 0.0
    for e in range(value.size):
        s += value[e]
    return s


@numba.njit(cache=True, error_model="numpy")
def _solid_angle(px, py, pz, vertices, facet_abc, facet_side, r, f):
    """Signed solid angle of facet f by van Oosterom & Strackee (1983), eq. 8; 0 on the facet."""
    a, b, c = facet_abc[0, f], facet_abc[1, f], facet_abc[2, f]
    ax, ay, az = vertices[0, a] - px, vertices[1, a] - py, vertices[2, a] - pz
    bx, by, bz = vertices[0, b] - px, vertices[1, b] - py, vertices[2, b] - pz
    cx, cy, cz = vertices[0, c] - px, vertices[1, c] - py, vertices[2, c] - pz
    num = ax * facet_side[1, f] + ay * facet_side[2, f] + az * facet_side[3, f]
    # In the facet's plane, to rounding: the mean of both sides.
    if abs(num) <= facet_side[7, f]:
        return 0.0
    den = (
        r[a] * r[b] * r[c]
        + r[a] * (bx * cx + by * cy + bz * cz)
        + r[b] * (cx * ax + cy * ay + cz * az)
        + r[c] * (ax * bx + ay * by + az * bz)
    )
    return 2.0 * math.atan2(num, den)


@numba.njit(cache=True, error_model="numpy")
def _evaluate_point(
    point, vertices, edge_ab, edge_length, edge_moments, facet_abc, facet_side, facet_moments,
    factor, masses, switch, out,
):  # fmt: skip
    px, py, pz = point[0], point[1], point[2]
    if px * px + py * py + pz * pz >= switch * switch:
        point_masses(px, py, pz, masses, out)
        return
    r = np.empty(vertices.shape[1])
    r2 = np.empty(vertices.shape[1])
    argument = np.empty(max(edge_length.size, facet_abc.shape[1]))
    value = np.empty(argument.size)
    e = np.empty(9)
    f = np.empty(9)
    _distances(px, py, pz, vertices, r, r2)

    x = argument[: edge_length.size]
    potential = value[: edge_length.size]
    near = _edge_arguments(edge_ab, edge_length, r, x)
    _edge_potentials(x, potential)
    if near > 0:
        _redo_near_edges(px, py, pz, vertices, edge_ab, edge_length, r, x, potential)
    _weigh(edge_moments, potential, e)

    t = argument[: facet_abc.shape[1]]
    angle = value[: facet_abc.shape[1]]
    near = _facet_arguments(px, py, pz, facet_abc, facet_side, r, r2, t)
    _solid_angles(t, angle)
    if near > 0:
        _redo_near_facets(px, py, pz, vertices, facet_abc, facet_side, r, t, angle)
    _weigh(facet_moments, angle, f)
    total = _total(angle)

    xx, yy = e[0] - f[0], e[1] - f[1]
    xy, xz, yz = e[2] - f[2], e[3] - f[3], e[4] - f[4]
    # E_e is traceless and F_f has trace 1.
    zz = -total - xx - yy
    bx, by, bz = e[5] - f[5], e[6] - f[6], e[7] - f[7]
    qx = xx * px + xy * py + xz * pz
    qy = xy * px + yy * py + yz * pz
    qz = xz * px + yz * py + zz * pz
    quadratic = e[8] - f[8] - 2.0 * (bx * px + by * py + bz * pz)
    quadratic += qx * px + qy * py + qz * pz
    out[0] = 0.5 * factor * quadratic
    out[1] = factor * (qx - bx)
    out[2] = factor * (qy - by)
    out[3] = factor * (qz - bz)
    out[4], out[5], out[6] = factor * xx, factor * yy, factor * zz
    out[7], out[8], out[9] = factor * xy, factor * xz, factor * yz
    out[10] = total


# Two functions, not one compiled twice: numba's cache on disk does not tell the two apart.
@numba.njit(cache=True, error_model="numpy", nogil=True)
def evaluate_serial(
    points, vertices, edge_ab, edge_length, edge_moments, facet_abc, facet_side, facet_moments,
    factor, masses, switch, out,
):  # fmt: skip
    """Rows of ``out`` (N, 11) from points (N, 3), both relative to the field's own origin.

    Columns: potential, acceleration (x, y, z), gradient (xx, yy, zz, xy, xz, yz), solid angle.
    From the distance ``switch`` on they are those of the point masses ``masses``.
    """
    for i in range(points.shape[0]):
        _evaluate_point(
            points[i], vertices, edge_ab, edge_length, edge_moments, facet_abc, facet_side,
            facet_moments, factor, masses, switch, out[i],
        )  # fmt: skip


@numba.njit(cache=True, error_model="numpy", nogil=True, parallel=True)
def evaluate_parallel(
    points, vertices, edge_ab, edge_length, edge_moments, facet_abc, facet_side, facet_moments,
    factor, masses, switch, out,
):  # fmt: skip
    """As `evaluate_serial`, the points shared out among threads."""
    for i in numba.prange(points.shape[0]):
        _evaluate_point(
            points[i], vertices, edge_ab, edge_length, edge_moments, facet_abc, facet_side,
            facet_moments, factor, masses, switch, out[i],
        )  # fmt: skip
