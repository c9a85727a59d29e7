"""`ExpectedErrors`: how wrong the navigation takes its beliefs to be."""

from __future__ import annotations

import dataclasses as dc
import math

from proxops.systems.common import (
    FAR,
    LONG,
    InputError,
    check_not_negative,
    check_positive,
    config,
    number,
)


@config
class ExpectedErrorsConfig:
    """One standard deviation of what the navigation may be wrong about.

    See `proxops.systems.ExpectedErrors`. By default nothing is wrong but the attitude.
    """

    # Of the spacecraft's axes S against the body's axes K at the start, about each axis.
    attitude_deg: float = number(1.0, at_least=0.0, at_most=11.0, unit="degrees")
    # Of a part of it that varies, and the time over which its correlation falls to 1/e.
    attitude_varying_deg: float = number(0.0, at_least=0.0, at_most=11.0, unit="degrees")
    attitude_correlation_s: float = number(3600.0, at_least=1e-2, at_most=LONG, unit="s")
    # Of the direction of the spin axis.
    pole_deg: float = number(0.0, at_least=0.0, at_most=90.0, unit="degrees")
    # Of the spin rate, over the rate.
    spin: float = number(0.0, at_least=0.0, at_most=1e3)
    # Of the body's mass, over the mass.
    gravity: float = number(0.0, at_least=0.0, at_most=1e3)
    # Of the centre of mass, along each axis.
    centre_of_mass_m: float = number(0.0, at_least=0.0, at_most=FAR, unit="m")
    # Of the thrust along each axis, over the thrust. An error of the spacecraft's mass counts here.
    thrust: float = number(0.0, at_least=0.0, at_most=1e3)
    # Of the share of the spacecraft's mass that each m/s of velocity change uses up: 1 over the
    # exhaust speed.
    propellant_s_per_m: float = number(0.0, at_least=0.0, at_most=1.0, unit="s/m")
    # Of the axes of the thrusters.
    thrust_direction_deg: float = number(0.0, at_least=0.0, at_most=90.0, unit="degrees")
    # Of a constant acceleration that nothing explains, along each axis.
    acceleration_m_s2: float = number(0.0, at_least=0.0, at_most=1e6, unit="m/s^2")
    # Of an acceleration that varies, and the time over which its correlation falls to 1/e.
    acceleration_varying_m_s2: float = number(0.0, at_least=0.0, at_most=1e6, unit="m/s^2")
    acceleration_correlation_s: float = number(600.0, at_least=1e-2, at_most=LONG, unit="s")
    # Of the map's surface along its normals, and the length over which its errors are alike.
    surface_rms_m: float = number(0.0, at_least=0.0, at_most=FAR, unit="m")
    surface_correlation_m: float = number(15e3, at_least=1e-3, at_most=FAR, unit="m")
    # Of the size of the map, over the size.
    size: float = number(0.0, at_least=0.0, at_most=10.0)
    # Of the lidar: a length that is added to all ranges, a factor on them, and the full angle of
    # its beams.
    lidar_bias_m: float = number(0.0, at_least=0.0, at_most=FAR, unit="m")
    lidar_scale: float = number(0.0, at_least=0.0, at_most=1e3)
    beam_width_rad: float = number(0.0, at_least=0.0, at_most=0.1, unit="rad")


@dc.dataclass(frozen=True)
class ExpectedErrors:
    """One standard deviation of everything that `LidarNavigation` may be wrong about.

    They are what a mission knows of its own uncertainties, never the true errors. What is constant
    is estimated in flight, so a generous value costs a slower start. What varies stays uncertain
    for good. By default nothing is wrong but the attitude. Vectors have the same deviation along
    each axis.
    """

    attitude: float = math.radians(1.0)
    """Of the spacecraft's axes S against K at the start, in rad."""
    attitude_varying: float = 0.0
    """Of a part of the attitude that varies (first-order Gauss-Markov), in rad."""
    attitude_correlation: float = 3600.0
    """Time in s over which the correlation of that part falls to 1/e."""
    pole: float = 0.0
    """Of the direction of the spin axis, in rad."""
    spin: float = 0.0
    """Of the spin rate, over the rate."""
    gravity: float = 0.0
    """Of the body's mass, over the mass."""
    centre_of_mass: float = 0.0
    """Of the centre of mass, through which the spin axis goes, in m."""
    thrust: float = 0.0
    """Of the force along each axis, over the force; the spacecraft's mass counts here too."""
    propellant: float = 0.0
    """Of the share of the mass that each m/s of velocity change uses up, in s/m: 1 over the exhaust
    speed."""
    thrust_direction: float = 0.0
    """Of the axes of the thrusters, in rad."""
    acceleration: float = 0.0
    """Of a constant acceleration that nothing explains, in m/s^2."""
    acceleration_varying: float = 0.0
    """Of an acceleration that varies (first-order Gauss-Markov), in m/s^2."""
    acceleration_correlation: float = 600.0
    """Time in s over which the correlation of that acceleration falls to 1/e."""
    surface: float = 0.0
    """Of the map's surface along its normals, in m."""
    surface_correlation: float = 15e3
    """Length in m over which errors of the surface are alike."""
    size: float = 0.0
    """Of the size of the map, over the size."""
    lidar_bias: float = 0.0
    """Of a length that is added to all ranges, in m."""
    lidar_scale: float = 0.0
    """Of a factor on all ranges."""
    beam_width: float = 0.0
    """Of the full angle of the lidar's beams, in rad."""

    def __post_init__(self) -> None:
        """Raises `InputError` for an error that cannot be.

        It is a negative or infinite deviation, a time or length of 0, or an attitude that is not
        known to 0.2 rad.
        """
        values = dc.asdict(self)
        scales = ("attitude_correlation", "acceleration_correlation", "surface_correlation")
        check_positive("the expected errors", **{name: values.pop(name) for name in scales})
        check_not_negative("the expected errors", **values)
        if self.attitude > 0.2:
            raise InputError(
                f"the navigation needs an attitude that is known to 0.2 rad, got {self.attitude:g}"
            )
