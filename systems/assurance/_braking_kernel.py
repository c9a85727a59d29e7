"""Compiled kernel of backup braking: gravity from a table, the backup's law, its tube, speed limit.

Most functions share these arguments:

* ``tables``: those of an `OuterGravity`. ``world``: a record of the type `WORLD`.
* ``r``, ``v``: position (3,) in m and velocity (3,) in m/s in K; ``u``: thrust acceleration (3,).
* ``tube``: a `Tube`. ``work``: a `_Work`.

The law is eq. 23 of docs/method/equations.md, the tube eq. 24 to 27.
"""

import math
from typing import NamedTuple

import numpy as np

from proxops.systems.common import kernel
from proxops.systems.gravity import gravity_at

WORLD = np.dtype(
    [
        ("semi_axes", np.float64, 3),  # Of the inflated ellipsoid, in m.
        ("spin", np.float64),  # About z, in rad/s.
        ("thrust", np.float64),  # Greatest thrust acceleration per axis, in m/s^2.
        ("period", np.float64),  # Control period, in s.
        ("cruise", np.float64),  # Outward speed that the backup seeks, in m/s.
        ("settled", np.float64),  # Speed from which the backup always brakes, in m/s.
        ("speed", np.float64),  # Speed limit per axis, in m/s.
        # Bounds of errors.
        ("gravity", np.float64),  # Of gravity, over gravity.
        ("weak", np.float64),  # Share of the commanded thrust that may be missing.
        ("strong", np.float64),  # Share of the commanded thrust that may be too much.
        ("across", np.float64),  # Acceleration across a commanded thrust, over the greatest one.
        ("other", np.float64),  # All other accelerations along an axis, in m/s^2.
        ("position", np.float64),  # Of the position, in m.
        ("velocity", np.float64),  # Of the velocity along an axis, in m/s.
        ("steepness", np.float64),  # Spectral norm of the gradient on the ellipsoid, in 1/s^2.
        ("curvature", np.float64),  # Of the ellipsoid, in 1/m.
        ("outward", np.float64),  # Outward speed from which the backup brakes sideways, in m/s.
    ]
)
"""What the kernel knows of body, spacecraft and errors: a record with these fields.

It is no named tuple: a tuple's numbers lie in registers, and with them the compiler takes other
multiplications and sums as one operation, which changes last bits.
"""


class Tube(NamedTuple):
    """States about a middle one: all within half widths along each axis. Arrays (3,)."""

    r: np.ndarray
    v: np.ndarray
    wide: np.ndarray
    """Half width in position, in m."""
    fast: np.ndarray
    """Half width in velocity, in m/s."""


class _Work(NamedTuple):
    """Arrays (3,) that a step of the tube fills."""

    gravity: np.ndarray
    """Of the tube's middle, in m/s^2."""
    effect: np.ndarray
    """What thrust and all errors add to the middle's acceleration, in m/s^2."""
    spreads: np.ndarray
    """Half width of the acceleration, in m/s^2."""
    before: np.ndarray
    """The tube's half widths in position at the step's start, in m."""
    lows: np.ndarray
    highs: np.ndarray
    """Least and greatest components of the normals that the law may find."""


class _Axis(NamedTuple):
    """Bounds along one axis from which those of the law's acceleration follow."""

    least_n: float
    most_n: float
    """Of the normal's component."""
    v: float
    fast: float
    """Velocity of the tube's middle and half width, in m/s."""
    free: float
    """Acceleration of the tube's middle without thrust, in m/s^2."""
    spread: float
    """How far that of another state of the tube is from it, at most."""
    misjudged: float
    """How far the law is mistaken about it, at most."""
    settled: float
    """Speed in m/s from which the law always brakes."""


# Least level, |(x/a, y/b, z/c)|, for which bounds of curvature and of the gradient are evaluated.
_LOWEST_LEVEL = 0.95
# The level of places on the surface, with room for rounding.
SURFACE = 1.0 + 1e-12
# Steps after which a backup that does not fly outwards counts as failed.
_LONGEST_BACKUP = 300
# An axis with at most this share of the normal is braked even if it moves outwards.
_SIDEWAYS = 0.2

_compiled = kernel(error_model="numpy", fastmath={"contract"})
_inlined = kernel(error_model="numpy", fastmath={"contract"}, forceinline=True)


@_compiled
def gravity_outside(x, y, z, tables, out):
    """Fills gravity (3,) at a point; in the ellipsoid, that of the place on its surface above.

    Returns whether the table has it. If not, ``out`` is 0.
    """
    over_axes = tables.scales.over_axes
    wx, wy, wz = x * over_axes[0], y * over_axes[1], z * over_axes[2]
    level = math.sqrt(wx * wx + wy * wy + wz * wz)
    if level < 1.0:
        stretch = SURFACE / level
        x, y, z = stretch * x, stretch * y, stretch * z
    if gravity_at(tables, x, y, z, out):
        return True
    out[0] = out[1] = out[2] = 0.0
    return False


@_inlined
def _within(value, low, high):
    return min(max(value, low), high)


@_inlined
def _gravity_ahead(r, v, tables, world, gravity):
    """Fills gravity (3,) half a period ahead, which is near the mean over the period.

    Returns whether the table has it.
    """
    half = 0.5 * world.period
    x, y, z = r[0] + half * v[0], r[1] + half * v[1], r[2] + half * v[2]
    return gravity_outside(x, y, z, tables, gravity)


@_inlined
def _normal(r, world):
    """The normal (3 numbers) of the level through r, and the level |(x/a, y/b, z/c)|."""
    wx, wy, wz = r[0] / world.semi_axes[0], r[1] / world.semi_axes[1], r[2] / world.semi_axes[2]
    level = math.sqrt(wx * wx + wy * wy + wz * wz)
    nx, ny, nz = wx / world.semi_axes[0], wy / world.semi_axes[1], wz / world.semi_axes[2]
    size = math.sqrt(nx * nx + ny * ny + nz * nz)
    return nx / size, ny / size, nz / size, level


@_inlined
def _wanted(n, v, hold, settled, world):
    """The acceleration that the law wants along an axis: never falls with n, never rises with v.

    ``hold`` is the share to which an axis that moves outwards faster than c n is left alone.
    """
    error = world.cruise * n - v
    if error * n < 0.0:
        error *= 1.0 - hold * min(abs(n) / _SIDEWAYS, 1.0)
    if v > settled:
        error = min(error, settled - v)
    elif v < -settled:
        error = max(error, -settled - v)
    return error / world.period


@_inlined
def _settled(i, world):
    """The speed along axis i from which the law always brakes; Coriolis acts across the spin."""
    return world.settled if i < 2 else math.inf


@_inlined
def _coriolis(i, r, v, world):
    """Coriolis and centrifugal acceleration along axis i."""
    spin = world.spin
    if i == 0:
        return 2.0 * spin * v[1] + spin**2 * r[0]
    if i == 1:
        return -2.0 * spin * v[0] + spin**2 * r[1]
    return 0.0


@_inlined
def _law(r, v, gravity, world, u):
    """Fills the backup's thrust acceleration: eq. 23."""
    limit, cruise = world.thrust, world.cruise
    nx, ny, nz, level = _normal(r, world)
    # The outward speed, less what an error of the position may make of sideways speed, and less
    # what the axes that are faster than settled will lose.
    outward = nx * v[0] + ny * v[1] + nz * v[2]
    turned = world.curvature * world.position / level
    outward -= turned * (abs(v[0]) + abs(v[1]) + abs(v[2]))
    outward -= max(abs(v[0]) - world.settled, 0.0) + max(abs(v[1]) - world.settled, 0.0)
    hold = 1.0 - min(max((outward - world.outward) / cruise, 0.0), 1.0)
    for i in range(3):
        n = nx if i == 0 else ny if i == 1 else nz
        wanted = _wanted(n, v[i], hold, _settled(i, world), world)
        u[i] = _within(wanted - gravity[i] - _coriolis(i, r, v, world), -limit, limit)


@_inlined
def _normal_bounds(r, wide, world, lows, highs):
    """Fills the least and greatest components (3,) of the normals that the law may find.

    Those of a box about r, wider than the tube by what two errors of the position make: the tube's
    and that of the measurement. A component q / sqrt(q^2 + s) rises with its own q.
    """
    for i in range(3):
        least, most, low, high = 0.0, 0.0, 0.0, 0.0
        for j in range(3):
            middle = r[j] / world.semi_axes[j] ** 2
            half = (wide[j] + 2.0 * world.position) / world.semi_axes[j] ** 2
            if j == i:
                low, high = middle - half, middle + half
            else:
                least += max(abs(middle) - half, 0.0) ** 2
                most += (abs(middle) + half) ** 2
        lows[i] = low / math.sqrt(low * low + (most if low > 0.0 else least) + 1e-300)
        highs[i] = high / math.sqrt(high * high + (least if high > 0.0 else most) + 1e-300)


@_inlined
def _tube_is_outward(tube, world, lows, highs):
    """Whether the law finds that every state of the tube moves outwards fast enough."""
    r, v, wide, fast = tube
    _normal_bounds(r, wide, world, lows, highs)
    level = _normal(r, world)[3]
    outward, speed, reach = -world.velocity, 0.0, 0.0
    for i in range(3):
        slow, quick = v[i] - fast[i], v[i] + fast[i]
        outward += min(min(lows[i] * slow, lows[i] * quick), min(highs[i] * slow, highs[i] * quick))
        outward -= max(abs(v[i]) + fast[i] + world.velocity - _settled(i, world), 0.0)
        speed += abs(v[i]) + fast[i] + world.velocity
        reach += abs(r[i]) / world.semi_axes[i] ** 2 * wide[i]
    lowest = max(level - reach / level, _LOWEST_LEVEL)
    outward -= world.curvature / lowest * world.position * speed
    return outward > world.outward


@_inlined
def _spread(low, high, most, least, world):
    """Lower and upper bound of an axis's acceleration, with what thrust and all else may add.

    ``most`` and ``least`` are the bounds of the commanded thrust.
    """
    others = world.across * world.thrust + world.other
    missing = max(world.weak * max(most, 0.0), world.strong * max(-least, 0.0))
    excess = max(world.strong * max(most, 0.0), world.weak * max(-least, 0.0))
    return low - missing - others, high + excess + others


@_inlined
def _bounds_of_law(axis, world):
    """Bounds of an axis's acceleration, and of its commanded thrust, if the law flies: eq. 25.

    The law's wish never falls with n and never rises with v, and free + clip(wish - free) never
    falls with the acceleration `free` without thrust. So the ends of the tube give the ends of the
    acceleration.
    """
    least_n, most_n, v, fast, free, spread, misjudged, settled = axis
    limit, error = world.thrust, world.velocity
    low = _wanted(least_n, v - fast + error, 1.0, settled, world) - misjudged
    high = _wanted(most_n, v + fast - error, 1.0, settled, world) + misjudged
    bottom, top = free - spread, free + spread
    most, least = _within(high - bottom, -limit, limit), _within(low - top, -limit, limit)
    low = bottom + _within(low - bottom, -limit, limit)
    high = top + _within(high - top, -limit, limit)
    return low, high, most, least


@_inlined
def _tube_step(tube, u, by_law, tables, world, work, end):
    """Moves the tube by one period; returns a lower bound of its clearance on the way (m).

    These are eq. 24 to 27. It is -inf where the table has no gravity. The tube flies u (3,), or, if
    ``by_law``, the law without any sideways braking, for the bounds of the normal in ``work``. It
    ends at ``end``, position and velocity, which may be its own; its half widths and the rest of
    ``work`` are overwritten.
    """
    period, spin = world.period, abs(world.spin)
    r, v, wide, fast = tube
    gravity, effect, spreads, before, lows, highs = work
    known = _gravity_ahead(r, v, tables, world, gravity)
    level = _normal(r, world)[3]
    size2, reach = 0.0, 0.0
    for i in range(3):
        # The width half a period ahead.
        width = wide[i] + 0.5 * period * fast[i]
        size2 += width**2
        reach += abs(r[i]) / world.semi_axes[i] ** 2 * width
    size = math.sqrt(size2)
    lowest = max(level - reach / level, _LOWEST_LEVEL)
    steepness = world.steepness * (1.0 + world.gravity) / lowest**3
    for i in range(3):
        free = gravity[i] + _coriolis(i, r, v, world)
        # How far it may be from that of the tube's middle, and how far the law misjudges it.
        misjudged = world.gravity * abs(gravity[i]) + steepness * world.position
        spread = misjudged + steepness * size
        if i < 2:
            spread += 2.0 * spin * fast[1 - i] + spin**2 * (wide[i] + world.position)
            misjudged += 2.0 * spin * world.velocity + spin**2 * world.position
        if by_law:
            settled = _settled(i, world)
            axis = _Axis(lows[i], highs[i], v[i], fast[i], free, spread, misjudged, settled)
            low, high, most, least = _bounds_of_law(axis, world)
        else:
            most = least = u[i]
            low, high = free + u[i] - spread, free + u[i] + spread
        low, high = _spread(low, high, most, least, world)
        effect[i], spreads[i] = 0.5 * (low + high) - free, 0.5 * (high - low)
    for i in range(3):
        before[i] = wide[i]
        wide[i] = max(wide[i] + period * fast[i] + 0.5 * period**2 * spreads[i], 0.0)
        fast[i] = max(fast[i] + period * spreads[i], 0.0)
    clearance = _advance(tube, work, world, end)
    return clearance if known else -math.inf


@_inlined
def _advance(tube, work, world, end):
    """Moves by one period; returns the least clearance on the way (m, a lower bound).

    Gravity and thrust are constant. Coriolis and centrifugal terms are expanded in Taylor's series.
    The path leaves its chord by at most the greatest acceleration times the period squared over 8.
    The ellipsoid's level is convex. So about the whole path it is at least what its tangent plane
    at the chord's lowest point says. The tube's half widths are those of ``work`` before the step
    and its own after it. The accelerations ``spreads`` change them.
    """
    r, v, after, _ = tube
    gravity, u, spreads, before, _, _ = work
    r_end, v_end = end
    spin, period = world.spin, world.period
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
    px, py, pz = r[0] / world.semi_axes[0], r[1] / world.semi_axes[1], r[2] / world.semi_axes[2]
    dx, dy, dz = (
        ex / world.semi_axes[0] - px,
        ey / world.semi_axes[1] - py,
        ez / world.semi_axes[2] - pz,
    )
    bx, by = (
        (abs(ax) + period * abs(jx)) / world.semi_axes[0],
        (abs(ay) + period * abs(jy)) / world.semi_axes[1],
    )
    along, length2 = px * dx + py * dy + pz * dz, dx * dx + dy * dy + dz * dz
    share = min(max(-along / length2, 0.0), 1.0) if length2 > 0.0 else 0.0
    px, py, pz = px + share * dx, py + share * dy, pz + share * dz
    bend = 0.125 * period**2 * math.sqrt(bx * bx + by * by + (az / world.semi_axes[2]) ** 2)
    level = max(math.sqrt(px * px + py * py + pz * pz), 1e-3)
    # The tangent plane's level at both ends; between them a tube that grows narrower is wider.
    slope = (px * dx + py * dy + pz * dz) / level
    first, last = -share * slope, (1.0 - share) * slope
    for i in range(3):
        steep = abs(px if i == 0 else py if i == 1 else pz) / (level * world.semi_axes[i])
        first, last = first - steep * before[i], last - steep * after[i]
        bend += 0.125 * period**2 * steep * max(-spreads[i], 0.0)

    vx, vy = v[0] + period * ax + second * jx, v[1] + period * ay + second * jy
    v_end[0], v_end[1], v_end[2] = vx + third * sx, vy + third * sy, v[2] + period * az
    r_end[0], r_end[1], r_end[2] = ex, ey, ez
    return _clearance(level + min(first, last) - bend, world)


@_inlined
def _clearance(level, world):
    """A lower bound of the distance (m) to the ellipsoid, from the level |(x/a, y/b, z/c)|.

    Inside, where it is negative, only its sign counts.
    """
    return (level - 1.0) * min(world.semi_axes[0], world.semi_axes[1], world.semi_axes[2])


@_compiled
def _tube_margin(tube, least, tables, world, work):
    """The least of ``least`` and the clearances (m) of a tube that the law flies on.

    It is -inf if the tube does not move outwards in the end. All arrays are overwritten.
    """
    for _ in range(_LONGEST_BACKUP):
        if _tube_is_outward(tube, world, work.lows, work.highs):
            return least
        clearance = _tube_step(tube, work.gravity, True, tables, world, work, (tube.r, tube.v))
        least = min(least, clearance)
    return -math.inf


@_inlined
def _work(rows):
    """A `_Work` in an array (6, 3) that is yet to be filled."""
    return _Work(rows[0], rows[1], rows[2], rows[3], rows[4], rows[5])


@_compiled
def backup_margin(r_start, v_start, tables, world):
    """The least clearance (m) if the backup flies from here on; -inf if it ends nowhere.

    It is a lower bound at and between the steps, for every error within the bounds.
    """
    rows = np.empty((10, 3))
    r, v, wide, fast = rows[0], rows[1], rows[2], rows[3]
    for i in range(3):
        r[i], v[i], wide[i], fast[i] = r_start[i], v_start[i], 0.0, world.velocity
    least = _clearance(_normal(r, world)[3], world)
    return _tube_margin(Tube(r, v, wide, fast), least, tables, world, _work(rows[4:]))


@_compiled
def backup(r, v, tables, world, u):
    """Fills the backup's thrust acceleration (3,) at a state."""
    gravity = np.empty(3)
    _gravity_ahead(r, v, tables, world, gravity)
    _law(r, v, gravity, world, u)


@_compiled
def margin(r_start, v_start, tables, world, u):
    """The least clearance (m) if u (3,) acts for one period and the backup flies after it."""
    rows = np.empty((10, 3))
    r, v, wide, fast, work = rows[0], rows[1], rows[2], rows[3], _work(rows[4:])
    for i in range(3):
        wide[i], fast[i] = 0.0, world.velocity
    least = _tube_step(Tube(r_start, v_start, wide, fast), u, False, tables, world, work, (r, v))
    return _tube_margin(Tube(r, v, wide, fast), least, tables, world, work)


@_compiled
def bound_speed(r, v, tables, world, u, low, high):
    """Changes u by the least that ends the period below the speed limit, as far as thrust allows.

    Every state of the tube stays below the limit. Fills the bounds of u (3,) by thrust and speed.
    Returns whether u was changed for speed.
    """
    rows = np.empty((10, 3))
    r_end, v_end, wide, fast, work = rows[0], rows[1], rows[2], rows[3], _work(rows[4:])
    tube = Tube(r, v, wide, fast)
    limit, period = world.thrust, world.period
    for i in range(3):
        u[i] = _within(u[i], -limit, limit)
        wide[i], fast[i] = 0.0, world.velocity
    _tube_step(tube, u, False, tables, world, work, (r_end, v_end))
    moved = False
    for i in range(3):
        moved = moved or abs(v_end[i]) + fast[i] > world.speed
    # Coriolis couples the axes by spin times period, about 0.003: after three rounds the error is
    # the cube of that. The reduced speed leaves room for Coriolis within a period, and for a force
    # that is changed again later.
    speed = world.speed - 2.0 * abs(world.spin) * limit * period**2
    for _ in range(3):
        for i in range(3):
            wide[i], fast[i] = 0.0, world.velocity
        _tube_step(tube, u, False, tables, world, work, (r_end, v_end))
        for i in range(3):
            high[i] = _within(u[i] + (speed - fast[i] - v_end[i]) / period, -limit, limit)
            low[i] = _within(u[i] - (speed - fast[i] + v_end[i]) / period, -limit, limit)
            if not moved:
                high[i], low[i] = max(high[i], u[i]), min(low[i], u[i])
            u[i] = _within(u[i], low[i], high[i])
    return moved
