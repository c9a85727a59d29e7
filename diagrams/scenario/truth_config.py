"""The dataclasses of `truth`: how the world of a flight differs from what is believed.

Every value can be set alone. With its default, the world is as believed.
"""

import dataclasses as dc

from proxops.diagrams.scenario.limits import number, one_of, vector

_FAR, _LONG = 1e9, 1e8
_LARGEST_SEED = 2**53 - 1


@dc.dataclass(slots=True)
class TrueAttitudeConfig:
    """How the spacecraft's axes S are turned against what it takes for them: the body's axes K.

    This is the error of star tracker and mounting. Errors of spin rate, pole and phase turn S as
    well. Lidar rays and thrust turn with S.
    """

    # Constant rotation vector.
    constant_deg: list[float] = vector([0.0] * 3, at_least=-180.0, at_most=180.0, unit="degrees")
    # Standard deviation, per axis, of a rotation vector that varies (first-order Gauss-Markov), and
    # the time over which its correlation falls to 1/e.
    varying_std_deg: float = number(0.0, at_least=0.0, at_most=90.0, unit="degrees")
    correlation_time_s: float = number(3600.0, at_least=1e-2, at_most=_LONG, unit="s")


@dc.dataclass(slots=True)
class TrueLidarConfig:
    """How the true lidar differs from the one on the data sheet."""

    # This length is added to every range.
    bias_m: float = number(0.0, at_least=-_FAR, at_most=_FAR, unit="m")
    # Every range is multiplied by 1 + scale_error.
    scale_error: float = number(0.0, above=-1.0, at_most=1e3)
    # True standard deviation of the noise, over lidar.noise_std_m.
    noise: float = number(1.0, at_least=0.0, at_most=1e6)
    # Probability that a return is lost.
    dropout: float = number(0.0, at_least=0.0, at_most=1.0)
    # Probability that a ray has a false return, at a random range.
    false_returns: float = number(0.0, at_least=0.0, at_most=1.0)
    # Full angle of a beam's cone. The range is that of the nearest surface in it.
    beam_width_rad: float = number(0.0, at_least=0.0, at_most=0.1, unit="rad")
    # Probability that a whole frame is lost.
    frame_loss: float = number(0.0, at_least=0.0, at_most=1.0)
    # Control steps from measuring a frame to having it.
    latency_steps: int = number(0, at_least=0, at_most=1000)


@dc.dataclass(slots=True)
class TrueThrustersConfig:
    """How the true thrust differs from the commanded force."""

    # True force along each axis, over the commanded force.
    scale: list[float] = vector([1.0] * 3, at_least=0.0, at_most=1e3)
    # Rotation vector of the thrusters' axes against the spacecraft's axes.
    direction_deg: list[float] = vector([0.0] * 3, at_least=-180.0, at_most=180.0, unit="degrees")
    # A force along one axis whose impulse in a control period is smaller gives nothing.
    least_impulse_n_s: float = number(0.0, at_least=0.0, at_most=1e9, unit="N s")
    # The force along each axis is a multiple of this; 0: any force.
    quantum_n: float = number(0.0, at_least=0.0, at_most=1e7, unit="N")
    # The axis whose thrusters fail, and the time from which they give nothing.
    failed_axis: str = one_of("none", ("none", "x", "y", "z"))
    failure_time_s: float = number(0.0, at_least=0.0, at_most=_LONG, unit="s")


@dc.dataclass(slots=True)
class TrueAccelerationConfig:
    """Accelerations in K that nothing on board explains."""

    constant_m_s2: list[float] = vector([0.0] * 3, at_least=-1e6, at_most=1e6, unit="m/s^2")
    # Standard deviation, per axis, of an acceleration that varies (first-order Gauss-Markov), and
    # the time over which its correlation falls to 1/e.
    varying_std_m_s2: float = number(0.0, at_least=0.0, at_most=1e6, unit="m/s^2")
    correlation_time_s: float = number(600.0, at_least=1e-2, at_most=_LONG, unit="s")


@dc.dataclass(slots=True)
class TruthConfig:
    """How the true world differs from the believed one.

    The true surface lies in K as a survey would have registered it: aligned with the map by least
    squares. K turns with the true body, about an axis through its true centre of mass.
    """

    # True mass of the body (so GM), over the believed one.
    gravity: float = number(1.0, at_least=1e-3, at_most=1e3)
    # The half of the body on the positive side of its longest axis is denser by this share, and the
    # other half less dense. The centre of mass and the spin axis move.
    density_contrast: float = number(0.0, above=-1.0, below=1.0)
    # Another mesh file of the body; null: the map. The path in a scenario file is relative to it.
    mesh: str | None = None
    mesh_unit: str = one_of("km", ("km", "m"))
    # Whether truth.mesh may differ from the map by more than a half of its size.
    mesh_of_any_size: bool = False
    # Every true length of the surface, over that of the map.
    size: float = number(1.0, at_least=1e-1, at_most=10.0)
    # The surface is displaced along its normals by a smooth random field: its root mean square, its
    # correlation length, and its seed.
    surface_rms_m: float = number(0.0, at_least=0.0, at_most=_FAR, unit="m")
    surface_correlation_m: float = number(15e3, at_least=1e-3, at_most=_FAR, unit="m")
    surface_seed: int = number(0, at_least=0, at_most=_LARGEST_SEED)
    # True spin rate, over the believed one.
    spin: float = number(1.0, at_least=0.0, at_most=1e3)
    # The true spin axis is turned from K's z by these angles about K's x and y.
    pole_deg: list[float] = vector([0.0, 0.0], at_least=-90.0, at_most=90.0, unit="degrees")
    # What is believed of the rotation about z at the start, less what is true.
    phase_deg: float = number(0.0, at_least=-180.0, at_most=180.0, unit="degrees")
    attitude: TrueAttitudeConfig = dc.field(default_factory=TrueAttitudeConfig)
    lidar: TrueLidarConfig = dc.field(default_factory=TrueLidarConfig)
    thrusters: TrueThrustersConfig = dc.field(default_factory=TrueThrustersConfig)
    # True mass of the spacecraft, over the believed one.
    mass: float = number(1.0, at_least=1e-3, at_most=1e3)
    # The thrusters' specific impulse; null: the mass is constant.
    specific_impulse_s: float | None = number(None, at_least=1e-3, at_most=1e9, unit="s")
    acceleration: TrueAccelerationConfig = dc.field(default_factory=TrueAccelerationConfig)
