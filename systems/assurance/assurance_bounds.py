"""`AssuranceBounds`: the declared errors within which runtime assurance keeps its promise."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass

from proxops.systems.common import FAR, InputError, config, number


@config
class AssuranceBoundsConfig:
    """The greatest errors for which runtime assurance keeps out; see `AssuranceBounds`.

    By default everything is as believed.
    """

    # Of the size of gravity, over it.
    gravity: float = number(0.0, at_least=0.0, below=1.0)
    # Of the force of each thruster, over it.
    thrust: float = number(0.0, at_least=0.0, below=1.0)
    # Angle between the commanded force and the one that acts: thrusters and attitude together.
    thrust_direction_deg: float = number(0.0, at_least=0.0, below=90.0, unit="degrees")
    # Of the spacecraft's mass, over it. What a flight burns counts here.
    mass: float = number(0.0, at_least=0.0, below=1.0)
    # Of what else accelerates the spacecraft, along each axis.
    acceleration_m_s2: float = number(0.0, at_least=0.0, at_most=1e6, unit="m/s^2")
    # Of position and velocity, as far as the navigation's covariance does not say it.
    position_m: float = number(0.0, at_least=0.0, at_most=FAR, unit="m")
    velocity_m_s: float = number(0.0, at_least=0.0, at_most=1e5, unit="m/s")
    # By how much the true surface may stand out from that of the map.
    surface_m: float = number(0.0, at_least=0.0, at_most=FAR, unit="m")
    # Time from the moment that a state describes to the one at which a command acts; at most
    # control_period_s.
    delay_s: float = number(0.0, at_least=0.0, at_most=3600.0, unit="s")


@dataclass(frozen=True)
class AssuranceBounds:
    """Hard bounds of every error; 0 means that it is as believed.

    Errors may vary from step to step in any manner within their bounds, unless it says otherwise.

    Raises:
      InputError: a bound is negative or not finite, or so great that nothing can be said.
    """

    gravity: float = 0.0
    """Greatest error of the gravity's size, as a share of it."""
    thrust: float = 0.0
    """Greatest error of each thruster's force, as a share of it."""
    thrust_direction: float = 0.0
    """Greatest angle in rad between the commanded force and the one that acts: thrusters and
    attitude together."""
    mass: float = 0.0
    """Greatest error of the mass, as a share of it."""
    acceleration: float = 0.0
    """Greatest other acceleration along each axis, in m/s^2: gravity that differs in more than its
    size, another spin, forces that nothing on board knows of."""
    position: float = 0.0
    """Greatest error of the position, in m."""
    velocity: float = 0.0
    """Greatest error of the velocity, in m/s."""
    surface: float = 0.0
    """Greatest distance in m by which the keep-out ellipsoid has to be wider because the body is
    not where, or not as large as, the map says. It does not vary during a flight."""
    delay: float = 0.0
    """Greatest time in s from the moment that a state describes to the one at which the force
    chosen for it acts; at most the control period."""

    def __post_init__(self):
        for field in dataclasses.fields(self):
            value = getattr(self, field.name)
            if not (isinstance(value, (int, float)) and 0.0 <= value < math.inf):
                raise InputError(
                    f"the bound {field.name} must be finite and not negative, got {value}"
                )
        for name, limit in (
            ("gravity", 1.0),
            ("thrust", 1.0),
            ("mass", 1.0),
            ("thrust_direction", 0.5 * math.pi),
        ):
            if getattr(self, name) >= limit:
                raise InputError(
                    f"the bound {name} must be below {limit:.4g}, got {getattr(self, name)}"
                )

    @property
    def weakest(self) -> float:
        """The least acceleration along an axis that a commanded 1 m/s^2 gives."""
        return (1.0 - self.thrust) / (1.0 + self.mass)

    @property
    def strongest(self) -> float:
        """The greatest acceleration along an axis that a commanded 1 m/s^2 gives."""
        return (1.0 + self.thrust) / (1.0 - self.mass)

    @property
    def across(self) -> float:
        """The greatest acceleration along an axis by turned thrust, as a share of the limit.

        A force that is turned by the angle a about any axis changes each of its components by at
        most sin a times the other two together, and by 1 - cos a times its own.
        """
        angle = self.thrust_direction
        return self.strongest * (math.sqrt(2.0) * math.sin(angle) + 1.0 - math.cos(angle))
