"""Compiled kernel of backup braking: gravity from a table, the backup's law, margins, speed limit.

Most functions share these arguments:

* ``scales`` (5,), ``nodes`` (2 n + 1, 2 n + 1, 2 n + 1, 4): those of a `GravityTable`.
* ``world`` (9,): see the indices below.
* ``r``, ``v``: position (3,) in m and velocity (3,) in m/s in K; ``u``: thrust acceleration (3,).

All functions are in one file, because a compiled function contains the functions that it calls, and
numba's cache on disk checks only the function's own file. After a change in another file the old
code would still run.
"""

import math

import numba
import numpy as np

# Indices of ``world``: semi-axes of the ellipsoid with its margin, spin, greatest thrust
# acceleration per axis, control period, outward speed that the backup seeks, speed per axis up to
# which thrust can hold against gravity and Coriolis, and speed limit per axis.
AXIS_X, AXIS_Y, AXIS_Z, SPIN, THRUST, PERIOD, CRUISE, SETTLED, SPEED = range(9)

# Least level, |(x/a, y/b, z/c)|, of the table. Below it, gravity at that level is used.
LOWEST_LEVEL = 0.95
# A backup that has not settled after so many steps counts as failed.
_LONGEST_BACKUP = 300
# Outward speed, as a share of the cruise speed, from which the law does not turn inwards again:
# Coriolis and gravity change it by far less in one step.
_OUTWARD = 0.05
# An axis with at most this share of the normal is braked even if it moves outwards.
_SIDEWAYS = 0.2

_compiled = numba.njit(cache=True, error_model="numpy", fastmath={"contract"})
_inlined = numba.njit(cache=True, error_model="numpy", fastmath={"contract"}, forceinline=True)


@_inlined
def _weights(t):
    """Lagrange's weights of nodes at -1, 0, 1 and 2, for t from 0 to 1."""
    return (
        -t * (t - 1.0) * (t - 2.0) / 6.0,
        (t + 1.0) * (t - 1.0) * (t - 2.0) / 2.0,
        -(t + 1.0) * t * (t - 2.0) / 2.0,
        (t + 1.0) * t * (t - 1.0) / 6.0,
    )


@_compiled
def interpolate(x, y, z, scales, nodes, out):
    """Fills gravity (3,) at a point: a point mass, and the table's difference by cubics."""
    wx, wy, wz = x / scales[0], y / scales[1], z / scales[2]
    level2 = wx * wx + wy * wy + wz * wz
    out[0] = out[1] = out[2] = 0.0
    # The point is the centre, or it is not finite.
    if not 0.0 < level2 < math.inf:
        return
    shrink = 1.0 / (scales[4] * max(level2, LOWEST_LEVEL * math.sqrt(level2)))
    middle = nodes.shape[0] // 2
    qx, qy, qz = wx * shrink + middle, wy * shrink + middle, wz * shrink + middle
    i, j, k = int(qx), int(qy), int(qz)
    a, b, (c0, c1, c2, c3) = _weights(qx - i), _weights(qy - j), _weights(qz - k)
    for p in range(4):
        for q in range(4):
            share = a[p] * b[q]
            row = nodes[i - 1 + p, j - 1 + q]
            for m in range(3):
                out[m] += share * (
                    c0 * row[k - 1, m] + c1 * row[k, m] + c2 * row[k + 1, m] + c3 * row[k + 2, m]
                )
    r2 = x * x + y * y + z * z
    mass = scales[3] / (r2 * math.sqrt(r2))
    out[0] -= mass * x
    out[1] -= mass * y
    out[2] -= mass * z


@_inlined
def _within(value, low, high):
    return min(max(value, low), high)


@_inlined
def _gravity_ahead(r, v, scales, nodes, world, gravity):
    """Fills gravity (3,) half a period ahead, which is near the mean over the period."""
    half = 0.5 * world[PERIOD]
    interpolate(r[0] + half * v[0], r[1] + half * v[1], r[2] + half * v[2], scales, nodes, gravity)


@_inlined
def _law(r, v, gravity, world, u):
    """Fills the backup's thrust acceleration; returns the outward speed in m/s."""
    limit, cruise, spin = world[THRUST], world[CRUISE], world[SPIN]
    nx, ny, nz = r[0] / world[0] ** 2, r[1] / world[1] ** 2, r[2] / world[2] ** 2
    size = math.sqrt(nx * nx + ny * ny + nz * nz)
    nx, ny, nz = nx / size, ny / size, nz / size
    outward = nx * v[0] + ny * v[1] + nz * v[2]
    free = 1.0 - min(max(outward / cruise, 0.0), 1.0)
    for i in range(3):
        n = nx if i == 0 else ny if i == 1 else nz
        error = cruise * n - v[i]
        if error * n < 0.0:
            error *= 1.0 - free * min(abs(n) / _SIDEWAYS, 1.0)
        pull = gravity[i]
        if i == 0:
            pull += 2.0 * spin * v[1] + spin**2 * r[0]
        elif i == 1:
            pull += -2.0 * spin * v[0] + spin**2 * r[1]
        u[i] = _within(error / world[PERIOD] - pull, -limit, limit)
    return outward


@_inlined
def _advance(r, v, gravity, u, world, r_end, v_end):
    """Moves by one period; returns the least clearance on the way (m, a lower bound).

    Gravity and thrust are constant. Coriolis and centrifugal terms are expanded in Taylor's series.
    The path leaves its chord by at most the greatest acceleration times the period squared over 8.
    """
    spin, period = world[SPIN], world[PERIOD]
    ax = gravity[0] + u[0] + 2.0 * spin * v[1] + spin**2 * r[0]
    ay = gravity[1] + u[1] - 2.0 * spin * v[0] + spin**2 * r[1]
    az = gravity[2] + u[2]
    jx = 2.0 * spin * ay + spin**2 * v[0]
    jy = -2.0 * spin * ax + spin**2 * v[1]
    sx = 2.0 * spin * jy + spin**2 * ax
    sy = -2.0 * spin * jx + spin**2 * ay
    second, third, fourth = period**2 / 2.0, period**3 / 6.0, period**4 / 24.0
    ex = r[0] + period * v[0] + second * ax + third * jx + fourth * sx
    ey = r[1] + period * v[1] + second * ay + third * jy + fourth * sy
    ez = r[2] + period * v[2] + second * az

    # In units of the semi-axes the ellipsoid is a ball.
    px, py, pz = r[0] / world[0], r[1] / world[1], r[2] / world[2]
    dx, dy, dz = ex / world[0] - px, ey / world[1] - py, ez / world[2] - pz
    bx, by = (abs(ax) + period * abs(jx)) / world[0], (abs(ay) + period * abs(jy)) / world[1]
    along, length2 = px * dx + py * dy + pz * dz, dx * dx + dy * dy + dz * dz
    share = min(max(-along / length2, 0.0), 1.0) if length2 > 0.0 else 0.0
    px, py, pz = px + share * dx, py + share * dy, pz + share * dz
    bend = 0.125 * period**2 * math.sqrt(bx * bx + by * by + (az / world[2]) ** 2)
    level = math.sqrt(px * px + py * py + pz * pz)

    vx, vy = v[0] + period * ax + second * jx, v[1] + period * ay + second * jy
    v_end[0], v_end[1], v_end[2] = vx + third * sx, vy + third * sy, v[2] + period * az
    r_end[0], r_end[1], r_end[2] = ex, ey, ez
    return _clearance(level - bend, world)


@_inlined
def _clearance(level, world):
    """A lower bound of the distance (m) to the ellipsoid, from the level |(x/a, y/b, z/c)|."""
    return (level - 1.0) * min(world[0], world[1], world[2])


@_compiled
def backup_margin(r_start, v_start, scales, nodes, world):
    """The least clearance (m) if the backup flies from here on; -inf if it does not settle.

    It is a lower bound at and between the steps.
    """
    r, v, gravity, u = r_start.copy(), v_start.copy(), np.empty(3), np.empty(3)
    level2 = 0.0
    for i in range(3):
        level2 += (r[i] / world[i]) ** 2
    least = _clearance(math.sqrt(level2), world)
    for _ in range(_LONGEST_BACKUP):
        _gravity_ahead(r, v, scales, nodes, world, gravity)
        outward = _law(r, v, gravity, world, u)
        if outward >= _OUTWARD * world[CRUISE] and max(abs(v[0]), abs(v[1])) <= world[SETTLED]:
            return least
        least = min(least, _advance(r, v, gravity, u, world, r, v))
    return -math.inf


@_compiled
def backup(r, v, scales, nodes, world, u):
    """Fills the backup's thrust acceleration (3,) at a state."""
    gravity = np.empty(3)
    _gravity_ahead(r, v, scales, nodes, world, gravity)
    _law(r, v, gravity, world, u)


@_compiled
def margin(r, v, scales, nodes, world, u):
    """The least clearance (m) if u (3,) acts for one period and the backup flies after it."""
    gravity, r_end, v_end = np.empty(3), np.empty(3), np.empty(3)
    _gravity_ahead(r, v, scales, nodes, world, gravity)
    least = _advance(r, v, gravity, u, world, r_end, v_end)
    return min(least, backup_margin(r_end, v_end, scales, nodes, world))


@_compiled
def bound_speed(r, v, scales, nodes, world, u, low, high):
    """Changes u by the least that ends the period below the speed limit, as far as thrust allows.

    Fills the bounds of u (3,) by thrust and speed. Returns whether u was changed for speed.
    """
    gravity, r_end, v_end = np.empty(3), np.empty(3), np.empty(3)
    limit, period = world[THRUST], world[PERIOD]
    _gravity_ahead(r, v, scales, nodes, world, gravity)
    for i in range(3):
        u[i] = _within(u[i], -limit, limit)
    _advance(r, v, gravity, u, world, r_end, v_end)
    moved = max(abs(v_end[0]), abs(v_end[1]), abs(v_end[2])) > world[SPEED]
    # Coriolis couples the axes by spin times period, about 0.003: after three rounds the error is
    # the cube of that. The reduced speed leaves room for Coriolis within a period, and for a force
    # that is changed again later.
    speed = world[SPEED] - 2.0 * abs(world[SPIN]) * limit * period**2
    for _ in range(3):
        _advance(r, v, gravity, u, world, r_end, v_end)
        for i in range(3):
            high[i] = _within(u[i] + (speed - v_end[i]) / period, -limit, limit)
            low[i] = _within(u[i] - (speed + v_end[i]) / period, -limit, limit)
            if not moved:
                high[i], low[i] = max(high[i], u[i]), min(low[i], u[i])
            u[i] = _within(u[i], low[i], high[i])
    return moved
