"""`QUANTITIES`: what may be uncertain of a flight's world, one row for each value of a scenario."""

from __future__ import annotations

from dataclasses import dataclass

HARMLESS = ""
"""Where a bound is named: the value needs none, because it does not change the motion."""


@dataclass(frozen=True)
class Quantity:
    """A value of a scenario that the world may have otherwise than is believed."""

    key: str
    """Its dotted key."""
    about: float = 0.0
    """The number that the error is counted from: what is believed, or 0 of a spread in itself."""
    tunes: str | None = None
    """The key of `navigation.expected` that tells the navigation how large the error may be. Where
    several quantities tune one, their deviations are combined. None: no state models it."""
    bounds: str | None = None
    """The key of `assurance.bounds` that covers it, or `HARMLESS`. None: nothing covers it, so
    runtime assurance refuses dispersions of it."""
    needs: str | None = None
    """The key without which it means nothing."""
    known: bool = False
    """Whether the value of each flight is known on board: it is measured before the flight."""


QUANTITIES = (
    Quantity("truth.gravity", 1.0, "gravity", "gravity"),
    Quantity("truth.density_contrast", 0.0, "centre_of_mass_m", "acceleration_m_s2"),
    Quantity("truth.mesh", bounds="surface_m"),
    Quantity("truth.mesh_unit", bounds=HARMLESS, needs="truth.mesh"),
    Quantity("truth.mesh_of_any_size", bounds=HARMLESS, needs="truth.mesh"),
    Quantity("truth.size", 1.0, "size", "surface_m"),
    Quantity("truth.surface_rms_m", 0.0, "surface_rms_m", "surface_m"),
    Quantity(
        "truth.surface_correlation_m",
        tunes="surface_correlation_m",
        bounds=HARMLESS,
        needs="truth.surface_rms_m",
    ),
    Quantity("truth.surface_seed", bounds=HARMLESS, needs="truth.surface_rms_m"),
    Quantity("truth.boulders.widest_m", 0.0, "relief_rms_m", "surface_m"),
    Quantity("truth.boulders.index", bounds=HARMLESS, needs="truth.boulders.widest_m"),
    Quantity("truth.boulders.crater_widest_m", 0.0, "relief_rms_m", HARMLESS),
    Quantity(
        "truth.boulders.crater_index", bounds=HARMLESS, needs="truth.boulders.crater_widest_m"
    ),
    Quantity("truth.boulders.narrowest_m", 0.0, "relief_correlation_m", HARMLESS),
    Quantity("truth.boulders.seed", bounds=HARMLESS),
    Quantity("truth.boulders.lone_m"),
    Quantity("truth.boulders.lone_at_m", needs="truth.boulders.lone_m"),
    Quantity("truth.spin", 1.0, "spin", "acceleration_m_s2"),
    Quantity("truth.tumbles"),
    Quantity("truth.pole_deg", 0.0, "pole_deg", "acceleration_m_s2"),
    Quantity("truth.attitude.constant_deg", 0.0, "attitude_deg", "thrust_direction_deg"),
    Quantity("truth.phase_deg", 0.0, "attitude_deg", "thrust_direction_deg"),
    Quantity("truth.attitude.varying_std_deg", 0.0, "attitude_varying_deg", "thrust_direction_deg"),
    Quantity(
        "truth.attitude.correlation_time_s",
        tunes="attitude_correlation_s",
        bounds=HARMLESS,
        needs="truth.attitude.varying_std_deg",
    ),
    Quantity("truth.lidar.bias_m", 0.0, "lidar_bias_m", HARMLESS),
    Quantity("truth.lidar.scale_error", 0.0, "lidar_scale", HARMLESS),
    Quantity("truth.lidar.noise", 1.0, bounds=HARMLESS),
    Quantity("truth.lidar.dropout", bounds=HARMLESS),
    Quantity("truth.lidar.false_returns", bounds=HARMLESS),
    Quantity("truth.lidar.beam_width_rad", 0.0, "beam_width_rad", HARMLESS),
    Quantity("truth.lidar.frame_loss", bounds=HARMLESS),
    Quantity("truth.lidar.latency_steps", bounds=HARMLESS),
    Quantity("truth.lidar.outage_steps", bounds=HARMLESS),
    Quantity("truth.lidar.outage_from_step", bounds=HARMLESS, needs="truth.lidar.outage_steps"),
    Quantity("truth.thrusters.scale", 1.0, "thrust", "thrust"),
    Quantity("truth.thrusters.direction_deg", 0.0, "thrust_direction_deg", "thrust_direction_deg"),
    Quantity("truth.thrusters.least_impulse_n_s", 0.0, "least_impulse_n_s", "acceleration_m_s2"),
    Quantity("truth.thrusters.quantum_n", bounds="acceleration_m_s2"),
    Quantity("truth.thrusters.failed_axis"),
    Quantity("truth.thrusters.failure_time_s", needs="truth.thrusters.failed_axis"),
    Quantity("truth.rigid_body.inertia", 1.0, bounds=HARMLESS),
    Quantity("truth.rigid_body.centre_of_mass_m", bounds=HARMLESS),
    Quantity("truth.rigid_body.thruster_scale_std", 0.0, "thruster", "thrust"),
    Quantity(
        "truth.rigid_body.thruster_direction_std_deg",
        0.0,
        "thruster_direction_deg",
        "thrust_direction_deg",
    ),
    Quantity("truth.rigid_body.thruster_place_std_m", bounds=HARMLESS),
    Quantity("truth.rigid_body.failed_thruster"),
    Quantity("truth.rigid_body.failure_time_s", needs="truth.rigid_body.failed_thruster"),
    Quantity("truth.rigid_body.wheel_friction_per_s", bounds=HARMLESS),
    Quantity("truth.ground.friction", bounds=HARMLESS),
    Quantity("truth.ground.modulus_pa", bounds=HARMLESS),
    Quantity("truth.ground.dissipation_s_m", bounds=HARMLESS),
    Quantity("truth.mass", 1.0, "thrust", "mass"),
    Quantity("truth.specific_impulse_s", 0.0, "propellant_s_per_m", "mass"),
    Quantity("truth.acceleration.constant_m_s2", 0.0, "acceleration_m_s2", "acceleration_m_s2"),
    Quantity(
        "truth.acceleration.varying_std_m_s2",
        0.0,
        "acceleration_varying_m_s2",
        "acceleration_m_s2",
    ),
    Quantity(
        "truth.acceleration.correlation_time_s",
        tunes="acceleration_correlation_s",
        bounds=HARMLESS,
        needs="truth.acceleration.varying_std_m_s2",
    ),
    Quantity("disturbance.max_relative_magnitude"),
    Quantity("disturbance.reset_period_s", bounds=HARMLESS),
    Quantity("disturbance.increment_std_n", bounds=HARMLESS),
    Quantity("force_noise.std_n", bounds="acceleration_m_s2"),
    Quantity("force_noise.correlation_time_s", bounds=HARMLESS),
    Quantity("kicks.velocity_std_m_s", bounds="acceleration_m_s2"),
    Quantity("kicks.mean_interval_s", bounds=HARMLESS),
    Quantity("lidar.noise_std_m", bounds=HARMLESS, known=True),
    Quantity("spacecraft.mass_kg", bounds=HARMLESS, known=True),
)
"""All of them. Everything else that lists them is made from this table: what may be dispersed, what
the navigation and runtime assurance are told, remarks, and the table of docs/method/truth.md."""

QUANTITY = {each.key: each for each in QUANTITIES}
"""The quantities by their keys."""
KNOWN_ON_THE_DAY = tuple(each.key for each in QUANTITIES if each.known)
"""Keys of belief that may be dispersed: they differ from flight to flight, and the controllers are
told. Whatever else is dispersed, they never know (Hanson and Beard, NASA/TP-2010-216447)."""
