"""Compiled kernel of `TabulatedField`: an octree of boxes, each with a harmonic polynomial.

It is eq. 31 of docs/method/equations.md.

About its centre and in units of its half edge, the potential of a box is the real part of a sum of
coefficients times regular solid harmonics R_nm, for 0 <= m <= n <= p::

    R_nm = (x + i y)^m / (2^m m!) T_nm(z, r^2)    T_mm = 1,  T_(m-1)m = 0
    ((n + 1)^2 - m^2) T_(n+1)m = (2 n + 1) z T_nm - r^2 T_(n-1)m

That is r^n P_nm(cos) exp(i m phi) / (n + m)!, without the sign (-1)^m. With D = d/dx - i d/dy the
derivatives are other harmonics: d/dz R_nm = R_(n-1)m and D R_nm = R_(n-1)(m-1). So all derivatives
are sums of the same harmonics with shifted coefficients, and the gradient's trace is 0.

A box's coefficients lie in columns of equal m, n upwards from m. Column m has p - m + 3 entries,
the last two of which are 0, and m goes to p + 2, so that shifted reading needs no tests. A
coefficient of column 0 is twice that in the sum.
"""

import math
from typing import NamedTuple

import numpy as np

from proxops.systems.common import kernel

_FAST = {"reassoc", "nsz", "arcp", "contract"}
_fast = kernel(fastmath=_FAST, error_model="numpy", forceinline=True)
_exact = kernel(error_model="numpy", forceinline=True)

SCALES = np.dtype(
    [
        ("over_axes", np.float64, 3),  # 1 over the semi-axes of the ellipsoid, in 1/m.
        ("half", np.float64),  # Half edge of the whole octree, in m.
        ("degree", np.float64),  # Of the polynomials.
    ]
)


class FieldTables(NamedTuple):
    """A field outside an ellipsoid, for compiled functions."""

    children: np.ndarray
    boxes: np.ndarray
    coefficients: np.ndarray
    """Those of `_harmonic_boxes.Boxes`."""
    steps: np.ndarray
    """The recursion's coefficients."""
    masses: np.ndarray
    """(4, K) far away: places in m, and G times the masses."""
    scales: np.record
    """Of the type `SCALES`."""


# In place of a box: the point is far away, or the table does not have it.
_FAR, _NONE = -1, -2


@_fast
def _fill(numbers, out):
    u, gx, gy, gz, xx, yy, zz, xy, xz, yz = numbers
    out[0], out[1], out[2], out[3] = u, gx, gy, gz
    out[4], out[5], out[6] = xx, xy, xz
    out[7], out[8], out[9] = xy, yy, yz
    out[10], out[11], out[12] = xz, yz, zz
    out[13] = 0.0


@_fast
def _expand(x, y, z, coefficients, steps, degree):
    """Potential, acceleration and the gradient's six numbers of one box, in its units of length.

    Whoever uses some of them pays for these only: the compiler leaves out the other sums.
    """
    r2 = x * x + y * y + z * z
    u = gz = gzz = d_re = d_im = dz_re = dz_im = dd_re = dd_im = 0.0
    w_re, w_im = 1.0, 0.0
    column = 0
    for m in range(degree + 1):
        length = degree - m + 3
        after = column + length
        # Columns m - 1 and m - 2; at the left edge they are read in vain or mirrored.
        before = column - (length + 1) if m > 0 else 0
        second = before - (length + 2) if m > 1 else column - 2
        farther = after + length - 1
        t, last = 1.0, 0.0
        a0 = a1 = b0 = b1 = c0 = c1 = e0 = e1 = f0 = f1 = 0.0
        g0 = g1 = h0 = h1 = i0 = i1 = j0 = j1 = 0.0
        for k in range(degree - m + 1):
            a0 += t * coefficients[column + k, 0]
            a1 += t * coefficients[column + k, 1]
            b0 += t * coefficients[column + k + 1, 0]
            b1 += t * coefficients[column + k + 1, 1]
            c0 += t * coefficients[column + k + 2, 0]
            c1 += t * coefficients[column + k + 2, 1]
            e0 += t * coefficients[after + k, 0]
            e1 += t * coefficients[after + k, 1]
            f0 += t * coefficients[after + k + 1, 0]
            f1 += t * coefficients[after + k + 1, 1]
            g0 += t * coefficients[before + k + 2, 0]
            g1 += t * coefficients[before + k + 2, 1]
            h0 += t * coefficients[before + k + 3, 0]
            h1 += t * coefficients[before + k + 3, 1]
            i0 += t * coefficients[farther + k, 0]
            i1 += t * coefficients[farther + k, 1]
            j0 += t * coefficients[second + k + 4, 0]
            j1 += t * coefficients[second + k + 4, 1]
            t, last = steps[column + k, 0] * z * t - steps[column + k, 1] * r2 * last, t
        # The terms of -m are the mirrored ones of m; those of 0 count once.
        share, low = (0.5, 0.0) if m == 0 else (1.0, 1.0)
        if m == 1:
            j0 = -j0
        u += share * (a0 * w_re - a1 * w_im)
        gz += share * (b0 * w_re - b1 * w_im)
        gzz += share * (c0 * w_re - c1 * w_im)
        d_re += (e0 - low * g0) * w_re - (e1 - low * g1) * w_im
        d_im += (e0 + low * g0) * w_im + (e1 + low * g1) * w_re
        dz_re += (f0 - low * h0) * w_re - (f1 - low * h1) * w_im
        dz_im += (f0 + low * h0) * w_im + (f1 + low * h1) * w_re
        dd_re += (i0 + low * j0) * w_re - (i1 + low * j1) * w_im
        dd_im += (i0 - low * j0) * w_im + (i1 - low * j1) * w_re
        turn = 0.5 / (m + 1)
        w_re, w_im = turn * (w_re * x - w_im * y), turn * (w_re * y + w_im * x)
        column = after
    # D = d/dx - i d/dy, and half of each sum counts; D D = d2/dx2 - d2/dy2 - 2 i d2/dxdy.
    xx, yy = 0.25 * dd_re - 0.5 * gzz, -0.25 * dd_re - 0.5 * gzz
    return (
        u, 0.5 * d_re, -0.5 * d_im, gz,
        xx, yy, gzz, -0.25 * dd_im, 0.5 * dz_re, -0.5 * dz_im,
    )  # fmt: skip


@_fast
def _point_masses(x, y, z, masses):
    """The ten numbers of `_expand` from point masses (4, K)."""
    u = gx = gy = gz = xx = yy = xy = xz = yz = 0.0
    for k in range(masses.shape[1]):
        dx, dy, dz = masses[0, k] - x, masses[1, k] - y, masses[2, k] - z
        near = 1.0 / (dx * dx + dy * dy + dz * dz)
        potential = masses[3, k] * math.sqrt(near)
        slope = potential * near
        curve = 3.0 * slope * near
        u += potential
        gx, gy, gz = gx + slope * dx, gy + slope * dy, gz + slope * dz
        xx += curve * dx * dx - slope
        yy += curve * dy * dy - slope
        xy, xz, yz = xy + curve * dx * dy, xz + curve * dx * dz, yz + curve * dy * dz
    return u, gx, gy, gz, xx, yy, -xx - yy, xy, xz, yz


@_exact
def _box_at(tables, x, y, z):
    """The index of the box that has the point; _FAR far away, _NONE where there is none."""
    children, scales = tables.children, tables.scales
    sx, sy, sz = x * scales.over_axes[0], y * scales.over_axes[1], z * scales.over_axes[2]
    if not sx * sx + sy * sy + sz * sz >= 1.0:
        return _NONE
    half = scales.half
    if max(abs(x), abs(y), abs(z)) > half:
        finite = x - x == 0.0 and y - y == 0.0 and z - z == 0.0
        return _FAR if finite else _NONE
    cx = cy = cz = 0.0
    node = 0
    while node >= 0:
        half *= 0.5
        octant = 0
        if x >= cx:
            octant, cx = 4, cx + half
        else:
            cx -= half
        if y >= cy:
            octant, cy = octant + 2, cy + half
        else:
            cy -= half
        if z >= cz:
            octant, cz = octant + 1, cz + half
        else:
            cz -= half
        node = children[node, octant]
    return -2 - node if node < -1 else _NONE


@_exact
def _numbers_at(tables, box, x, y, z):
    """The ten numbers of `_expand` at a point of a box or far away, and 1 over the unit of length.

    Acceleration is to be multiplied by it, and the gradient by its square.
    """
    _, places, coefficients, steps, masses, scales = tables
    if box == _FAR:
        return _point_masses(x, y, z, masses), 1.0
    over = places[box, 3]
    px, py, pz = (
        (x - places[box, 0]) * over,
        (y - places[box, 1]) * over,
        (z - places[box, 2]) * over,
    )
    return _expand(px, py, pz, coefficients[box], steps, int(scales.degree)), over


@_exact
def at(tables, x, y, z, out):
    """Fills ``out`` (14,) at the point x, y, z in m, if the table has the point.

    The columns are those of the exact kernel: potential, acceleration (3), gradient (9, row by
    row), and 0 for the solid angle.

    Args:
      tables: `FieldTables`, the `tables` of a `TabulatedField`.

    Returns:
      Whether the table has the point. It has not if the point is in the ellipsoid, is not finite,
      or is so close to the surface that no box was small enough. ``out`` is then as it was.
    """
    box = _box_at(tables, x, y, z)
    if box == _NONE:
        return False
    numbers, over = _numbers_at(tables, box, x, y, z)
    _fill(numbers, out)
    for k in range(1, 4):
        out[k] *= over
    for k in range(4, 13):
        out[k] *= over * over
    return True


@_exact
def gravity_at(tables, x, y, z, out):
    """Fills ``out`` (3,) with the acceleration alone, in half the time of `at`; returns as it."""
    box = _box_at(tables, x, y, z)
    if box == _NONE:
        return False
    numbers, over = _numbers_at(tables, box, x, y, z)
    out[0], out[1], out[2] = over * numbers[1], over * numbers[2], over * numbers[3]
    return True


@kernel(error_model="numpy", nogil=True)
def evaluate(points, tables, out):
    """Fills the rows of ``out`` (N, 14) at points (N, 3) in m.

    Returns:
      The number of points that the table does not have; the first number of their rows is NaN.
    """
    missing = 0
    for i in range(points.shape[0]):
        if not at(tables, points[i, 0], points[i, 1], points[i, 2], out[i]):
            out[i, 0] = np.nan
            missing += 1
    return missing


@kernel(error_model="numpy", nogil=True)
def expand(points, coefficients, steps, degree, out):
    """Fills ``out`` (B, N, 14) at points (N, 3) of boxes with coefficients (B, C, 2)."""
    for box in range(coefficients.shape[0]):
        for i in range(points.shape[0]):
            x, y, z = points[i]
            _fill(_expand(x, y, z, coefficients[box], steps, degree), out[box, i])
