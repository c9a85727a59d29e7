"""The dataclasses of `truth`: how the world of a flight differs from what is believed.

Every value can be set alone. With its default, the world is as believed.
"""

import dataclasses as dc

from proxops.systems.common import FAR, config, number, one_of, vector
from proxops.systems.lidar import TrueLidarConfig
from proxops.systems.vehicle import TrueAccelerationConfig, TrueAttitudeConfig, TrueThrustersConfig

_LARGEST_SEED = 2**53 - 1


@config
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
    surface_rms_m: float = number(0.0, at_least=0.0, at_most=FAR, unit="m")
    surface_correlation_m: float = number(15e3, at_least=1e-3, at_most=FAR, unit="m")
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
