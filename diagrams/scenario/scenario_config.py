"""The dataclasses of a scenario: each value with its default, unit, limits and meaning.

In a YAML file and with `--set`, a key is the path of field names, such as `mpc.fuel_weight`. What
configures a system is a dataclass beside that system. `TruthConfig` says how the world of a flight
differs from what is believed; with the defaults, it is as believed.
"""

import dataclasses as dc
import math
from collections.abc import Iterator, Mapping

from proxops.diagrams.scenario.spacecraft_model import RigidBodyConfig
from proxops.diagrams.scenario.tasks import (
    MissionConfig,
    SurveyConfig,
    TouchAndGoConfig,
    Transit,
)
from proxops.systems.assurance import AssuranceConfig
from proxops.systems.attitude import TrueRigidBodyConfig
from proxops.systems.common import FAR, config, html_table, number, one_of, vector
from proxops.systems.expert import MpcConfig
from proxops.systems.hybrid import HybridConfig
from proxops.systems.lidar import LearnedLidarConfig, LidarConfig, LidarGeometry, TrueLidarConfig
from proxops.systems.navigation import LidarNavigationConfig
from proxops.systems.policy import PolicyConfig
from proxops.systems.shapes import BouldersConfig
from proxops.systems.touch import Ground
from proxops.systems.vehicle import (
    ArrivalConfig,
    ForceNoiseConfig,
    KicksConfig,
    PointMassConfig,
    RandomWalkDisturbanceConfig,
    SunlightConfig,
    TrueAccelerationConfig,
    TrueAttitudeConfig,
    TrueThrustersConfig,
)

# The greatest whole number that an attribute of a log can hold.
_LARGEST_WHOLE = 2**63 - 1
# That a float holds exactly, because seeds may be drawn.
_LARGEST_SEED = 2**53 - 1


@config
class TrueStateConfig:
    """The controllers know the true state.

    The paper flies so. A scenario chooses it with `navigation: !TrueState {}`.
    """


@config
class TransitConfig:
    """The transit to fly: number `index` of the set of `seed`, or a given start and goal.

    Commands that fly many transits take seed and number from their options, not from here.
    """

    seed: int = number(10000, at_least=0, at_most=_LARGEST_WHOLE)
    index: int = number(0, at_least=0, at_most=_LARGEST_WHOLE)
    # Start and goal as positions in the body-fixed frame. Give both or neither. At the goal the
    # spacecraft is to be at rest in that frame.
    start_m: list[float] | None = None
    goal_m: list[float] | None = None
    # Velocity at the start, in the same frame; null means at rest.
    start_velocity_m_s: list[float] | None = None
    # The remaining keys say how the set is drawn. Starts and goals lie in a cube of this edge.
    cube_m: float = number(340.0e3, at_least=1e-3, at_most=FAR, unit="m")
    # Least and greatest distance from start to goal.
    min_distance_m: float = number(40.0e3, at_least=1e-3, at_most=FAR, unit="m")
    max_distance_m: float = number(160.0e3, at_least=1e-3, at_most=FAR, unit="m")
    # Start and goal lie outside the keep-out ellipsoid with this added to each semi-axis.
    end_clearance_m: float = number(8.0e3, at_least=0.0, at_most=FAR, unit="m")
    # Greatest share of the thrust limit that hovering at the start or goal may take.
    max_hover_share: float = number(0.7, at_least=1e-6, at_most=1e3)


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
    boulders: BouldersConfig = dc.field(default_factory=BouldersConfig)
    # True spin rate, over the believed one.
    spin: float = number(1.0, at_least=0.0, at_most=1e3)
    # Whether the true body turns as a rigid body without torque, whatever is believed: it tumbles.
    tumbles: bool = False
    # The true spin axis at the start is turned by these angles about K's x and y.
    pole_deg: list[float] = vector([0.0, 0.0], at_least=-90.0, at_most=90.0, unit="degrees")
    # What is believed of the rotation about the axis at the start, less what is true.
    phase_deg: float = number(0.0, at_least=-180.0, at_most=180.0, unit="degrees")
    attitude: TrueAttitudeConfig = dc.field(default_factory=TrueAttitudeConfig)
    lidar: TrueLidarConfig = dc.field(default_factory=TrueLidarConfig)
    thrusters: TrueThrustersConfig = dc.field(default_factory=TrueThrustersConfig)
    # True mass of the spacecraft, over the believed one.
    mass: float = number(1.0, at_least=1e-3, at_most=1e3)
    # The thrusters' specific impulse; null: the mass is constant.
    specific_impulse_s: float | None = number(None, at_least=1e-3, at_most=1e9, unit="s")
    acceleration: TrueAccelerationConfig = dc.field(default_factory=TrueAccelerationConfig)
    rigid_body: TrueRigidBodyConfig = dc.field(default_factory=TrueRigidBodyConfig)
    # What a touch-and-go meets.
    ground: Ground = dc.field(default_factory=Ground)


@config
class Scenario:
    """All values that define a flight near a small body.

    The defaults are the paper's values; where the paper gives none, they are our choice.
    """

    # Name of a body that ships with proxops, or path of a body's YAML file; a path in a scenario
    # file is relative to that file.
    body: str = "kleopatra"
    # How gravity is computed: `exact`, by the sums over the polyhedron, or `table`, outside the
    # keep-out ellipsoid from a table with a relative error below 1e-9. The table is made at the
    # first use and kept in the user's cache folder. A true body that differs from the believed one
    # is always exact.
    gravity: str = one_of("exact", ("exact", "table"))
    spacecraft: PointMassConfig | RigidBodyConfig = dc.field(default_factory=PointMassConfig)
    lidar: LidarConfig | LearnedLidarConfig = dc.field(default_factory=LidarConfig)
    # From what controllers and runtime assurance know the state of the spacecraft.
    navigation: LidarNavigationConfig | TrueStateConfig = dc.field(
        default_factory=LidarNavigationConfig
    )
    mpc: MpcConfig = dc.field(default_factory=MpcConfig)
    policy: PolicyConfig = dc.field(default_factory=PolicyConfig)
    hybrid: HybridConfig = dc.field(default_factory=HybridConfig)
    # null: there is no safety filter.
    assurance: AssuranceConfig | None = None
    # null: the command is not disturbed.
    disturbance: RandomWalkDisturbanceConfig | None = None
    # null: no noise is added to the command.
    force_noise: ForceNoiseConfig | None = None
    # null: nothing pushes the spacecraft from outside.
    kicks: KicksConfig | None = None
    # null: there is no Sun. Controllers and navigation know how much it may do, but no model of it.
    sunlight: SunlightConfig | None = None
    # How the world differs from what is believed; no controller knows it.
    truth: TruthConfig = dc.field(default_factory=TruthConfig)
    # Name of dispersions that ship with proxops, or path of a YAML file of dispersions, from which
    # every flight draws its own world; a path in a scenario file is relative to that file.
    # null: nothing is drawn.
    dispersions: str | None = None
    # Keys of the values that were drawn. proxops writes them when it draws.
    dispersed: list[str] = dc.field(default_factory=list)
    # What the flight is to do.
    task: Transit | SurveyConfig | TouchAndGoConfig | MissionConfig = dc.field(
        default_factory=Transit
    )
    transit: TransitConfig = dc.field(default_factory=TransitConfig)
    arrival: ArrivalConfig = dc.field(default_factory=ArrivalConfig)
    # Time from one command to the next; a command is held for this time.
    control_period_s: float = number(10.0, at_least=1e-2, at_most=3600.0, unit="s")
    # If true, the log holds the lidar's frame of every step.
    log_ranges: bool = True
    # Seed of all random systems of a flight: lidar noise, disturbance, force noise, kicks, varying
    # errors of attitude and acceleration, and the state noise of the hybrid.
    noise_seed: int = number(0, at_least=0, at_most=_LARGEST_WHOLE)

    @property
    def is_rigid(self) -> bool:
        """Whether the spacecraft is a rigid body, not a point."""
        return isinstance(self.spacecraft, RigidBodyConfig)

    @property
    def attitude_steps(self) -> int:
        """Attitude steps in a control period, of a rigid spacecraft."""
        assert isinstance(self.spacecraft, RigidBodyConfig)
        return math.ceil(self.control_period_s / self.spacecraft.attitude_period_s - 1e-9)

    @property
    def attitude_period_s(self) -> float:
        """Time from one attitude step to the next, of a rigid spacecraft."""
        return self.control_period_s / self.attitude_steps

    @property
    def lidar_geometry(self) -> LidarGeometry:
        """Where the lidar's rays point, and how far they reach."""
        sensor = self.lidar
        field = math.radians(sensor.field_of_view_deg) if isinstance(sensor, LidarConfig) else 0.0
        return LidarGeometry(sensor.planes, sensor.rays, sensor.max_range_m, field)

    @property
    def true_specific_impulse_s(self) -> float | None:
        """True specific impulse of the thrusters; None: the mass is constant."""
        if self.truth.specific_impulse_s is None and isinstance(self.spacecraft, RigidBodyConfig):
            return self.spacecraft.specific_impulse_s
        return self.truth.specific_impulse_s

    def _repr_html_(self) -> str:
        changed = dict(_differences(dc.asdict(self), dc.asdict(Scenario())))
        return html_table("Scenario: what differs from the default", changed)


def _differences(
    values: Mapping[str, object], usual: Mapping[str, object], prefix: str = ""
) -> Iterator[tuple[str, object]]:
    """Dotted keys and values of nested mappings that differ from the usual ones."""
    for name, value in values.items():
        other = usual.get(name)
        if isinstance(value, dict) and isinstance(other, dict):
            yield from _differences(value, other, f"{prefix}{name}.")
        elif value != other:
            yield f"{prefix}{name}", value
