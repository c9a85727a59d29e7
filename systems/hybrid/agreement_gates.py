"""`AgreementGate`: tests whether two forces agree.

With u and v the two forces, there are three kinds of gates::

    printed   |u - v| < e_magnitude   or   arctan(u.v / |u x v|) < e_angle
    paper     |u - v| < e_magnitude   or   atan2(|u x v|, u.v) < e_angle
    strict    |u - v| < e_magnitude   or   (atan2(|u x v|, u.v) < e_angle
                                            and ||u| - |v|| < e_magnitude)

`printed` is the formula as printed in Quinn, Nehma, Tiwari (IEEE Aerospace 2025). Its angle is 90
degrees minus the angle between the forces, so its second test accepts opposite forces and rejects
equal directions. Only the first test makes it accept equal forces. `paper` corrects the angle. It
still accepts 0.1 N for 7 N in the same direction, so `strict` bounds the difference of the sizes,
too. In `strict` the direction of a force below the dead band does not count: if both forces are
below it, they agree; if one is, the first test alone decides.

The angle to a force of exactly zero is NaN, and passes no test.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum
from typing import NamedTuple

import numpy as np

from proxops.systems.common import InputError, check_not_negative


class GateKind(StrEnum):
    """Which tests a gate makes: see the module's description."""

    PRINTED = "printed"
    PAPER = "paper"
    STRICT = "strict"


class Agreement(NamedTuple):
    """The result of a comparison."""

    agrees: bool
    difference: float
    """|u - v| in N."""
    angle: float
    """The angle that the gate compares, in rad: between the forces, from 0 to pi, or in `printed`
    90 degrees minus that. NaN if a force is zero."""


@dataclass(frozen=True)
class AgreementGate:
    """A gate and its limits: e_magnitude in N, e_angle in rad, and the dead band in N."""

    kind: GateKind = GateKind.STRICT
    magnitude: float = 1.0
    angle: float = math.radians(10.0)
    dead_band: float = 0.2

    def __post_init__(self) -> None:
        """Raises `InputError` for an unknown kind, or limits that are negative or not finite."""
        if self.kind not in list(GateKind):
            raise InputError(f"a gate is {', '.join(GateKind)}; got {self.kind!r}")
        check_not_negative(
            "a gate", magnitude=self.magnitude, angle=self.angle, dead_band=self.dead_band
        )

    def compare(self, one: np.ndarray, other: np.ndarray) -> Agreement:
        """Compares two forces (3,) in N, in any order; forces that are not finite never agree."""
        difference = float(np.linalg.norm(one - other))
        angle = angle_between(one, other)
        if self.kind == GateKind.PRINTED:
            angle = 0.5 * math.pi - angle
        near = difference < self.magnitude
        along = angle < self.angle  # Never for NaN.
        if self.kind == GateKind.STRICT:
            sizes = float(np.linalg.norm(one)), float(np.linalg.norm(other))
            if difference < math.inf and max(sizes) < self.dead_band:  # Never for NaN.
                return Agreement(True, difference, angle)
            clear = min(sizes) >= self.dead_band
            along = along and clear and abs(sizes[0] - sizes[1]) < self.magnitude
        return Agreement(near or along, difference, angle)


def angle_between(one: np.ndarray, other: np.ndarray) -> float:
    """atan2(|u x v|, u.v), in rad from 0 to pi; NaN if a vector (3,) is zero or not finite."""
    if not (np.isfinite(one).all() and np.isfinite(other).all()):
        return math.nan
    across = float(np.linalg.norm(np.cross(one, other)))
    along = float(one @ other)
    if across == 0.0 and along == 0.0:
        return math.nan
    return math.atan2(across, along)
