"""`FlightLimits`: what the MPC's plans and runtime assurance keep within."""

from __future__ import annotations

from dataclasses import dataclass

from proxops.systems.common import Vector3, check_positive, checked_semi_axes


@dataclass(frozen=True)
class FlightLimits:
    """Limits of the spacecraft and its path."""

    mass: float
    """kg."""
    thrust: float
    """N per axis."""
    speed: float
    """m/s per axis, in K."""
    keep_out_semi_axes: Vector3
    """(3,) in m, of the ellipsoid to stay out of; a margin is part of it."""

    def __post_init__(self) -> None:
        """Raises `InputError` unless all limits are positive."""
        check_positive("FlightLimits", mass=self.mass, thrust=self.thrust, speed=self.speed)
        axes = checked_semi_axes("the keep-out ellipsoid", self.keep_out_semi_axes)
        object.__setattr__(self, "keep_out_semi_axes", axes)
