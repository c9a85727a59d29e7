"""The tree of a scenario: every value that it has, its default, its unit and its meaning."""

import dataclasses as dc

from proxops.diagrams.scenario.limits import number, one_of
from proxops.systems.hybrid import GateKind, PeriodRule

# What the expert may minimise.
COSTS = ("time_and_fuel", "weighted")
# Whole numbers up to this fit into a log's attributes.
_LARGEST_WHOLE = 2**63 - 1
# Lengths (m) of what surrounds a body, and times (s) of a flight, are no greater than these.
_FAR, _LONG = 1e9, 1e8

# pydrake's yaml_load_typed takes neither frozen dataclasses, nor tuples, nor postponed annotations.


@dc.dataclass
class SpacecraftConfig:
    """A point mass with one thruster pair per axis, its attitude held to the body."""

    mass_kg: float = number(100.0, at_least=1e-3, at_most=1e7, unit="kg")
    # Greatest force per axis.
    thrust_limit_n: float = number(7.0, at_least=1e-6, at_most=1e7, unit="N")
    # Greatest speed per axis in the body-fixed frame, respected by the expert.
    speed_limit_m_s: float = number(40.0, at_least=1e-6, at_most=1e5, unit="m/s")


@dc.dataclass
class LidarConfig:
    """The ray-cast lidar: see `proxops.systems.Lidar`."""

    # Standard deviation of the range noise; 0 switches it off.
    noise_std_m: float = number(50.0, at_least=0.0, at_most=_FAR, unit="m")
    # Beyond this a ray returns +inf.
    max_range_m: float = number(350.0e3, at_least=1e-3, at_most=_FAR, unit="m")
    # Planes turned about a common axis by equal angles, and rays in each.
    planes: int = number(12, at_least=1, at_most=360)
    rays: int = number(360, at_least=1, at_most=3600)
    # Added to every range.
    bias_m: float = number(0.0, at_least=-_FAR, at_most=_FAR, unit="m")
    # Ranges are 1 + this times as long.
    scale_error: float = number(0.0, above=-1.0, at_most=1e3)
    # A surface met at a greater angle from its normal returns nothing; 90: all of it returns.
    max_incidence_deg: float = number(90.0, at_least=1e-3, at_most=90.0, unit="degrees")
    # Chance that a return is lost.
    dropout: float = number(0.0, at_least=0.0, at_most=1.0)
    # Chance that a ray is answered from a random range where there is nothing.
    false_returns: float = number(0.0, at_least=0.0, at_most=1.0)
    # All rays are turned by this angle, about an axis drawn from noise_seed, and nobody knows.
    attitude_error_deg: float = number(0.0, at_least=0.0, at_most=180.0, unit="degrees")


@dc.dataclass
class WeightedCostConfig:
    """The paper's cost: see `proxops.systems.WeightedProgram`."""

    # Length of every plan.
    horizon_s: float = number(3000.0, at_least=1e-2, at_most=_LONG, unit="s")
    # Errors that weigh as much as full thrust along one axis.
    position_error_m: float = number(10.0e3, at_least=1e-3, at_most=_FAR, unit="m")
    speed_error_m_s: float = number(20.0, at_least=1e-6, at_most=1e5, unit="m/s")


@dc.dataclass
class LearnedLidarConfig:
    """A network in the ray-caster's place: see `proxops.systems.LearnedLidar`.

    Chosen by `lidar: !LearnedLidar {bundle: ...}`; what is not explained is as in `LidarConfig`.
    """

    # The folder `bundle` that `proxops train-lidar` wrote; in a file relative to it, else to where
    # one is.
    bundle: str = ""
    noise_std_m: float = number(50.0, at_least=0.0, at_most=_FAR, unit="m")
    max_range_m: float = number(350.0e3, at_least=1e-3, at_most=_FAR, unit="m")
    # Those that the bundle was trained for.
    planes: int = number(12, at_least=1, at_most=360)
    rays: int = number(360, at_least=1, at_most=3600)
    bias_m: float = number(0.0, at_least=-_FAR, at_most=_FAR, unit="m")
    scale_error: float = number(0.0, above=-1.0, at_most=1e3)
    dropout: float = number(0.0, at_least=0.0, at_most=1.0)
    false_returns: float = number(0.0, at_least=0.0, at_most=1.0)
    attitude_error_deg: float = number(0.0, at_least=0.0, at_most=180.0, unit="degrees")
    # A ray returns if the network gives its hit at least this probability.
    hit_probability: float = number(0.5, at_least=1e-9, below=1.0)


@dc.dataclass
class MpcConfig:
    """The expert: see `proxops.systems.ModelPredictiveController`."""

    # Intervals of the plan, each with a constant force.
    intervals: int = number(16, at_least=2, at_most=500)
    # Length of the plan's last interval over that of its first.
    interval_growth: float = number(4.0, at_least=1e-3, at_most=1e3)
    # Sets the price of time: without gravity and fuel weight, transits take as long as with this
    # acceleration, one way and then the other.
    nominal_acceleration_m_s2: float = number(0.03, at_least=1e-9, at_most=1e6, unit="m/s^2")
    # Weight of thrust's 1-norm (fuel) against its square in the cost, both over the limit: at 0
    # thrust is smoothest, at 1 the fuel is nearly least.
    fuel_weight: float = number(0.8, at_least=0.0, at_most=1e6)
    # A plan is never shorter than this.
    min_horizon_s: float = number(300.0, at_least=1e-2, at_most=_LONG, unit="s")
    # Added to every semi-axis of the keep-out ellipsoid in the plan.
    keep_out_margin_m: float = number(3.0e3, at_least=0.0, at_most=_FAR, unit="m")
    # Believe in a point mass instead of the polyhedron.
    point_mass: bool = False
    # Above 0: estimate, with this gain a step, what pushes besides gravity, and plan for it.
    estimator_gain: float = number(0.0, at_least=0.0, at_most=1.0)
    # Relinearisations when there is no recent plan to start from; otherwise one a step.
    cold_iterations: int = number(10, at_least=1, at_most=1000)
    # What a plan minimises: `time_and_fuel`, as the values above say, or `weighted`, the paper's.
    cost: str = one_of("time_and_fuel", COSTS)
    weighted: WeightedCostConfig = dc.field(default_factory=WeightedCostConfig)
    # A command takes effect this long after the state it was computed from, and the expert plans
    # from where it will be by then: solve time, in simulated time. At most control_period_s.
    solve_delay_s: float = number(0.0, at_least=0.0, at_most=1e6, unit="s")


@dc.dataclass
class PolicyConfig:
    """The learned policy: see `proxops.systems.NeuralPolicy`."""

    # The folder `bundle` that `proxops train` wrote; in a file relative to it, else to where one
    # is. null: the policy that ships with proxops.
    bundle: str | None = None


@dc.dataclass
class HybridConfig:
    """The policy, watched over by the MPC: see `proxops.systems.HybridSelector`."""

    # How both forces are compared: strict, paper or printed (`proxops.systems.AgreementGate`).
    gate: str = one_of("strict", list(GateKind))
    # They agree if they are nearer to each other than this, or, as the gate has it, if their
    # directions are.
    epsilon_magnitude_n: float = number(1.0, at_least=0.0, at_most=1e7, unit="N")
    epsilon_angle_deg: float = number(10.0, at_least=0.0, at_most=1e3, unit="degrees")
    # strict: a smaller force has no direction.
    dead_band_n: float = number(0.2, at_least=0.0, at_most=1e7, unit="N")
    # From check to check: fixed, or adaptive (`proxops.systems.CheckSchedule`).
    period_rule: str = one_of("fixed", list(PeriodRule))
    # Control steps from one check to the next; adaptive: of forces that only just agree,
    # or don't.
    check_period: int = number(10, at_least=1, at_most=1000000)
    # adaptive: of equal forces. Each period ends while the spacecraft can still be stopped before
    # the keep-out ellipsoid, whatever the thrusters did.
    longest_period: int = number(100, at_least=1, at_most=1000000)
    # Standard deviations per axis of errors in the state that the MPC is given.
    state_noise_position_m: float = number(0.0, at_least=0.0, at_most=_FAR, unit="m")
    state_noise_velocity_m_s: float = number(0.0, at_least=0.0, at_most=1e5, unit="m/s")


@dc.dataclass
class MismatchConfig:
    """What the plant truly is, as multiples of what the expert believes."""

    # Of the body's density.
    gravity: float = number(1.0, at_least=1e-3, at_most=1e3)
    # Of the spacecraft's mass.
    mass: float = number(1.0, at_least=1e-3, at_most=1e3)
    # Of the force for a command.
    thrust: float = number(1.0, at_least=1e-3, at_most=1e3)


@dc.dataclass
class RandomWalkDisturbanceConfig:
    """The paper's disturbance of the commanded force: a slow random walk."""

    # The walk starts anew, with a new limit, this often.
    reset_period_s: float = number(100.0, at_least=1e-2, at_most=_LONG, unit="s")
    # At each reset the limit is drawn from 0 to this multiple of the command's magnitude.
    max_relative_magnitude: float = number(2.0, at_least=0.0, at_most=1e3)
    # Standard deviation per axis of the walk's increment at each control step.
    increment_std_n: float = number(0.5, at_least=0.0, at_most=1e7, unit="N")


@dc.dataclass
class AssuranceConfig:
    """The filter that keeps any controller out: see `proxops.systems.RuntimeAssurance`.

    It believes the scenario without its `mismatch`.
    """

    # Added to every semi-axis of the keep-out ellipsoid: for what the filter's prediction errs by,
    # about a metre, and for disturbances, which act after it.
    margin_m: float = number(100.0, at_least=0.0, at_most=_FAR, unit="m")


@dc.dataclass
class ForceNoiseConfig:
    """Normal noise of its own size on the commanded force: coasting is disturbed too."""

    # Standard deviation per axis, and the time over which the noise forgets itself; 0: white.
    std_n: float = number(0.7, at_least=0.0, at_most=1e7, unit="N")
    correlation_time_s: float = number(100.0, at_least=0.0, at_most=_LONG, unit="s")


@dc.dataclass
class KicksConfig:
    """Pushes from outside at random times, each spread over one control period."""

    # Standard deviation per axis of the change of velocity.
    velocity_std_m_s: float = number(2.0, at_least=0.0, at_most=1e5, unit="m/s")
    # Mean time from one to the next.
    mean_interval_s: float = number(900.0, at_least=1e-2, at_most=_LONG, unit="s")


@dc.dataclass
class TransitConfig:
    """Which transit is flown: number `index` of the set of `seed`, or the start and goal given."""

    seed: int = number(10000, at_least=0, at_most=_LARGEST_WHOLE)
    index: int = number(0, at_least=0, at_most=_LARGEST_WHOLE)
    # Positions in the body-fixed frame; both or neither. The goal is at rest in it.
    start_m: list[float] | None = None
    goal_m: list[float] | None = None
    # Velocity at the start in that frame; null: at rest.
    start_velocity_m_s: list[float] | None = None
    # How the set is drawn: cube edge, distance from start to goal, clearance of both added to
    # each semi-axis of the keep-out ellipsoid, share of the thrust limit that hovering may take.
    cube_m: float = number(340.0e3, at_least=1e-3, at_most=_FAR, unit="m")
    min_distance_m: float = number(40.0e3, at_least=1e-3, at_most=_FAR, unit="m")
    max_distance_m: float = number(160.0e3, at_least=1e-3, at_most=_FAR, unit="m")
    end_clearance_m: float = number(8.0e3, at_least=0.0, at_most=_FAR, unit="m")
    max_hover_share: float = number(0.7, at_least=1e-6, at_most=1e3)


@dc.dataclass
class ArrivalConfig:
    """Arrival is the start of the first `dwell_s` spent wholly within both radii of the goal."""

    radius_m: float = number(1.0e3, at_least=1e-6, at_most=_FAR, unit="m")
    speed_m_s: float = number(1.0, at_least=1e-9, at_most=1e5, unit="m/s")
    dwell_s: float = number(600.0, at_least=1e-2, at_most=_LONG, unit="s")
    # Success needs arrival by then; the flight ends `dwell_s` later at the latest.
    deadline_s: float = number(7200.0, at_least=1e-2, at_most=_LONG, unit="s")


@dc.dataclass
class Scenario:
    """A flight near a small body. Every default is the paper's, or ours where it is silent."""

    # Name of a body that ships with proxops, or path of a body's YAML file.
    body: str = "kleopatra"
    spacecraft: SpacecraftConfig = dc.field(default_factory=SpacecraftConfig)
    lidar: LidarConfig | LearnedLidarConfig = dc.field(default_factory=LidarConfig)
    mpc: MpcConfig = dc.field(default_factory=MpcConfig)
    policy: PolicyConfig = dc.field(default_factory=PolicyConfig)
    hybrid: HybridConfig = dc.field(default_factory=HybridConfig)
    # None: whatever the controller commands is flown.
    assurance: AssuranceConfig | None = None
    # None: the command is applied as it is.
    disturbance: RandomWalkDisturbanceConfig | None = None
    # None: no noise is added after that.
    force_noise: ForceNoiseConfig | None = None
    # None: nothing pushes the spacecraft from outside.
    kicks: KicksConfig | None = None
    mismatch: MismatchConfig = dc.field(default_factory=MismatchConfig)
    transit: TransitConfig = dc.field(default_factory=TransitConfig)
    arrival: ArrivalConfig = dc.field(default_factory=ArrivalConfig)
    # The command is computed, and then held, this often.
    control_period_s: float = number(10.0, at_least=1e-2, at_most=3600.0, unit="s")
    # Whether the log holds the lidar's frame of every step.
    log_ranges: bool = True
    # Seeds the lidar's noise and the disturbance.
    noise_seed: int = number(0, at_least=0, at_most=_LARGEST_WHOLE)
