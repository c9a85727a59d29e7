"""`BackupBraking`: a law that keeps out of the ellipsoid, and the commands that it admits."""

from __future__ import annotations

from enum import IntEnum
from typing import NamedTuple

import numpy as np

from proxops.systems.assurance import _braking_kernel as kernel
from proxops.systems.assurance.assurance_bounds import AssuranceBounds
from proxops.systems.assurance.certification import (
    Arguments,
    budget,
    certified,
    describe,
    rooms,
    tightest,
)
from proxops.systems.assurance.least_change import Box, Path, along_path, least_change
from proxops.systems.assurance.outer_gravity import outer_gravity
from proxops.systems.common import InputError, State, Vector3, check_limits, check_positive
from proxops.systems.gravity import FieldTables, GravityField, TabulatedField
from proxops.systems.vehicle import FlightLimits

# The outward speed that the backup seeks, as a share of the speed limit.
_CRUISE = 0.25
# Share of the thrust limit that must be left where thrust at its worst holds against gravity and
# Coriolis at their worst: for what the prediction takes as constant over a control period.
_RESERVE = 0.02
# What the prediction's integration leaves out, as a share of the thrust acceleration: mostly how
# Coriolis changes over a period where states differ.
_INTEGRATION = 1e-3
# A clearance this small counts as 0; in units of the greatest acceleration times the period squared
# (7 mm at Kleopatra).
_NEAR_ENOUGH = 1e-3

_Motion = tuple[np.ndarray, np.ndarray, FieldTables, np.record]
"""Position, velocity, and the kernel's `tables` and `world`."""


class InterventionReason(IntEnum):
    """Why a force was changed. If there are several reasons, the greatest number counts."""

    NONE = 0
    THRUST_LIMIT = 1
    SPEED_LIMIT = 2
    KEEP_OUT = 3
    BACKUP = 4
    """The backup flies: no force nearer to the command was found safe."""

    @property
    def in_words(self) -> str:
        """The name as a text for people, as "keep out"."""
        return self.name.lower().replace("_", " ")


class Assured(NamedTuple):
    """The result of `BackupBraking.assure`."""

    force: Vector3
    """(3,) in N in K. Where the reason is NONE, it is the command itself, bit for bit."""
    reason: InterventionReason
    margin: float = np.nan
    """The command's own margin in m, within thrust and speed limit. If it is negative, the command
    was not safe; -inf: its backup's flight does not settle. NaN: it was not judged."""


class BackupBraking:
    """A backup law, the states from which it is safe, and the least change that keeps a force safe.

    Every promise holds for all errors within the declared bounds: any world in the box, and any
    state within its errors of the one that is given. docs/method/safety.md has the law and the
    argument.

    **The backup** seeks an outward speed of a quarter of the speed limit and brakes all else as
    hard as it can, once the spacecraft moves outwards at `outward_speed`; across the spin it always
    brakes to `settled_speed`, at which thrust can still hold against gravity and Coriolis. The law
    is continuous in the state.

    **The backup margin** of a state is the least clearance of a *tube* along the backup's flight,
    which holds the spacecraft in any world of the box, until all of it moves outwards faster than
    `outward_speed`. A state is *admitted* if its backup margin is not negative.

    **The margin** of a command at a state is the least clearance of the tube if the command flies
    for one period and the backup after it. A command is safe if its margin is not negative; if it
    is negative, its size is the *shortfall*. Only safe commands fly, and the backup if none is
    found.

    **The least change** of a force has these steps. It is clipped to the thrust and speed limits.
    If it is not safe, it moves up the gradient of the margin until it is. If that fails, it moves
    towards the backup's force. If nothing on that way is safe within the speed limit, the backup's
    force flies: keeping out has priority. In 19 of 20 cases with random forces no safe force is
    nearer by more than a thirtieth.
    """

    def __init__(
        self,
        field: GravityField | TabulatedField,
        spin: float,
        limits: FlightLimits,
        bounds: AssuranceBounds | None = None,
        period: float = 10.0,
    ):
        """Takes the believed gravity, spin in rad/s about z, limits, bounds of errors and period.

        Without `bounds` everything is as believed.

        Raises:
          InputError: the period is not positive, the delay is longer than the control period, the
            body sticks out of the keep-out ellipsoid, thrust at its worst cannot hold against
            gravity at its worst, or the errors are so great that above some place no height is
            enough.
        """
        bounds = AssuranceBounds() if bounds is None else bounds
        axes = limits.keep_out_semi_axes
        check_positive("BackupBraking", period=period)
        check_limits(bounds, "BackupBraking")
        if bounds.delay_s > period:
            raise InputError(
                f"assurance.bounds.delay_s is {bounds.delay_s:g} s: runtime assurance can bound "
                f"the effect of a delay up to the control period, {period:g} s; a command that "
                "acts later would have to be checked for a later period"
            )
        self.limits, self.bounds, self.period = limits, bounds, period
        self.gravity = outer_gravity(field, axes)
        self.spin = float(spin)
        self.cruise_speed = _CRUISE * limits.speed
        """The outward speed in m/s that the backup seeks."""
        self.settled_speed = self._settled_speed()
        """The speed in m/s across the spin from which the backup always brakes."""
        self.world = self._world(bounds.position_m, bounds.velocity_m_s)
        """What the kernel knows: a record of the type `WORLD`."""
        self._check_box()
        self._load_kernels()

    def _settled_speed(self) -> float:
        """The speed across the spin at which thrust at its worst still holds each axis.

        Raises:
          InputError: thrust does not hold along some axis.
        """
        limits, bounds = self.limits, self.bounds
        acceleration = limits.thrust / limits.mass
        usable = acceleration * (bounds.weakest - bounds.across - _RESERVE) - self._other()
        spare = usable - (1.0 + bounds.gravity) * self.gravity.greatest
        # Coriolis acts across the spin.
        settled = min(spare[:2]) / (2.0 * abs(self.spin)) if self.spin else np.inf
        if spare.min() < 0.0 or settled < self.cruise_speed:
            raise InputError(self._shortfall(spare))
        return float(settled)

    def _other(self) -> float:
        """Accelerations (m/s^2) that nothing else counts: declared, by table, by integration."""
        integration = _INTEGRATION * self.limits.thrust / self.limits.mass
        return self.bounds.acceleration_m_s2 + self.gravity.error + integration

    def _world(self, position: float, velocity: float) -> np.record:
        """What the kernel knows (`kernel.WORLD`), for these errors of the state in m and m/s."""
        limits, bounds, outer = self.limits, self.bounds, self.gravity
        axes = limits.keep_out_semi_axes
        acceleration, shortest, longest = limits.thrust / limits.mass, axes.min(), axes.max()
        gravity = (1.0 + bounds.gravity) * outer.strongest
        if bounds.delay_s:
            # What another force, gravity and Coriolis do to speed until the chosen force acts.
            speed = np.sqrt(3.0) * limits.speed
            change = 2.0 * np.sqrt(3.0) * bounds.strongest * acceleration
            velocity += bounds.delay_s * (change + gravity + 2.0 * abs(self.spin) * speed)
            position += bounds.delay_s * speed
        # Longer semi-axes by p move the surface by at least 2 sqrt(a c) / (a + c) p.
        wider = 0.5 * (shortest + longest) / np.sqrt(shortest * longest)
        wider *= position + bounds.surface_m
        curvature = longest / shortest**2
        # Braking two axes for one period loses at most this outward speed (of three, c is left);
        # and the law may take an axis for faster than it is.
        loss = np.sqrt(2.0) * acceleration * (bounds.strongest + bounds.across)
        loss = self.period * (loss + gravity + self._other())
        outward = loss + 2.0 * velocity + 2.0 * self.cruise_speed * curvature * position
        values = {
            "semi_axes": axes + wider,
            "spin": self.spin,
            "thrust": acceleration,
            "period": self.period,
            "cruise": self.cruise_speed,
            "settled": self.settled_speed,
            "speed": limits.speed,
            "gravity": bounds.gravity,
            "weak": 1.0 - bounds.weakest,
            "strong": bounds.strongest - 1.0,
            "across": bounds.across,
            "other": self._other(),
            "position": position,
            "velocity": velocity,
            "steepness": outer.steepness,
            "curvature": curvature,
            "outward": outward + velocity,
        }
        row = tuple(values[name] for name in kernel.WORLD.names or ())
        return np.rec.array([row], dtype=kernel.WORLD)[0]

    @property
    def arguments(self) -> Arguments:
        """The compiled functions' arguments after position and velocity, for the bounds."""
        return self.gravity.tables, self.world

    @property
    def outward_speed(self) -> float:
        """The outward speed in m/s from which the backup brakes sideways."""
        return float(self.world.outward)

    def _check_box(self) -> None:
        """Checks that a spacecraft at rest is admitted somewhere above each place.

        Raises:
          InputError: there is a place where no room is enough.
        """
        axes = self.limits.keep_out_semi_axes
        if certified(self.arguments, axes):
            return
        points, needed = rooms(self.arguments, axes)
        worst = int(needed.argmax())
        if needed[worst] < np.inf:
            return
        errors = 3.0 * self.world.velocity
        thrusting = self.outward_speed - errors
        if thrusting > self.cruise_speed:
            enough = 1.2 * thrusting / _CRUISE
            cure = f"raise spacecraft.speed_limit_m_s to {enough:.2g} or shorten control_period_s"
        else:
            cure = "tighten assurance.bounds.velocity_m_s, position_m or delay_s, or "
            cure += tightest(budget(self.bounds, self.world.thrust, self.gravity.strongest))
        raise InputError(
            "runtime assurance: within assurance.bounds, no height above "
            f"{describe(points[worst])} of the keep-out ellipsoid is enough for a spacecraft at "
            f"rest there. The backup has to reach {self.outward_speed:.3g} m/s outwards whatever "
            f"the errors: {thrusting:.3g} m/s because it thrusts for a whole control period, "
            f"{errors:.3g} m/s for the state's errors. It seeks {self.cruise_speed:.3g} m/s, "
            f"{_CRUISE:g} of the speed limit: {cure}"
        )

    def rooms(self, speed: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
        """How much room the bounds take: what clearance a state needs to be admitted.

        Args:
          speed: inward speed in m/s, along the normal.

        Returns:
          Points (N, 3) in m, evenly about the ellipsoid, and the clearances (N,) in m above them;
          inf where no clearance of up to half the shortest semi-axis is enough.
        """
        return rooms(self.arguments, self.limits.keep_out_semi_axes, speed)

    def _load_kernels(self) -> None:
        """Calls everything that is compiled once: loaded in flight, each takes 10 to 20 ms."""
        state = np.concatenate([2.0 * self.limits.keep_out_semi_axes, np.zeros(3)])
        thrust, motion = np.zeros(3), (state[:3], state[3:], *self.arguments)
        kernel.bound_speed(*motion, thrust, np.empty(3), np.empty(3))
        kernel.margin(*motion, thrust)
        kernel.backup(*motion, thrust)

    def _shortfall(self, spare: np.ndarray) -> str:
        """Says where thrust at its worst does not hold, how much is missing, and what to do.

        Args:
          spare: (3,) what thrust along each axis has left for Coriolis, in m/s^2.
        """
        limits, bounds, outer = self.limits, self.bounds, self.gravity
        # Across the spin the backup's speed needs thrust, too.
        spare = spare - 2.0 * abs(self.spin) * self.cruise_speed * np.array([1.0, 1.0, 0.0])
        axis = int(spare.argmin())
        gravity = float(outer.greatest[axis])
        parts = budget(bounds, limits.thrust / limits.mass, gravity)
        missing = ""
        if any(parts.values()):
            missing = f"; within assurance.bounds {limits.mass * -spare[axis]:.3g} N are missing"
        return (
            f"runtime assurance: a thrust of {limits.thrust:g} N per axis does not hold "
            f"{limits.mass:g} kg at {describe(outer.places[axis])} of the keep-out ellipsoid, "
            f"where gravity along {'xyz'[axis]} takes {limits.mass * gravity:.3g} N{missing}: fly "
            f"without runtime assurance, or {tightest(parts)}"
        )

    def force(self, state: State) -> np.ndarray:
        """The backup's force (3,) in N at a state (6,) in K."""
        r, v = self._split(state)
        thrust = np.empty(3)
        kernel.backup(r, v, *self.arguments, thrust)
        return self.limits.mass * thrust

    def backup_margin(self, state: np.ndarray) -> float:
        """The least clearance in m, from the ellipsoid with its margin, if the backup flies.

        It is a lower bound, which is closer the nearer it is to 0; of a negative one, only the sign
        counts. It is -inf if the backup's flight does not settle.
        """
        r, v = self._split(state)
        return kernel.backup_margin(r, v, *self.arguments)

    def admitted(self, state: State) -> bool:
        """Whether the backup's flight from a state (6,) stays out of the ellipsoid."""
        return self.backup_margin(state) >= 0.0

    def can_hold(self, position: Vector3, position_error: float, velocity_error: float) -> bool:
        """Whether the backup, started at rest, settles with these bounds of the state's errors.

        Args:
          position: (3,) in m in K. position_error, velocity_error: in m and m/s.
        """
        world = self._with_errors(position_error, velocity_error)
        return kernel.backup_margin(position, np.zeros(3), self.gravity.tables, world) > -np.inf

    def assure(
        self,
        state: State,
        force: Vector3,
        position_error: float | None = None,
        velocity_error: float | None = None,
    ) -> Assured:
        """Changes a force (3,) in N by the least that is safe for one period from a state (6,).

        Args:
          state: (6,) as it is believed.
          force: (3,) in N, the command.
          position_error, velocity_error: bounds in m and m/s of this state's errors, and of those
            of all states while a backup flies on from it; those of the box if there are none.

        Raises:
          InputError: state or force is not finite, or an error is negative or not finite.
        """
        r, v = self._split(state)
        if not np.isfinite(force).all():
            raise InputError(f"a force must be finite to be assured, got {force} N")
        wanted = np.asarray(force, dtype=np.float64) / self.limits.mass
        thrust, low, high = wanted.copy(), np.empty(3), np.empty(3)
        motion = r, v, self.gravity.tables, self._with_errors(position_error, velocity_error)
        reason = InterventionReason.NONE
        if kernel.bound_speed(*motion, thrust, low, high):
            reason = InterventionReason.SPEED_LIMIT
        elif (thrust != wanted).any():
            reason = InterventionReason.THRUST_LIMIT
        margin = kernel.margin(*motion, thrust)
        if margin < 0.0:
            thrust, reason = self._kept_out(motion, thrust, -margin, (low, high))
        if reason is InterventionReason.NONE:
            return Assured(np.array(force, dtype=np.float64), reason, margin)
        limit = self.limits.thrust
        return Assured(np.clip(self.limits.mass * thrust, -limit, limit), reason, margin)

    def _kept_out(
        self, motion: _Motion, thrust: np.ndarray, shortfall: float, box: Box
    ) -> tuple[np.ndarray, InterventionReason]:
        """Makes a thrust acceleration with a margin of `-shortfall` safe by the least change."""

        def margin(tried: np.ndarray) -> float:
            return kernel.margin(*motion, tried)

        limit = self.limits.thrust / self.limits.mass
        enough = _NEAR_ENOUGH * limit * self.period**2
        found = least_change(margin, thrust, shortfall, box, limit, enough)
        if found is not None:
            return found, InterventionReason.KEEP_OUT
        # Towards the backup, within the speed limit.
        way_out = np.empty(3)
        kernel.backup(*motion, way_out)
        toward = np.clip(way_out, *box) - thrust
        path = Path(thrust, toward, first=1.0, far=1.0)
        found, reached = along_path(margin, path, shortfall, box, enough)
        if reached >= 0.0:
            return found, InterventionReason.KEEP_OUT
        return way_out, InterventionReason.BACKUP

    def _with_errors(self, position: float | None, velocity: float | None) -> np.record:
        if position is None and velocity is None:
            return self.world
        position = self.bounds.position_m if position is None else float(position)
        velocity = self.bounds.velocity_m_s if velocity is None else float(velocity)
        if not (0.0 <= position < np.inf and 0.0 <= velocity < np.inf):
            raise InputError(
                "bounds of the state's errors must be finite and not negative, got "
                f"{position} m and {velocity} m/s"
            )
        return self._world(position, velocity)

    def _split(self, state: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        state = np.asarray(state, dtype=np.float64)
        if state.shape != (6,) or not np.isfinite(state).all():
            raise InputError(f"a state must be six finite numbers, got {state}")
        return state[:3], state[3:]
