"""Samples the end of runtime assurance's argument: once outwards, does outward speed stay positive?

States are drawn near the ellipsoid, at up to the speed limit along each axis, with just the outward
speed from which the backup's law begins to brake sideways, as the law finds it. From there the law
flies for half an hour, in a world that hurts most at each step (weak thrust that is turned inwards,
strong gravity, much mass, all unexplained acceleration inwards), with each kind of state errors.
Gravity is the assurance's own table; the motion is integrated by Runge-Kutta.
"""

import math
import sys

import numpy as np

from proxops.systems.assurance import BackupBraking
from proxops.systems.assurance import _braking_kernel as braking
from proxops.systems.common import kernel, spread_directions

ERRORS = ("flattering", "jumping", "flipping", "none")
# Greatest level above 1 at the start, and control steps of a flight.
_HIGHEST, _STEPS = 0.1, 180


@kernel(error_model="numpy")
def rate(x, v, push, gravity, spin, tables, out):
    braking.gravity_outside(x[0], x[1], x[2], tables, out)
    out *= gravity
    out += push
    out[0] += 2.0 * spin * v[1] + spin**2 * x[0]
    out[1] += -2.0 * spin * v[0] + spin**2 * x[1]


@kernel(error_model="numpy")
def hurt(u, normal, thrust, angle):
    """The acceleration that acts if thrust is weak outwards, strong inwards and turned inwards."""
    acting = u * (1.0 - thrust * np.sign(u * normal))
    size = np.sqrt(np.sum(acting**2))
    if size == 0.0:
        return acting
    along = acting / size
    inwards = -np.sum(normal * along)
    across = -normal - inwards * along
    length = np.sqrt(np.sum(across**2))
    if length < 1e-9:
        return acting
    angle = min(angle, np.arctan2(length, inwards))
    return size * (np.cos(angle) * along + np.sin(angle) * across / length)


@kernel(error_model="numpy")
def fly(r, v, errors, axes, box, steps, seed, tables, world):
    """Least outward speed (m/s) of a flight by the law, and the greatest fall of its level."""
    np.random.seed(seed)  # noqa: NPY002
    gravity, thrust, angle, mass, other, position, velocity = box
    spin, period = world.spin, world.period
    u, a1, a2, a3, a4 = np.empty(3), np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    least, down, highest = np.inf, 0.0, 0.0
    for step in range(steps):
        normal = r / axes**2
        normal /= np.sqrt(np.sum(normal**2))
        level = np.sqrt(np.sum((r / axes) ** 2))
        highest = max(highest, level)
        down = max(down, highest - level)
        least = min(least, np.sum(normal * v))
        error = normal.copy()
        if errors == 1:
            error = np.random.normal(0.0, 1.0, 3)  # noqa: NPY002
            error /= np.sqrt(np.sum(error**2))
        elif errors == 2 and step % 2 == 0:
            error = -error
        elif errors == 3:
            error *= 0.0
        braking.backup(r + position * error, v + velocity * error, tables, world, u)
        push = hurt(u, normal, thrust, angle) / (1.0 + mass) - other * np.sign(normal)
        strong, half = 1.0 + gravity, 0.5 * period
        rate(r, v, push, strong, spin, tables, a1)
        v2 = v + half * a1
        rate(r + half * v, v2, push, strong, spin, tables, a2)
        v3 = v + half * a2
        rate(r + half * v2, v3, push, strong, spin, tables, a3)
        v4 = v + period * a3
        rate(r + period * v3, v4, push, strong, spin, tables, a4)
        r = r + period / 6.0 * (v + 2.0 * (v2 + v3) + v4)
        v = v + period / 6.0 * (a1 + 2.0 * (a2 + a3) + a4)
    return least, down


def starts(backup, bounds, count: int, random: np.random.Generator) -> np.ndarray:
    """States at which the law, if it is flattered, begins to brake sideways."""
    world, axes = backup.world, np.asarray(backup.limits.keep_out_semi_axes)
    position = random.permutation(spread_directions(count)) * axes
    position *= random.uniform(1.0, 1.0 + _HIGHEST, (count, 1))
    normal = position / axes**2
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    velocity = random.uniform(-1.0, 1.0, (count, 3)) * backup.limits.speed
    for _ in range(60):
        turned = world.curvature * world.position * np.abs(velocity).sum(axis=1)
        excess = np.maximum(np.abs(velocity[:, :2]) - world.settled, 0.0).sum(axis=1)
        found = np.einsum("ni,ni->n", normal, velocity) - turned - excess + bounds.velocity_m_s
        velocity += (world.outward - found)[:, None] * normal
    kept = np.abs(velocity).max(axis=1) <= backup.limits.speed
    return np.concatenate([position, velocity], axis=1)[kept]


def sample_end(backup: BackupBraking, title: str, count: int, seed: int) -> None:
    """Prints the least outward speed and how far any state came down, for each kind of errors.

    Ends the program with an error if one came down by more than a metre.
    """
    bounds = backup.bounds
    axes = np.asarray(backup.limits.keep_out_semi_axes, dtype=np.float64)
    box = np.array([
        bounds.gravity, bounds.thrust, math.radians(bounds.thrust_direction_deg),
        bounds.mass, bounds.acceleration_m_s2, bounds.position_m, bounds.velocity_m_s,
    ])  # fmt: skip
    worst = 0.0
    for number, errors in enumerate(ERRORS):
        states = starts(backup, bounds, count, np.random.default_rng(seed))
        found = np.array([
            fly(row[:3].copy(), row[3:].copy(), number, axes, box, _STEPS, seed + k,
                *backup.arguments)
            for k, row in enumerate(states)
        ])  # fmt: skip
        fall = found[:, 1].max() * axes.max()  # In m, at most: as at the long ends.
        worst = max(worst, fall)
        print(
            f"{title}, {errors}: {len(states)} states, least outward speed "
            f"{found[:, 0].min():.3f} m/s, {np.mean(found[:, 0] <= 0.0):.3%} of them not outwards "
            f"at some step, greatest fall {fall:.2f} m",
            flush=True,
        )
        low = states[int(found[:, 0].argmin())]
        print("  lowest from", np.array2string(low, precision=4))
    if worst > 1.0:
        sys.exit("outward speed does not stay positive")
