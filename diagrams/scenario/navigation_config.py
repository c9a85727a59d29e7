"""The dataclasses of `navigation`: from what the controllers know position, velocity and attitude.

`navigation: !LidarNavigation {}` is the default; `navigation: !TrueState {}` tells the truth.
"""

import dataclasses as dc

from proxops.diagrams.scenario.limits import number, one_of

_FAR, _LONG = 1e9, 1e8


@dc.dataclass(slots=True)
class ExpectedErrorsConfig:
    """One standard deviation of what the navigation may be wrong about.

    See `proxops.systems.ExpectedErrors`. By default nothing is wrong but the attitude.
    """

    # Of the spacecraft's axes S against the body's axes K at the start, about each axis.
    attitude_deg: float = number(1.0, at_least=0.0, at_most=11.0, unit="degrees")
    # Of a part of it that varies, and the time over which its correlation falls to 1/e.
    attitude_varying_deg: float = number(0.0, at_least=0.0, at_most=11.0, unit="degrees")
    attitude_correlation_s: float = number(3600.0, at_least=1e-2, at_most=_LONG, unit="s")
    # Of the direction of the spin axis.
    pole_deg: float = number(0.0, at_least=0.0, at_most=90.0, unit="degrees")
    # Of the spin rate, over the rate.
    spin: float = number(0.0, at_least=0.0, at_most=1e3)
    # Of the body's mass, over the mass.
    gravity: float = number(0.0, at_least=0.0, at_most=1e3)
    # Of the centre of mass, along each axis.
    centre_of_mass_m: float = number(0.0, at_least=0.0, at_most=_FAR, unit="m")
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
    acceleration_correlation_s: float = number(600.0, at_least=1e-2, at_most=_LONG, unit="s")
    # Of the map's surface along its normals, and the length over which its errors are alike.
    surface_rms_m: float = number(0.0, at_least=0.0, at_most=_FAR, unit="m")
    surface_correlation_m: float = number(15e3, at_least=1e-3, at_most=_FAR, unit="m")
    # Of the size of the map, over the size.
    size: float = number(0.0, at_least=0.0, at_most=10.0)
    # Of the lidar: a length that is added to all ranges, a factor on them, and the full angle of
    # its beams.
    lidar_bias_m: float = number(0.0, at_least=0.0, at_most=_FAR, unit="m")
    lidar_scale: float = number(0.0, at_least=0.0, at_most=1e3)
    beam_width_rad: float = number(0.0, at_least=0.0, at_most=0.1, unit="rad")


@dc.dataclass(slots=True)
class LidarNavigationConfig:
    """The controllers know what the navigation makes of lidar frames and of their own commands.

    See `proxops.systems.LidarNavigation`. A scenario chooses it with `navigation: !LidarNavigation
    {...}`.
    """

    # What it takes its own errors to be. null: what the scenario's dispersions, disturbance, noise
    # of the force and kicks say, and the defaults of ExpectedErrorsConfig for all else.
    expected: ExpectedErrorsConfig | None = None
    # Mesh file of the map by which it navigates, in K, and the unit of its numbers; null: that of
    # the body. Only the navigation uses it. If `proxops fly --mended-map` wrote it, the errors of
    # surface and size are those beside it, and not those of `expected`. The path in a scenario file
    # is relative to that file.
    map: str | None = None
    map_unit: str = one_of("km", ("km", "m"))
    # It takes the frames to be this many control steps old. The true age is in truth.lidar.
    frame_delay_steps: int = number(0, at_least=0, at_most=1000)


@dc.dataclass(slots=True)
class TrueStateConfig:
    """The controllers know the true state.

    The paper flies so. A scenario chooses it with `navigation: !TrueState {}`.
    """
