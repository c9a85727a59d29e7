"""Backup braking: the law that flies when nothing else is safe, and what it lets be flown."""

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

# The outward speed that the backup seeks, in speed limits.
_CRUISE = 0.25
# Share of the thrust limit beyond what gravity and Coriolis may take.
_RESERVE = 0.15
# Clearance that is as good as none, in thrust limits times a period squared (7 mm at Kleopatra).
_NEAR_ENOUGH = 1e-3

_Motion = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]
"""Position, velocity, a table's scales and nodes, and the kernel's `world`."""


class InterventionReason(IntEnum):
    """Why a force was changed; of several reasons the last."""

    NONE = 0
    THRUST_LIMIT = 1
    SPEED_LIMIT = 2
    KEEP_OUT = 3
    BACKUP = 4
    """The backup itself flies: no force nearer to the command was found safe."""


class Assured(NamedTuple):
    """What `BackupBraking.assure` made of a command."""

    force: np.ndarray
    """(3,) in N in K: the command itself, bit for bit, where the reason is NONE."""
    reason: InterventionReason


@dataclass(frozen=True)
class AssuranceLimits:
    """What a spacecraft and its flight are held to."""

    mass: float
    """kg."""
    thrust: float
    """Greatest force per axis, N."""
    speed: float
    """Greatest speed per axis in K, m/s."""
    keep_out_semi_axes: np.ndarray
    """(3,) in m, of the ellipsoid about the body."""
    keep_out_margin: float = 100.0
    """Added to each semi-axis, m: for what the prediction errs by, and what disturbs."""


class BackupBraking:
    """A way out from everywhere that it admits, and the least change that keeps it open.

    **The law.** With n the ellipsoid's normal at the spacecraft (of the ellipsoid through it of the
    same proportions), c a quarter of the speed limit, T the control period and a the acceleration
    by gravity, centrifugal and Coriolis terms, the backup's force is per axis::

        F = clip(m (e / T - a), ± limit)        e = c n - v

    that is: reach the velocity c n as fast as each axis can. An axis that moves outwards faster
    than that (e n < 0) is left alone (e = 0) while the spacecraft as a whole still moves inwards,
    and braked by the share of c that the outward speed has reached from then on; one along which
    the normal is nearly zero is braked always. The law is continuous in the state.

    **The outlook** of a state is the least clearance along the backup's flight from it, period by
    period as it would be flown, between steps too. It may end when the outward speed is c / 20 and
    gravity and Coriolis together are below 85 % of the thrust limit for good: no axis's speed then
    grows beyond c or what it is, each that pushes outwards has the thrust to, and of a convex body
    the normal turns with the motion, so that the outward speed stays positive and the clearance
    grows. A state is *admitted* if its outlook is not negative.

    **Why it is safe.** A command flies only if the state after it is admitted and the way there
    clear; the backup flies if none is. So from an admitted state on there is at each step a force
    that keeps out: the backup's, whose flight was followed to its end when the last command was let
    pass. What the prediction errs by on that flight (gravity from a table, Taylor's series: about a
    metre) the margin takes up.

    **The least change** of a force: within thrust and speed limits by clipping; then up the
    gradient of the outlook as far as admission takes; if that finds nothing, towards the backup's
    force; if nothing on the way there is safe within the speed limit, the backup's. Keeping out
    comes first. The gradient is taken twice, at the command and where that led: of random forces in
    19 cases of 20 none is safe that is nearer by more than a thirtieth.
    """

    def __init__(self, field: Field, spin: float, limits: AssuranceLimits, period: float = 10.0):
        """Takes the gravity to believe in, the spin in rad/s about z, and the control period in s.

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
        # What the kernel's functions take after position and velocity.
        self._given = self.table.scales, self.table.nodes, np.array(world)

    def force(self, state: np.ndarray) -> np.ndarray:
        """The backup's force (3,) in N at a state (6,) in K."""
        r, v = self._split(state)
        thrust = np.empty(3)
        kernel.backup(r, v, *self._given, thrust)
        return self.limits.mass * thrust

    def backup_margin(self, state: np.ndarray) -> float:
        """The least clearance in m, of the ellipsoid with its margin, if the backup flies.

        A lower bound, the closer the nearer it is to 0; -inf if the backup comes to no end.
        """
        r, v = self._split(state)
        return kernel.backup_margin(r, v, *self._given)

    def admitted(self, state: np.ndarray) -> bool:
        """Whether the backup's flight from a state (6,) stays out."""
        return self.backup_margin(state) >= 0.0

    def assure(self, state: np.ndarray, force: np.ndarray) -> Assured:
        """The least change of a force (3,) in N for the period that begins at a state (6,).

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
        """The least change of a thrust acceleration whose margin is `-shortfall`, below 0."""

        def margin(tried: np.ndarray) -> float:
            return kernel.margin(*motion, tried)

        limit = self.limits.thrust / self.limits.mass
        enough = _NEAR_ENOUGH * limit * self.period**2
        found = least_change(margin, thrust, shortfall, box, limit, enough)
        if found is not None:
            return found, InterventionReason.KEEP_OUT
        # Towards the backup, if it can be had within the speed limit.
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
