"""The dataclasses of a scenario: each value with its default, unit, limits and meaning.

In a YAML file and with `--set`, a key is the path of field names, such as `mpc.fuel_weight`.
"""

import dataclasses as dc

from proxops.diagrams.scenario.body import GRAVITY
from proxops.diagrams.scenario.limits import number, one_of
from proxops.diagrams.scenario.navigation_config import LidarNavigationConfig, TrueStateConfig
from proxops.diagrams.scenario.truth_config import TruthConfig
from proxops.systems.hybrid import GateKind, PeriodRule

# The costs that the MPC may minimise.
COSTS = ("time_and_fuel", "weighted")
# The greatest whole number that an attribute of a log can hold.
_LARGEST_WHOLE = 2**63 - 1
# The greatest length (m) and the greatest time (s) that a scenario accepts.
_FAR, _LONG = 1e9, 1e8

# pydrake's yaml_load_typed takes neither frozen dataclasses, nor tuples, nor postponed annotations.


@dc.dataclass(slots=True)
class SpacecraftConfig:
    """The spacecraft: a point mass with one thruster pair per axis.

    It holds its axes S to those of the body-fixed frame K; `truth` says how they are turned.
    """

    mass_kg: float = number(100.0, at_least=1e-3, at_most=1e7, unit="kg")
    # Greatest force per axis, in both directions.
    thrust_limit_n: float = number(7.0, at_least=1e-6, at_most=1e7, unit="N")
    # Greatest speed per axis in the body-fixed frame. The MPC respects it; the plant does not
    # enforce it.
    speed_limit_m_s: float = number(40.0, at_least=1e-6, at_most=1e5, unit="m/s")


@dc.dataclass(slots=True)
class LidarConfig:
    """The lidar that casts rays against the mesh; see `proxops.systems.Lidar`.

    These are the values on its data sheet. `truth.lidar` says how the true sensor differs.
    """

    # Standard deviation of the range noise; 0 switches the noise off.
    noise_std_m: float = number(50.0, at_least=0.0, at_most=_FAR, unit="m")
    # A ray that meets nothing within this distance has the range +inf.
    max_range_m: float = number(350.0e3, at_least=1e-3, at_most=_FAR, unit="m")
    # Number of planes, turned by equal angles about a common axis, and of rays in each plane.
    planes: int = number(12, at_least=1, at_most=360)
    rays: int = number(360, at_least=1, at_most=3600)
    # A ray that meets the surface at a greater angle from the normal has no return. With 90, every
    # ray that meets the surface has a return.
    max_incidence_deg: float = number(90.0, at_least=1e-3, at_most=90.0, unit="degrees")


@dc.dataclass(slots=True)
class WeightedCostConfig:
    """The paper's cost; see `proxops.systems.WeightedProgram`."""

    # Length of every plan in time.
    horizon_s: float = number(3000.0, at_least=1e-2, at_most=_LONG, unit="s")
    # These errors cost as much as full thrust along one axis.
    position_error_m: float = number(10.0e3, at_least=1e-3, at_most=_FAR, unit="m")
    speed_error_m_s: float = number(20.0, at_least=1e-6, at_most=1e5, unit="m/s")


@dc.dataclass(slots=True)
class LearnedLidarConfig:
    """A network that takes the place of the ray-caster; see `proxops.systems.LearnedLidar`.

    A scenario chooses it with `lidar: !LearnedLidar {bundle: ...}`. Keys without a comment mean the
    same as in `LidarConfig`.
    """

    # The folder `bundle` that `proxops train-lidar` wrote. In a scenario file the path is relative
    # to the file; elsewhere it is relative to the working directory.
    bundle: str = ""
    noise_std_m: float = number(50.0, at_least=0.0, at_most=_FAR, unit="m")
    max_range_m: float = number(350.0e3, at_least=1e-3, at_most=_FAR, unit="m")
    # These must equal the numbers that the bundle was trained for.
    planes: int = number(12, at_least=1, at_most=360)
    rays: int = number(360, at_least=1, at_most=3600)
    # A ray has a return if the network predicts one with at least this probability.
    hit_probability: float = number(0.5, at_least=1e-9, below=1.0)


@dc.dataclass(slots=True)
class MpcConfig:
    """The MPC; see `proxops.systems.ModelPredictiveController`."""

    # Number of intervals of a plan; the force is constant over each. Limits hold at their ends:
    # with few intervals a path may cut through the body between them.
    intervals: int = number(16, at_least=2, at_most=500)
    # Ratio of the length of a plan's last interval to the length of its first.
    interval_growth: float = number(4.0, at_least=1e-3, at_most=1e3)
    # This acceleration sets the price of time. Without gravity and with fuel_weight 0, a transit
    # takes as long as if the spacecraft accelerated by it halfway and then braked by it.
    nominal_acceleration_m_s2: float = number(0.03, at_least=1e-9, at_most=1e6, unit="m/s^2")
    # Weight of the thrust's 1-norm (fuel) against its square in the cost; both are relative to the
    # limit. 0 gives the smoothest thrust, 1 gives nearly the least fuel.
    fuel_weight: float = number(0.8, at_least=0.0, at_most=1e6)
    # No plan is shorter than this time. Below twice the control period the MPC is not stable at the
    # goal.
    min_horizon_s: float = number(300.0, at_least=1e-2, at_most=_LONG, unit="s")
    # For its plans the MPC adds this length to every semi-axis of the keep-out ellipsoid. It does
    # not reach a goal that lies within.
    keep_out_margin_m: float = number(3.0e3, at_least=0.0, at_most=_FAR, unit="m")
    # If true, the MPC computes gravity from a point mass, not from the polyhedron.
    point_mass: bool = False
    # If above 0, the MPC estimates the disturbing acceleration, with this gain at each step, and
    # plans with it.
    estimator_gain: float = number(0.0, at_least=0.0, at_most=1.0)
    # Number of linearisations at a step that has no recent plan to start from. A step that
    # continues the plan of the step before needs one.
    cold_iterations: int = number(10, at_least=1, at_most=1000)
    # The cost that a plan minimises: `time_and_fuel`, set by the keys above, or `weighted`, the
    # paper's cost, set by the keys under `weighted`.
    cost: str = one_of("time_and_fuel", COSTS)
    weighted: WeightedCostConfig = dc.field(default_factory=WeightedCostConfig)
    # Simulated time that the MPC takes to solve, at most control_period_s. A command acts this long
    # after the state from which it was computed; the MPC predicts the state at that time and plans
    # from there.
    solve_delay_s: float = number(0.0, at_least=0.0, at_most=1e6, unit="s")


@dc.dataclass(slots=True)
class PolicyConfig:
    """The learned policy: a `GuidancePolicy` or a `NeuralPolicy` of `proxops.systems`."""

    # The folder `bundle` that `proxops train` wrote. In a scenario file the path is relative to the
    # file; elsewhere it is relative to the working directory. null means the policy that ships
    # with proxops.
    bundle: str | None = None
    # Of a policy for any body (see `proxops.systems.GuidancePolicy`): it keeps out of an ellipsoid
    # that is larger than the keep-out ellipsoid. This length is added to each semi-axis. null means
    # three times mpc.keep_out_margin_m, or in a hybrid, where the MPC checks it, one and a half.
    margin_m: float | None = number(None, at_least=0.0, at_most=1e9, unit="m")
    # Whether it may fly where body or spacecraft lie outside of what it learned.
    beyond_family: bool = False


@dc.dataclass(slots=True)
class HybridConfig:
    """The hybrid: the policy flies, and the MPC checks it; see `proxops.systems.HybridSelector`."""

    # The rule by which the two forces are compared: strict, paper or printed; see
    # `proxops.systems.AgreementGate`.
    gate: str = one_of("strict", list(GateKind))
    # The forces agree if their difference is below epsilon_magnitude_n, or if the angle between
    # them is below epsilon_angle_deg. With `strict` the second test also needs sizes that differ
    # by less than epsilon_magnitude_n.
    epsilon_magnitude_n: float = number(1.0, at_least=0.0, at_most=1e7, unit="N")
    epsilon_angle_deg: float = number(10.0, at_least=0.0, at_most=1e3, unit="degrees")
    # For the gate `strict`: two forces below this size agree, and the direction of a force below it
    # is not compared.
    dead_band_n: float = number(0.2, at_least=0.0, at_most=1e7, unit="N")
    # Whether the time between two checks is fixed or adaptive; see `proxops.systems.CheckSchedule`.
    period_rule: str = one_of("fixed", list(PeriodRule))
    # Control steps from one check to the next. With the adaptive rule, this is the period
    # after two forces that disagree or that barely agree.
    check_period: int = number(10, at_least=1, at_most=1000000)
    # The longest period of the adaptive rule, after equal forces. Every period ends early enough
    # that the spacecraft should be able to stop before the keep-out ellipsoid, whatever acted.
    longest_period: int = number(100, at_least=1, at_most=1000000)
    # Standard deviations, per axis, of the errors of the state that the MPC gets.
    state_noise_position_m: float = number(0.0, at_least=0.0, at_most=_FAR, unit="m")
    state_noise_velocity_m_s: float = number(0.0, at_least=0.0, at_most=1e5, unit="m/s")


@dc.dataclass(slots=True)
class RandomWalkDisturbanceConfig:
    """The paper's disturbance: a slow random walk that is added to the commanded force."""

    # After each such period the walk starts again, with a new limit.
    reset_period_s: float = number(100.0, at_least=1e-2, at_most=_LONG, unit="s")
    # At each start the limit is drawn uniformly between 0 and this multiple of the command's size.
    max_relative_magnitude: float = number(2.0, at_least=0.0, at_most=1e3)
    # Standard deviation, per axis, of the walk's increment at each control step.
    increment_std_n: float = number(0.5, at_least=0.0, at_most=1e7, unit="N")


@dc.dataclass(slots=True)
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
    position_m: float = number(0.0, at_least=0.0, at_most=_FAR, unit="m")
    velocity_m_s: float = number(0.0, at_least=0.0, at_most=1e5, unit="m/s")
    # By how much the true surface may stand out from that of the map.
    surface_m: float = number(0.0, at_least=0.0, at_most=_FAR, unit="m")
    # Time from the moment that a state describes to the one at which a command acts; at most
    # control_period_s.
    delay_s: float = number(0.0, at_least=0.0, at_most=3600.0, unit="s")


@dc.dataclass(slots=True)
class AssuranceConfig:
    """The safety filter that keeps any controller out of the keep-out ellipsoid.

    See `proxops.systems.RuntimeAssurance`. Of the scenario's `truth` the filter knows no more
    than these bounds.
    """

    # The errors for which it does so. Either their values, or the name of dispersions that ship
    # with proxops, or the path of a YAML file of dispersions or of these values; a path in a
    # scenario file is relative to that file. Of dispersions, the ends count: a normal number ends
    # at 3 sigma. null: what the scenario declares: its own dispersions, truth, disturbance, force
    # noise and kicks; without any, no errors.
    bounds: str | AssuranceBoundsConfig | None = None
    # Position and velocity are taken to err by up to this many standard deviations of the
    # navigation's covariance, along its longest axis, in addition to the bounds.
    deviations: float = number(4.0, at_least=0.0, at_most=1e3)


@dc.dataclass(slots=True)
class ForceNoiseConfig:
    """Normal noise that is added to the commanded force.

    Its size does not depend on the command, so it also acts while the spacecraft coasts.
    """

    # Standard deviation per axis, and the time over which the correlation of the noise decays;
    # 0 gives white noise.
    std_n: float = number(0.7, at_least=0.0, at_most=1e7, unit="N")
    correlation_time_s: float = number(100.0, at_least=0.0, at_most=_LONG, unit="s")


@dc.dataclass(slots=True)
class KicksConfig:
    """Pushes from outside at random times; each acts over one control period."""

    # Standard deviation, per axis, of the change of velocity by one push.
    velocity_std_m_s: float = number(2.0, at_least=0.0, at_most=1e5, unit="m/s")
    # Mean time from one push to the next.
    mean_interval_s: float = number(900.0, at_least=1e-2, at_most=_LONG, unit="s")


@dc.dataclass(slots=True)
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
    cube_m: float = number(340.0e3, at_least=1e-3, at_most=_FAR, unit="m")
    # Least and greatest distance from start to goal.
    min_distance_m: float = number(40.0e3, at_least=1e-3, at_most=_FAR, unit="m")
    max_distance_m: float = number(160.0e3, at_least=1e-3, at_most=_FAR, unit="m")
    # Start and goal lie outside the keep-out ellipsoid with this added to each semi-axis.
    end_clearance_m: float = number(8.0e3, at_least=0.0, at_most=_FAR, unit="m")
    # Greatest share of the thrust limit that hovering at the start or goal may take.
    max_hover_share: float = number(0.7, at_least=1e-6, at_most=1e3)


@dc.dataclass(slots=True)
class ArrivalConfig:
    """When a flight counts as arrived.

    Arrival is the start of the first `dwell_s` in which the spacecraft always stays within
    `radius_m` of the goal and is slower than `speed_m_s`.
    """

    radius_m: float = number(1.0e3, at_least=1e-6, at_most=_FAR, unit="m")
    speed_m_s: float = number(1.0, at_least=1e-9, at_most=1e5, unit="m/s")
    dwell_s: float = number(600.0, at_least=1e-2, at_most=_LONG, unit="s")
    # A flight succeeds only if it arrives by this time. It ends at most `dwell_s` later.
    deadline_s: float = number(7200.0, at_least=1e-2, at_most=_LONG, unit="s")


@dc.dataclass(slots=True)
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
    gravity: str = one_of("exact", GRAVITY)
    spacecraft: SpacecraftConfig = dc.field(default_factory=SpacecraftConfig)
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
    # How the world differs from what is believed; no controller knows it.
    truth: TruthConfig = dc.field(default_factory=TruthConfig)
    # Name of dispersions that ship with proxops, or path of a YAML file of dispersions, from which
    # every flight draws its own world; a path in a scenario file is relative to that file.
    # null: nothing is drawn.
    dispersions: str | None = None
    # Keys of the values that were drawn. proxops writes them when it draws.
    dispersed: list[str] = dc.field(default_factory=list)
    transit: TransitConfig = dc.field(default_factory=TransitConfig)
    arrival: ArrivalConfig = dc.field(default_factory=ArrivalConfig)
    # Time from one command to the next; a command is held for this time.
    control_period_s: float = number(10.0, at_least=1e-2, at_most=3600.0, unit="s")
    # If true, the log holds the lidar's frame of every step.
    log_ranges: bool = True
    # Seed of all random systems of a flight: lidar noise, disturbance, force noise, kicks, varying
    # errors of attitude and acceleration, and the state noise of the hybrid.
    noise_seed: int = number(0, at_least=0, at_most=_LARGEST_WHOLE)
