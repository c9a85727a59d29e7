"""`ExpectedErrors`: how wrong the navigation takes its beliefs to be."""

from __future__ import annotations

from proxops.systems.common import FAR, LONG, config, number


@config
class ExpectedErrors:
    """One standard deviation of everything that `LidarNavigation` may be wrong about.

    They are what a mission knows of its own uncertainties, never the true errors. What is constant
    is estimated in flight, so a generous value costs a slower start. What varies stays uncertain
    for good. By default nothing is wrong but the attitude. Vectors have the same deviation along
    each axis.
    """

    # Of the spacecraft's axes S against the body's axes K at the start, about each axis.
    attitude_deg: float = number(1.0, at_least=0.0, at_most=11.0, unit="degrees")
    # Of a part of it that varies, and the time over which its correlation falls to 1/e.
    attitude_varying_deg: float = number(0.0, at_least=0.0, at_most=11.0, unit="degrees")
    attitude_correlation_s: float = number(3600.0, at_least=1e-2, at_most=LONG, unit="s")
    # Of the noise of an attitude that is measured, about each axis, and that time of it.
    attitude_noise_deg: float = number(0.0, at_least=0.0, at_most=11.0, unit="degrees")
    attitude_noise_correlation_s: float = number(10.0, at_least=1e-2, at_most=LONG, unit="s")
    # Of the direction of the spin axis.
    pole_deg: float = number(0.0, at_least=0.0, at_most=90.0, unit="degrees")
    # Of the spin rate, over the rate.
    spin: float = number(0.0, at_least=0.0, at_most=1e3)
    # Of the body's mass, over the mass.
    gravity: float = number(0.0, at_least=0.0, at_most=1e3)
    # Of the centre of mass, through which the spin axis goes, along each axis.
    centre_of_mass_m: float = number(0.0, at_least=0.0, at_most=FAR, unit="m")
    # Of the thrust along each axis, over the thrust. An error of the spacecraft's mass counts here.
    thrust: float = number(0.0, at_least=0.0, at_most=1e3)
    # Of what varies in it because S turns, over the force. It varies as
    # `acceleration_varying_m_s2` does.
    thrust_varying: float = number(0.0, at_least=0.0, at_most=1e3)
    # Of each thruster's own force, over it, and of its own direction: of what they are together, a
    # part varies in the same way, because other thrusters push.
    thruster: float = number(0.0, at_least=0.0, at_most=1e3)
    thruster_direction_deg: float = number(0.0, at_least=0.0, at_most=90.0, unit="degrees")
    # Of the share of the spacecraft's mass that each m/s of velocity change uses up: 1 over the
    # exhaust speed.
    propellant_s_per_m: float = number(0.0, at_least=0.0, at_most=1.0, unit="s/m")
    # Of the axes of the thrusters.
    thrust_direction_deg: float = number(0.0, at_least=0.0, at_most=90.0, unit="degrees")
    # The impulse along an axis in a period below which the thrusters give nothing.
    least_impulse_n_s: float = number(0.0, at_least=0.0, at_most=1e9, unit="N s")
    # Of a constant acceleration that nothing explains, along each axis.
    acceleration_m_s2: float = number(0.0, at_least=0.0, at_most=1e6, unit="m/s^2")
    # Of an acceleration that varies, and the time over which its correlation falls to 1/e.
    acceleration_varying_m_s2: float = number(0.0, at_least=0.0, at_most=1e6, unit="m/s^2")
    acceleration_correlation_s: float = number(600.0, at_least=1e-2, at_most=LONG, unit="s")
    # Of the map's surface along its normals, and the length over which its errors are alike.
    surface_rms_m: float = number(0.0, at_least=0.0, at_most=FAR, unit="m")
    surface_correlation_m: float = number(15e3, at_least=1e-3, at_most=FAR, unit="m")
    # Of what is too fine to be estimated, such as boulders and curved facets, and its length.
    relief_rms_m: float = number(0.0, at_least=0.0, at_most=FAR, unit="m")
    relief_correlation_m: float = number(3e3, at_least=1e-3, at_most=FAR, unit="m")
    # Of the size of the map, over the size.
    size: float = number(0.0, at_least=0.0, at_most=10.0)
    # Of the lidar: a length that is added to all ranges, a factor on them, and the full angle of
    # its beams.
    lidar_bias_m: float = number(0.0, at_least=0.0, at_most=FAR, unit="m")
    lidar_scale: float = number(0.0, at_least=0.0, at_most=1e3)
    beam_width_rad: float = number(0.0, at_least=0.0, at_most=0.1, unit="rad")

    @property
    def half_beam(self) -> float:
        """Half of the angle of the lidar's beams, in rad: by it ranges are in error."""
        return 0.5 * self.beam_width_rad
