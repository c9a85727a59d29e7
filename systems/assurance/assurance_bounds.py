"""`AssuranceBounds`: the declared errors within which runtime assurance keeps its promise."""

from __future__ import annotations

import math

from proxops.systems.common import FAR, config, number


@config
class AssuranceBounds:
    """Hard bounds of every error; with 0, the default, everything is as believed.

    Errors may vary from step to step in any manner within their bounds, unless it says otherwise.
    """

    # Of the size of gravity, over it.
    gravity: float = number(0.0, at_least=0.0, below=1.0)
    # Of the force of each thruster, over it.
    thrust: float = number(0.0, at_least=0.0, below=1.0)
    # Angle between the commanded force and the one that acts: thrusters and attitude together.
    thrust_direction_deg: float = number(0.0, at_least=0.0, below=90.0, unit="degrees")
    # Of the spacecraft's mass, over it. What a flight burns counts here.
    mass: float = number(0.0, at_least=0.0, below=1.0)
    # Of what else accelerates the spacecraft, along each axis: gravity that differs in more than
    # its size, another spin, forces that nothing on board knows of.
    acceleration_m_s2: float = number(0.0, at_least=0.0, at_most=1e6, unit="m/s^2")
    # Of position and velocity, as far as the navigation's covariance does not say it.
    position_m: float = number(0.0, at_least=0.0, at_most=FAR, unit="m")
    velocity_m_s: float = number(0.0, at_least=0.0, at_most=1e5, unit="m/s")
    # By how much the true surface may stand out from that of the map. It does not vary in a flight.
    surface_m: float = number(0.0, at_least=0.0, at_most=FAR, unit="m")
    # Time from the moment that a state describes to the one at which the force chosen for it acts;
    # at most control_period_s.
    delay_s: float = number(0.0, at_least=0.0, at_most=3600.0, unit="s")

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
        angle = math.radians(self.thrust_direction_deg)
        return self.strongest * (math.sqrt(2.0) * math.sin(angle) + 1.0 - math.cos(angle))
