"""`BackupBraking`: a law that keeps out of the ellipsoid, and the commands that it admits."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import NamedTuple

import numpy as np

from proxops.systems.assurance import _braking_kernel as kernel
from proxops.systems.assurance.gravity_table import gravity_table
from proxops.systems.assurance.least_change import Box, along_path, least_change
from proxops.systems.common import InputError
from proxops.systems.gravity import Field

# The outward speed that the backup seeks, as a share of the speed limit.
_CRUISE = 0.25
# Share of the thrust limit that gravity and Coriolis must leave free.
_RESERVE = 0.15
# A clearance this small counts as 0; in units of the greatest acceleration times the period squared
# (7 mm at Kleopatra).
_NEAR_ENOUGH = 1e-3

_Motion = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]
"""Position, velocity, a table's scales and nodes, and the kernel's `world`."""


class InterventionReason(IntEnum):
    """Why a force was changed. If there are several reasons, the greatest number counts."""

    NONE = 0
    THRUST_LIMIT = 1
    SPEED_LIMIT = 2
    KEEP_OUT = 3
    BACKUP = 4
    """The backup flies: no force nearer to the command was found safe."""


class Assured(NamedTuple):
    """The result of `BackupBraking.assure`."""

    force: np.ndarray
    """(3,) in N in K. Where the reason is NONE, it is the command itself, bit for bit."""
    reason: InterventionReason


@dataclass(frozen=True)
class AssuranceLimits:
    """Limits of the spacecraft and its flight."""

    mass: float
    """kg."""
    thrust: float
    """Greatest force per axis, N."""
    speed: float
    """Greatest speed per axis in K, m/s."""
    keep_out_semi_axes: np.ndarray
    """(3,) in m, of the ellipsoid to stay out of, without its margin."""
    keep_out_margin: float = 100.0
    """Added to each semi-axis, in m: for errors of the prediction and for disturbances."""


class BackupBraking:
    """A backup law, the states from which it is safe, and the least change that keeps a force safe.

    **The law.** n is the normal, at the spacecraft, of the ellipsoid through it that has the
    keep-out ellipsoid's proportions; c is a quarter of the speed limit; T is the control period; a
    is the acceleration by gravity, centrifugal and Coriolis terms. The backup's force is, per
    axis::

        F = clip(m (e / T - a), ± limit)        e = c n - v

    So each axis reaches the velocity c n as fast as it can. There is one exception: an axis that
    moves outwards faster than that (e n < 0) is not braked (e = 0) while the spacecraft as a whole
    moves inwards. Once it moves outwards, that axis is braked by the share of c that the outward
    speed has reached. An axis along which the normal is nearly zero is always braked. The law is
    continuous in the state.

    **The backup margin** of a state is the least clearance along the backup's flight from it, at
    and between control steps. The prediction ends when the outward speed is c / 20 and gravity and
    Coriolis together stay below 85 % of the thrust limit. From then on the speed along each axis
    grows beyond neither c nor its present value, each axis has the thrust to push outwards, and the
    normal of a convex body turns with the motion. So the outward speed stays positive and the
    clearance grows. A state is *admitted* if its backup margin is not negative.

    This argument has a known gap: close to the ellipsoid and at outward speeds near c / 20, sampled
    outward accelerations of the backup were as low as -0.04 m/s^2. No flight has shown harm.

    **The margin** of a command at a state is the least clearance if the command flies for one
    period and the backup after it. A command is safe if its margin is not negative; if it is
    negative, its size is the *shortfall*.

    **Why this is safe.** Only safe commands fly, and the backup if none is found. So at each step
    from an admitted state on there is a force that keeps out: the backup's, whose flight was
    predicted to its end when the last command was accepted. The ellipsoid's margin covers the
    errors of that prediction (gravity from a table, Taylor's series: about a metre).

    **The least change** of a force has these steps. It is clipped to the thrust and speed limits.
    If it is not safe, it moves up the gradient of the margin until it is. If that fails, it moves
    towards the backup's force. If nothing on that way is safe within the speed limit, the backup's
    force flies: keeping out has priority. The gradient is evaluated twice, at the command and at
    the first result. In 19 of 20 cases with random forces no safe force is nearer by more than a
    thirtieth.
    """

    def __init__(self, field: Field, spin: float, limits: AssuranceLimits, period: float = 10.0):
        """Takes the assumed gravity, the spin in rad/s about z, the limits and the period in s.

        Raises:
          InputError: a limit is not positive, or the thrust cannot hold the spacecraft everywhere
            outside the ellipsoid.
        """
        axes = np.asarray(limits.keep_out_semi_axes, dtype=np.float64)
        values = [limits.mass, limits.thrust, limits.speed, period, *axes]
        if not (
            np.isfinite(values).all()
            and min(values) > 0.0
            and 0.0 <= limits.keep_out_margin < np.inf
        ):
            raise InputError(
                "runtime assurance needs a positive mass, thrust limit, speed limit, period and "
                f"semi-axes, and a margin that is not negative, got {limits} and {period}"
            )
        self.limits, self.period = limits, period
        self.table = gravity_table(field, axes)
        acceleration, cruise = limits.thrust / limits.mass, _CRUISE * limits.speed
        spare = (1.0 - _RESERVE) * acceleration - self.table.greatest
        # Coriolis acts across the spin.
        settled = min(spare[:2]) / (2.0 * abs(spin)) if spin else np.inf
        if spare[2] < 0.0 or spare.min() < 0.0 or settled < cruise:
            raise InputError(
                f"runtime assurance: a thrust of {limits.thrust:g} N per axis does not hold "
                f"{limits.mass:g} kg against gravity everywhere outside the keep-out ellipsoid, "
                f"{limits.mass * self.table.greatest.max():.3g} N: fly without it, or with more "
                "thrust or less mass"
            )
        world = [
            *(axes + limits.keep_out_margin),
            spin,
            acceleration,
            period,
            cruise,
            settled,
            limits.speed,
        ]
        # The arguments of the kernel's functions after position and velocity.
        self._given = self.table.scales, self.table.nodes, np.array(world)

    def force(self, state: np.ndarray) -> np.ndarray:
        """The backup's force (3,) in N at a state (6,) in K."""
        r, v = self._split(state)
        thrust = np.empty(3)
        kernel.backup(r, v, *self._given, thrust)
        return self.limits.mass * thrust

    def backup_margin(self, state: np.ndarray) -> float:
        """The least clearance in m, from the ellipsoid with its margin, if the backup flies.

        It is a lower bound, which is closer the nearer it is to 0. It is -inf if the backup's
        flight does not settle.
        """
        r, v = self._split(state)
        return kernel.backup_margin(r, v, *self._given)

    def admitted(self, state: np.ndarray) -> bool:
        """Whether the backup's flight from a state (6,) stays out of the ellipsoid."""
        return self.backup_margin(state) >= 0.0

    def assure(self, state: np.ndarray, force: np.ndarray) -> Assured:
        """Changes a force (3,) in N by the least that is safe for one period from a state (6,).

        Raises:
          InputError: state or force is not finite.
        """
        r, v = self._split(state)
        if not np.isfinite(force).all():
            raise InputError(f"a force must be finite to be assured, got {force} N")
        wanted = np.asarray(force, dtype=np.float64) / self.limits.mass
        thrust, low, high = wanted.copy(), np.empty(3), np.empty(3)
        motion = r, v, *self._given
        reason = InterventionReason.NONE
        if kernel.bound_speed(*motion, thrust, low, high):
            reason = InterventionReason.SPEED_LIMIT
        elif (thrust != wanted).any():
            reason = InterventionReason.THRUST_LIMIT
        margin = kernel.margin(*motion, thrust)
        if margin < 0.0:
            thrust, reason = self._kept_out(motion, thrust, -margin, (low, high))
        if reason is InterventionReason.NONE:
            return Assured(np.array(force, dtype=np.float64), reason)
        limit = self.limits.thrust
        return Assured(np.clip(self.limits.mass * thrust, -limit, limit), reason)

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
        found, reached = along_path(margin, thrust, toward, shortfall, box, 1.0, 1.0, enough)
        if reached >= 0.0:
            return found, InterventionReason.KEEP_OUT
        return way_out, InterventionReason.BACKUP

    def _split(self, state: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        state = np.asarray(state, dtype=np.float64)
        if state.shape != (6,) or not np.isfinite(state).all():
            raise InputError(f"a state must be six finite numbers, got {state}")
        return state[:3], state[3:]
