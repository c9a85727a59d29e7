"""Adversaries that try to hit the body, and worlds and state errors that help them, within bounds.

A *truth* says how gravity, mass, thrust and unexplained acceleration differ from what is believed;
*state errors* say how far the believed state is from the true one. Both are drawn once for each
flight and then act at each step. The motion is integrated with polyhedral gravity. Nothing of the
prediction that runtime assurance makes is used. Vectors are in K.
"""

import math
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace

import numpy as np

from proxops.diagrams.flight import make_backup
from proxops.diagrams.logs import dense_positions
from proxops.diagrams.scenario import AssuranceConfig, Body, Scenario, TransitConfig
from proxops.diagrams.scenario.bounds import tumbling
from proxops.systems.assurance import AssuranceBounds, BackupBraking, InterventionReason
from proxops.systems.common import cross_matrix
from proxops.systems.gravity import greatest_tide, moon_position, tide_of
from proxops.systems.shapes import clearances
from proxops.systems.vehicle import runge_kutta_step

# Mean number of steps for which a truth that turns keeps its mood.
_MOOD = 20.0
# Change of a drawn truth from step to step, as a share of the bound.
_WANDER = 0.1
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


def outward_normal(semi_axes: np.ndarray, position: np.ndarray) -> np.ndarray:
    """The unit normal (3,), at a position (3,) in m, of the ellipsoid's level there."""
    normal = position / semi_axes**2
    return normal / np.linalg.norm(normal)


def _turned(force: np.ndarray, toward: np.ndarray, angle: float) -> np.ndarray:
    """A force (3,) turned by at most an angle in rad towards a direction (3,)."""
    size = np.linalg.norm(force)
    if size == 0.0 or angle == 0.0:
        return force
    along = force / size
    across = toward - (toward @ along) * along
    length = np.linalg.norm(across)
    if length < 1e-9:
        return force
    angle = min(angle, math.atan2(length, float(toward @ along)))
    return size * (math.cos(angle) * along + math.sin(angle) * across / length)


TRUTHS = ("as believed", "corner", "drawn", "hurting", "helping", "turning")
STATE_ERRORS = (
    "none", "constant", "flattering", "drifting", "jumping", "flipping", "sideways",
)  # fmt: skip


@dataclass
class Truth:
    """How one world differs, within its bounds.

    Kinds:
      as believed: it does not.
      corner: everything is at one end of its bounds for the whole flight, drawn at random.
      drawn: everything is somewhere between, and what may vary wanders.
      hurting: what may vary hurts the most outward acceleration at each step.
      helping: the opposite, so that the spacecraft does more than it is asked to.
      turning: hurting and helping in turn, for random times.
    """

    kind: str
    bounds: AssuranceBounds
    semi_axes: np.ndarray
    random: np.random.Generator

    def __post_init__(self):
        assert self.kind in TRUTHS
        bounds, random = self.bounds, self.random
        size = {"as believed": 0.0, "drawn": 1.0}.get(self.kind)
        ends = random.choice([-1.0, 1.0], 2)
        if size is not None:
            ends = size * random.uniform(-1.0, 1.0, 2)
        elif self.kind != "corner" and random.random() < 0.7:
            # Heavy and strongly attracted, mostly.
            ends = np.ones(2)
        self.gravity = 1.0 + bounds.gravity * float(ends[0])
        self.mass = 1.0 + bounds.mass * float(ends[1])
        self._thrust = random.choice([-1.0, 1.0], 3)
        self._push = random.choice([-1.0, 1.0], 3)
        self._axis = random.normal(size=3)
        if self.kind == "drawn":
            self._thrust, self._push = random.uniform(-1.0, 1.0, (2, 3))
        self._hurts, self._left = bool(random.random() < 0.5), 0

    def act(self, state: np.ndarray, force: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The force (3,) in N and the other acceleration (3,) in m/s^2 of the next period."""
        bounds, kind = self.bounds, self.kind
        if kind == "as believed":
            return force, np.zeros(3)
        if kind == "drawn":
            step = self.random.uniform(-_WANDER, _WANDER, (2, 3))
            self._thrust = np.clip(self._thrust + step[0], -1.0, 1.0)
            self._push = np.clip(self._push + step[1], -1.0, 1.0)
        if kind in ("corner", "drawn"):
            scaled = (1.0 + bounds.thrust * self._thrust) * force
            return _turned(scaled, self._axis, math.radians(bounds.thrust_direction_deg)), (
                bounds.acceleration_m_s2 * self._push
            )
        if kind == "turning":
            if self._left <= 0:
                self._hurts = not self._hurts
                self._left = int(self.random.exponential(_MOOD)) + 1
            self._left -= 1
        hurts = self._hurts if kind == "turning" else kind == "hurting"
        normal = outward_normal(self.semi_axes, state[:3]) * (1.0 if hurts else -1.0)
        scaled = force * (1.0 - bounds.thrust * np.sign(force * normal))
        turned = _turned(scaled, -normal, math.radians(bounds.thrust_direction_deg))
        return turned, -bounds.acceleration_m_s2 * np.sign(normal)


@dataclass
class StateErrors:
    """How far the believed state is from the true one, within its bounds.

    Kinds:
      none: it is not.
      constant: by all that is allowed, in one direction.
      flattering: belief is higher, and moves outwards faster, by all that is allowed.
      drifting: from the opposite of that to that, over half of the flight, and on from there.
      jumping: by all that is allowed, in any direction, at each step.
      flipping: flattering at every other step, the opposite in between.
      sideways: along the surface, turning slowly.
    """

    kind: str
    bounds: AssuranceBounds
    semi_axes: np.ndarray
    random: np.random.Generator
    steps: int

    def __post_init__(self):
        assert self.kind in STATE_ERRORS
        self._directions = self.random.normal(size=(2, 3))
        self._step = 0

    def __call__(self, state: np.ndarray) -> np.ndarray:
        """The error (6,) of the belief at this step, in m and m/s, at a true state (6,)."""
        normal = outward_normal(self.semi_axes, state[:3])
        step = self._step
        self._step += 1
        if self.kind == "none":
            return np.zeros(6)
        if self.kind == "constant":
            position, velocity = self._directions
        elif self.kind == "jumping":
            position, velocity = self.random.normal(size=(2, 3))
        elif self.kind == "sideways":
            axis, other = np.linalg.qr(np.c_[normal, self._directions[0], self._directions[1]])[
                0
            ].T[1:]
            position = velocity = math.cos(0.05 * step) * axis + math.sin(0.05 * step) * other
        else:
            position = velocity = normal
        position = self.bounds.position_m * position / np.linalg.norm(position)
        velocity = self.bounds.velocity_m_s * velocity / np.linalg.norm(velocity)
        size = 1.0
        if self.kind == "drifting":
            size = min(4.0 * step / self.steps - 1.0, 1.0)
        elif self.kind == "flipping":
            size = 1.0 if step % 2 else -1.0
        return size * np.concatenate([position, velocity])


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

    The weights are `CONTROLLER_SHAPE`: of the normal, the sideways velocity and what is across
    both, by a constant, height, outward and sideways speed, and two components of the normal.
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
    """An admitted state (6,) in the cube: half close to the ellipsoid, half at the edge of it."""
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

    `adversary` flies instead of the one of `ADVERSARIES` that is named. Worlds and state errors are
    drawn from bounds that are greater by the factor `excess`.
    """
    if backup is None:
        backup = make_backup(scenario, body, scenario.assurance or AssuranceConfig())
    random = np.random.default_rng(seed)
    believed = random_admitted_state(backup, scenario.transit, random)
    adversary = ADVERSARIES[name](backup, random) if adversary is None else adversary
    period, limits = scenario.control_period_s, backup.limits
    axes, box = np.asarray(limits.keep_out_semi_axes), enlarged(backup.bounds, excess)
    # Tumbling and moons act as they are, so what pushes beside them has the rest of its bound.
    known = tumbling(body, limits.speed)
    known += greatest_tide(body.config.moons, 2.0 * float(axes.max()), body.moon_depths)
    box = replace(box, acceleration_m_s2=max(box.acceleration_m_s2 - known, 0.0))
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
        state = moved(state, acceleration, period, body, world.gravity, period * step)
        speed = max(speed, float(np.abs(state[3:]).max()))
        states.append(state)
        beliefs.append(believed)
        forces.append(force)
        commands.append(command)
        reasons.append(reason)
    path = dense_positions(period * np.arange(steps + 1), np.array(states))
    clearance = float(clearances(axes, path).min()) - box.surface_m
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
    state: np.ndarray,
    acceleration: np.ndarray,
    period: float,
    body: Body,
    gravity: float,
    time: float = 0.0,
) -> np.ndarray:
    """The state (6,) after a period under a constant acceleration (3,), from a time in s on.

    Gravity is linear about a point in the middle of the way: off by less than a millimetre after
    10 s at Kleopatra. The equations are then linear too; the Runge-Kutta method solves them.
    `gravity` is its true size over the believed one. Rotation and moons are as in the middle.
    """
    now = time + 0.5 * period
    turn = cross_matrix(body.spin.angular_velocity(now))
    change = cross_matrix(body.spin.angular_acceleration(now))
    middle = state[:3] + 0.5 * period * state[3:]
    field = body.gravity_field.evaluate(middle[None])
    slope, constant = np.zeros((6, 6)), np.zeros(6)
    slope[3:, :3] = gravity * field.gradient[0]
    constant[3:] = gravity * field.acceleration[0] - slope[3:, :3] @ middle + acceleration
    slope[0, 3] = slope[1, 4] = slope[2, 5] = 1.0
    slope[3:, :3] -= turn @ turn + change
    slope[3:, 3:] -= 2.0 * turn
    for moon in body.config.moons:
        constant[3:] += tide_of(moon.mass_kg, moon_position(moon, now, body.spin), middle)
    return runge_kutta_step(lambda at: slope @ at + constant, state, period)
