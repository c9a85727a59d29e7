"""The tree of a scenario: every value that it has, its default, its unit and its meaning."""

import dataclasses as dc

# pydrake's yaml_load_typed takes neither frozen dataclasses, nor tuples, nor postponed annotations.


@dc.dataclass
class SpacecraftConfig:
    """A point mass with one thruster pair per axis, its attitude held to the body."""

    mass_kg: float = 100.0
    # Greatest force per axis.
    thrust_limit_n: float = 7.0
    # Greatest speed per axis in the body-fixed frame, respected by the expert.
    speed_limit_m_s: float = 40.0


@dc.dataclass
class LidarConfig:
    """The ray-cast lidar: see `proxops.systems.Lidar`."""

    # Standard deviation of the range noise; 0 switches it off.
    noise_std_m: float = 50.0
    # Beyond this a ray returns +inf.
    max_range_m: float = 350.0e3
    # Planes turned about a common axis by equal angles, and rays in each.
    planes: int = 12
    rays: int = 360
    # Added to every range.
    bias_m: float = 0.0
    # Ranges are 1 + this times as long.
    scale_error: float = 0.0
    # A surface met at a greater angle from its normal returns nothing; 90: all of it returns.
    max_incidence_deg: float = 90.0
    # Chance that a return is lost.
    dropout: float = 0.0
    # Chance that a ray is answered from a random range where there is nothing.
    false_returns: float = 0.0
    # All rays are turned by this angle, about an axis drawn from noise_seed, and nobody knows.
    attitude_error_deg: float = 0.0


@dc.dataclass
class WeightedCostConfig:
    """The paper's cost: see `proxops.systems.WeightedProgram`."""

    # Length of every plan.
    horizon_s: float = 3000.0
    # Errors that weigh as much as full thrust along one axis.
    position_error_m: float = 10.0e3
    speed_error_m_s: float = 20.0


@dc.dataclass
class LearnedLidarConfig:
    """A network in the ray-caster's place: see `proxops.systems.LearnedLidar`.

    Chosen by `lidar: !LearnedLidar {bundle: ...}`; what is not explained is as in `LidarConfig`.
    """

    # The folder `bundle` that `proxops train-lidar` wrote; in a file relative to it, else to where
    # one is.
    bundle: str = ""
    noise_std_m: float = 50.0
    max_range_m: float = 350.0e3
    # Those that the bundle was trained for.
    planes: int = 12
    rays: int = 360
    bias_m: float = 0.0
    scale_error: float = 0.0
    dropout: float = 0.0
    false_returns: float = 0.0
    attitude_error_deg: float = 0.0
    # A ray returns if the network gives its hit at least this probability.
    hit_probability: float = 0.5


@dc.dataclass
class MpcConfig:
    """The expert: see `proxops.systems.ModelPredictiveController`."""

    # Intervals of the plan, each with a constant force.
    intervals: int = 16
    # Length of the plan's last interval over that of its first.
    interval_growth: float = 4.0
    # Sets the price of time: without gravity and fuel weight, transits take as long as with this
    # acceleration, one way and then the other.
    nominal_acceleration_m_s2: float = 0.03
    # Weight of thrust's 1-norm (fuel) against its square in the cost, both over the limit: at 0
    # thrust is smoothest, at 1 the fuel is nearly least.
    fuel_weight: float = 0.8
    # A plan is never shorter than this.
    min_horizon_s: float = 300.0
    # Added to every semi-axis of the keep-out ellipsoid in the plan.
    keep_out_margin_m: float = 3.0e3
    # Believe in a point mass instead of the polyhedron.
    point_mass: bool = False
    # Above 0: estimate, with this gain a step, what pushes besides gravity, and plan for it.
    estimator_gain: float = 0.0
    # Relinearisations when there is no recent plan to start from; otherwise one a step.
    cold_iterations: int = 10
    # What a plan minimises: `time_and_fuel`, as the values above say, or `weighted`, the paper's.
    cost: str = "time_and_fuel"
    weighted: WeightedCostConfig = dc.field(default_factory=WeightedCostConfig)
    # A command takes effect this long after the state it was computed from, and the expert plans
    # from where it will be by then: solve time, in simulated time. At most control_period_s.
    solve_delay_s: float = 0.0


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
    gate: str = "strict"
    # They agree if they are nearer to each other than this, or, as the gate has it, if their
    # directions are.
    epsilon_magnitude_n: float = 1.0
    epsilon_angle_deg: float = 10.0
    # strict: a smaller force has no direction.
    dead_band_n: float = 0.2
    # From check to check: fixed, or adaptive (`proxops.systems.CheckSchedule`).
    period_rule: str = "fixed"
    # Control steps from one check to the next; adaptive: of forces that only just agree,
    # or don't.
    check_period: int = 10
    # adaptive: of equal forces. Each period ends while the spacecraft can still be stopped before
    # the keep-out ellipsoid, whatever the thrusters did.
    longest_period: int = 100
    # Standard deviations per axis of errors in the state that the MPC is given.
    state_noise_position_m: float = 0.0
    state_noise_velocity_m_s: float = 0.0


@dc.dataclass
class MismatchConfig:
    """What the plant truly is, as multiples of what the expert believes."""

    # Of the body's density.
    gravity: float = 1.0
    # Of the spacecraft's mass.
    mass: float = 1.0
    # Of the force for a command.
    thrust: float = 1.0


@dc.dataclass
class RandomWalkDisturbanceConfig:
    """The paper's disturbance of the commanded force: a slow random walk."""

    # The walk starts anew, with a new limit, this often.
    reset_period_s: float = 100.0
    # At each reset the limit is drawn from 0 to this multiple of the command's magnitude.
    max_relative_magnitude: float = 2.0
    # Standard deviation per axis of the walk's increment at each control step.
    increment_std_n: float = 0.5


@dc.dataclass
class AssuranceConfig:
    """The filter that keeps any controller out: see `proxops.systems.RuntimeAssurance`.

    It believes the scenario without its `mismatch`.
    """

    # Added to every semi-axis of the keep-out ellipsoid: for what the filter's prediction errs by,
    # about a metre, and for disturbances, which act after it.
    margin_m: float = 100.0


@dc.dataclass
class ForceNoiseConfig:
    """Normal noise of its own size on the commanded force: coasting is disturbed too."""

    # Standard deviation per axis, and the time over which the noise forgets itself; 0: white.
    std_n: float = 0.7
    correlation_time_s: float = 100.0


@dc.dataclass
class KicksConfig:
    """Pushes from outside at random times, each spread over one control period."""

    # Standard deviation per axis of the change of velocity.
    velocity_std_m_s: float = 2.0
    # Mean time from one to the next.
    mean_interval_s: float = 900.0


@dc.dataclass
class TransitConfig:
    """Which transit is flown: number `index` of the set of `seed`, or the start and goal given."""

    seed: int = 10000
    index: int = 0
    # Positions in the body-fixed frame; both or neither. The goal is at rest in it.
    start_m: list[float] | None = None
    goal_m: list[float] | None = None
    # Velocity at the start in that frame; null: at rest.
    start_velocity_m_s: list[float] | None = None
    # How the set is drawn: cube edge, distance from start to goal, clearance of both added to
    # each semi-axis of the keep-out ellipsoid, share of the thrust limit that hovering may take.
    cube_m: float = 340.0e3
    min_distance_m: float = 40.0e3
    max_distance_m: float = 160.0e3
    end_clearance_m: float = 8.0e3
    max_hover_share: float = 0.7


@dc.dataclass
class ArrivalConfig:
    """Arrival is the start of the first `dwell_s` spent wholly within both radii of the goal."""

    radius_m: float = 1.0e3
    speed_m_s: float = 1.0
    dwell_s: float = 600.0
    # Success needs arrival by then; the flight ends `dwell_s` later at the latest.
    deadline_s: float = 7200.0


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
    control_period_s: float = 10.0
    # Whether the log holds the lidar's frame of every step.
    log_ranges: bool = True
    # Seeds the lidar's noise and the disturbance.
    noise_seed: int = 0
