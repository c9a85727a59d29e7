"""Flights by adversaries: controllers that try to hit the body, with or without runtime assurance.

These are plain functions; they make no Diagram. The motion is integrated with polyhedral gravity.
It shares no code with the prediction that runtime assurance makes. `box_worlds` has the worlds and
the errors of the state in which they fly.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import asdict, dataclass

import numpy as np

from proxops.diagrams.flight.box_worlds import StateErrors, Truth, check_known, outward_normal
from proxops.diagrams.flight.scenario_systems import make_backup
from proxops.diagrams.logs import dense_positions
from proxops.diagrams.scenario import AssuranceConfig, Body, Scenario, TransitConfig
from proxops.systems.assurance import AssuranceBounds, BackupBraking, InterventionReason
from proxops.systems.shapes import clearances
from proxops.systems.vehicle import runge_kutta_step

# The adversary along the surface keeps its course for at most this many steps.
_LONGEST_COURSE = 60
# This share of the starts is nearer to the keep-out ellipsoid than a transit may begin.
_NEAR_SHARE = 0.5
# This share of the starts is at the edge of what is admitted, found by so many bisections.
_EDGE_SHARE, _BISECTIONS = 0.5, 20

# Height, as a share of the ellipsoid's size, at which a small controller feels the ellipsoid.
_LOW = 0.03

Adversary = Callable[[np.ndarray], np.ndarray]
"""Gives a force (3,) in N for a state (6,)."""


def _at_the_body(backup: BackupBraking, random: np.random.Generator) -> Adversary:
    """Thrusts fully towards the body's centre."""
    limit = backup.limits.thrust
    return lambda state: -limit * state[:3] / np.abs(state[:3]).max()


def _zero(backup: BackupBraking, random: np.random.Generator) -> Adversary:
    """Commands nothing."""
    return lambda state: np.zeros(3)


def _random(backup: BackupBraking, random: np.random.Generator) -> Adversary:
    """Draws any force within the limits at each step."""
    limit = backup.limits.thrust
    return lambda state: random.uniform(-limit, limit, 3)


def _sign_flipped(backup: BackupBraking, random: np.random.Generator) -> Adversary:
    """Commands the opposite of the force that would leave the body at the speed limit."""
    limits = backup.limits

    def force(state: np.ndarray) -> np.ndarray:
        leaving = limits.speed * state[:3] / np.abs(state[:3]).max()
        wanted = limits.mass / backup.period * (leaving - state[3:])
        return -np.clip(wanted, -limits.thrust, limits.thrust)

    return force


def _along_the_surface(backup: BackupBraking, random: np.random.Generator) -> Adversary:
    """Thrusts fully along the surface and slightly inwards, and changes its course at random."""
    limit, left, course = backup.limits.thrust, 0, np.zeros(3)

    def force(state: np.ndarray) -> np.ndarray:
        nonlocal left, course
        if left == 0:
            left, course = int(random.integers(1, _LONGEST_COURSE)), random.normal(size=3)
        left -= 1
        normal = outward_normal(backup.limits.keep_out_semi_axes, state[:3])
        along = course - (course @ normal) * normal
        return limit * np.sign(along / np.linalg.norm(along) - 0.3 * normal)

    return force


def small_controller(backup: BackupBraking, weights: np.ndarray) -> Adversary:
    """A controller with few weights, for a search; it thrusts along normal and sideways motion.

    Args:
      backup: gives the limits.
      weights: `CONTROLLER_SHAPE`: of the normal, the sideways velocity and what is across both, by
        a constant, height, outward and sideways speed, and two components of the normal.
    """
    limits = backup.limits
    axes = np.asarray(limits.keep_out_semi_axes)

    def force(state: np.ndarray) -> np.ndarray:
        normal = outward_normal(axes, state[:3])
        outward = float(normal @ state[3:])
        sideways = state[3:] - outward * normal
        speed = float(np.linalg.norm(sideways))
        along = sideways / speed if speed > 0.0 else np.zeros(3)
        height = (np.linalg.norm(state[:3] / axes) - 1.0) / _LOW
        features = [
            1.0,
            np.tanh(height),
            outward / (0.25 * limits.speed),
            speed / limits.speed,
            abs(normal[0]),
            abs(normal[1]),
        ]
        wish = np.tanh(weights @ features)
        total = wish[0] * normal + wish[1] * along + wish[2] * np.cross(normal, along)
        return np.clip(2.0 * limits.thrust * total, -limits.thrust, limits.thrust)

    return force


CONTROLLER_SHAPE = (3, 6)
# What `benchmarks/assurance.py --bounds after_survey --search 10 --steps 300 --seed 500` found. It
# presses inwards and speeds up along the surface.
_SEARCHED = np.array([
    [-3.3, -0.6, -0.6, -0.7, -0.1, -0.8],
    [1.0, -0.7, 0.4, -0.9, -0.5, 0.7],
    [4.1, -0.5, -3.1, -0.5, -1.2, 0.5],
])  # fmt: skip


def _searched(backup: BackupBraking, random: np.random.Generator) -> Adversary:
    """The small controller that a search found to come closest to the ellipsoid."""
    return small_controller(backup, _SEARCHED)


ADVERSARIES: dict[str, Callable[[BackupBraking, np.random.Generator], Adversary]] = {
    "zero": _zero,
    "at the body": _at_the_body,
    "random": _random,
    "sign flipped": _sign_flipped,
    "along the surface": _along_the_surface,
    "searched": _searched,
}


@dataclass(frozen=True)
class AdversarialFlight:
    """The record of one flight; all vectors are in K."""

    states: np.ndarray
    """True states (N + 1, 6) at the steps, in m and m/s."""
    believed: np.ndarray
    """Believed states (N, 6) at the steps."""
    forces: np.ndarray
    """Forces (N, 3) that runtime assurance let through, in N."""
    commands: np.ndarray
    """Forces (N, 3) that the adversary commanded, in N."""
    reasons: np.ndarray
    """`InterventionReason` (N,) of each step."""
    clearance: float
    """Least clearance along the whole path, in m, from the ellipsoid about the true body."""
    speed: float
    """Greatest speed along an axis, in m/s."""
    step_seconds: np.ndarray
    """Processor time (N,) of runtime assurance at each step, in s; zeros without it."""


def random_admitted_state(
    backup: BackupBraking, transit: TransitConfig, random: np.random.Generator
) -> np.ndarray:
    """Draws an admitted state (6,) in a cube, half of the time close to the keep-out ellipsoid.

    Half of the states are at the edge of what is admitted: moved down the normal until no lower
    state would be admitted.

    Args:
      backup: decides which states are admitted.
      transit: gives the cube, and with `end_clearance_m` what is close.
      random: source of the draws.
    """
    axes, speed = backup.limits.keep_out_semi_axes, backup.limits.speed
    cube, near = transit.cube_m, transit.end_clearance_m
    while True:
        position = random.uniform(-0.5 * cube, 0.5 * cube, 3)
        if random.random() < _NEAR_SHARE:
            position *= 1.0 / np.linalg.norm(position / axes)
            position += random.uniform(0.0, near) * outward_normal(axes, position)
        state = np.concatenate([position, random.uniform(-speed, speed, 3)])
        if backup.admitted(state):
            return _lowered(backup, state) if random.random() < _EDGE_SHARE else state


def _lowered(backup: BackupBraking, state: np.ndarray) -> np.ndarray:
    """The lowest admitted state (6,) towards the ellipsoid, by bisection."""
    axes = backup.limits.keep_out_semi_axes
    high, low = state, state.copy()
    low[:3] /= np.linalg.norm(low[:3] / axes)
    for _ in range(_BISECTIONS):
        middle = 0.5 * (high + low)
        if backup.admitted(middle):
            high = middle
        else:
            low = middle
    return high


def adversarial_flight(
    scenario: Scenario,
    body: Body,
    name: str,
    seed: int,
    steps: int = 600,
    assured: bool = True,
    *,
    backup: BackupBraking | None = None,
    truth: str = "as believed",
    state_errors: str = "none",
    adversary: Adversary | None = None,
    excess: float = 1.0,
) -> AdversarialFlight:
    """Flies one adversary from a random admitted state; the result depends on the arguments alone.

    Args:
      scenario: gives the spacecraft, the control period and the settings of runtime assurance.
      body: the body, as it is believed.
      name: one of `ADVERSARIES`.
      seed: seed of the start, of the adversary's draws and of the world's.
      steps: number of control steps.
      assured: whether runtime assurance filters the commands.
      backup: of the body; None: as the scenario says.
      truth: one of `TRUTHS`.
      state_errors: one of `STATE_ERRORS`.
      adversary: flies instead of the named one.
      excess: the worlds and state errors are drawn from bounds that are greater by this factor.

    Raises:
      InputError: there is no adversary, truth or error of the state of this name; see also
        `make_backup`.
    """
    check_known("adversary", name, ADVERSARIES)
    if backup is None:
        backup = make_backup(scenario, body, scenario.assurance or AssuranceConfig())
    random = np.random.default_rng(seed)
    believed = random_admitted_state(backup, scenario.transit, random)
    adversary = ADVERSARIES[name](backup, random) if adversary is None else adversary
    period, limits = scenario.control_period_s, backup.limits
    axes, box = np.asarray(limits.keep_out_semi_axes), enlarged(backup.bounds, excess)
    world = Truth(truth, box, axes, np.random.default_rng([seed, 1]))
    error_of = StateErrors(state_errors, box, axes, np.random.default_rng([seed, 2]), steps)
    error = error_of(believed)
    state = believed - error
    states, beliefs, forces, commands, reasons = [state], [], [], [], []
    seconds, speed = np.zeros(steps), 0.0
    for step in range(steps):
        believed = state + (error if step == 0 else error_of(state))
        command = adversary(state)
        force, reason = command, InterventionReason.NONE
        if assured:
            started = time.thread_time()
            force, reason, _ = backup.assure(believed, command)
            seconds[step] = time.thread_time() - started
        acting, other = world.act(state, force)
        acceleration = acting / (world.mass * limits.mass) + other
        state = moved(state, acceleration, period, body, world.gravity)
        speed = max(speed, float(np.abs(state[3:]).max()))
        states.append(state)
        beliefs.append(believed)
        forces.append(force)
        commands.append(command)
        reasons.append(reason)
    path = dense_positions(period * np.arange(steps + 1), np.array(states))
    clearance = float(clearances(axes, path).min()) - box.surface
    return AdversarialFlight(
        np.array(states), np.array(beliefs), np.array(forces), np.array(commands),
        np.array(reasons), clearance, speed, seconds,
    )  # fmt: skip


def enlarged(bounds: AssuranceBounds, factor: float) -> AssuranceBounds:
    """The bounds of everything that acts in a flight, times a factor."""
    if factor == 1.0:
        return bounds
    return AssuranceBounds(**{name: factor * value for name, value in asdict(bounds).items()})


def moved(
    state: np.ndarray, acceleration: np.ndarray, period: float, body: Body, gravity: float
) -> np.ndarray:
    """The state (6,) after a period under a constant acceleration (3,).

    Gravity is linear about a point in the middle of the way: off by less than a millimetre after
    10 s at Kleopatra. The equations are then linear too; the Runge-Kutta method solves them.

    Args:
      state: (6,) in K, in m and m/s.
      acceleration: (3,) by thrust and all that is unexplained, in m/s^2.
      period: in s.
      body: its gravity and spin.
      gravity: true size of its gravity over the believed one.
    """
    spin = body.spin_rate
    middle = state[:3] + 0.5 * period * state[3:]
    field = body.gravity_field.evaluate(middle[None])
    slope, constant = np.zeros((6, 6)), np.zeros(6)
    slope[3:, :3] = gravity * field.gradient[0]
    constant[3:] = gravity * field.acceleration[0] - slope[3:, :3] @ middle + acceleration
    slope[0, 3] = slope[1, 4] = slope[2, 5] = 1.0
    slope[3, 0] += spin**2
    slope[4, 1] += spin**2
    slope[3, 4], slope[4, 3] = 2.0 * spin, -2.0 * spin
    return runge_kutta_step(lambda at: slope @ at + constant, state, period)
