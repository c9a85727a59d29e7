"""A scenario: everything that a flight depends on besides its controller, as typed YAML."""

import dataclasses as dc
import math
import typing
from pathlib import Path

import numpy as np
from pydrake.common.yaml import yaml_dump_typed

from proxops.diagrams.typed_yaml import (
    apply_overrides,
    load_typed,
    parse_mapping,
    read_mapping,
)
from proxops.systems.errors import InputError

# What the expert may minimise.
COSTS = ("time_and_fuel", "weighted")

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


@dc.dataclass
class WeightedCostConfig:
    """The paper's cost: see `proxops.systems.WeightedProgram`."""

    # Length of every plan.
    horizon_s: float = 3000.0
    # Errors that weigh as much as full thrust along one axis.
    position_error_m: float = 10.0e3
    speed_error_m_s: float = 20.0


@dc.dataclass
class MpcConfig:
    """The expert: see `proxops.systems.ModelPredictiveController`."""

    # Intervals of the plan, each with a constant force.
    knots: int = 16
    # Length of the plan's last interval over that of its first.
    knot_growth: float = 4.0
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
    """A flight near a small body. Every default is the paper's, or DESIGN's where it is silent."""

    # Name of a body that ships with proxops, or path of a body's YAML file.
    body: str = "kleopatra"
    spacecraft: SpacecraftConfig = dc.field(default_factory=SpacecraftConfig)
    lidar: LidarConfig = dc.field(default_factory=LidarConfig)
    mpc: MpcConfig = dc.field(default_factory=MpcConfig)
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


def load_scenario(
    path: str | Path | None = None,
    overrides: typing.Sequence[str] | typing.Mapping[str, typing.Any] = (),
) -> Scenario:
    """Reads a scenario file, if any, over the defaults, then applies the overrides.

    Args:
      path: YAML file; it need only hold what differs from the defaults.
      overrides: `key.subkey=value` texts with the value in YAML, or such keys and values.

    Raises:
      InputError: the file cannot be read or is not YAML, a key is unknown (the message gives the
        nearest valid one), or a value has the wrong type or makes no sense.
    """
    source = "scenario" if path is None else str(path)
    tree = {} if path is None else read_mapping(Path(path))
    if path is not None and _is_path(tree.get("body")):
        tree["body"] = str((Path(path).parent / tree["body"]).resolve())
    apply_overrides(tree, overrides)
    scenario = load_typed(Scenario, tree, source)
    check_scenario(scenario, source)
    return scenario


def dump_scenario(scenario: Scenario) -> str:
    """The whole scenario as YAML that `load_scenario` reads back to an equal one."""
    text = yaml_dump_typed(scenario, schema=Scenario)
    assert text is not None  # It is when the text is written to a file instead.
    return text


def parse_scenario(text: str, source: str = "scenario") -> Scenario:
    """The scenario in a YAML text, for instance one that `dump_scenario` wrote."""
    scenario = load_typed(Scenario, parse_mapping(text, source), source)
    check_scenario(scenario, source)
    return scenario


def check_scenario(scenario: Scenario, source: str = "scenario") -> None:
    """Raises `InputError` for values that no flight can have, naming the key."""

    def need(good: bool, key: str, why: str) -> None:
        if not good:
            raise InputError(f"{source}: {key} {why}")

    def each(section: str, names: tuple[str, ...], good: typing.Callable, why: str) -> None:
        holder = getattr(scenario, section) if section else scenario
        for name in names:
            value = getattr(holder, name)
            key = f"{section}.{name}" if section else name
            need(math.isfinite(value) and good(value), key, f"{why}, got {value}")

    def positive(section: str, *names: str) -> None:
        each(section, names, lambda value: value > 0, "must be positive")

    def not_negative(section: str, *names: str) -> None:
        each(section, names, lambda value: value >= 0, "must not be negative")

    positive("", "control_period_s")
    not_negative("", "noise_seed")
    positive("spacecraft", "mass_kg", "thrust_limit_n", "speed_limit_m_s")
    positive("mismatch", "gravity", "mass", "thrust")
    need(
        0.0 <= scenario.mpc.estimator_gain <= 1.0,
        "mpc.estimator_gain",
        f"must be from 0 to 1, got {scenario.mpc.estimator_gain}",
    )
    positive("lidar", "max_range_m", "planes", "rays", "max_incidence_deg")
    not_negative("lidar", "noise_std_m", "dropout", "false_returns")
    each("lidar", ("bias_m",), lambda value: True, "must be finite")
    each("lidar", ("scale_error",), lambda value: value > -1, "must be above -1")
    each("lidar", ("max_incidence_deg",), lambda value: value <= 90, "must be at most 90")
    chances = ("dropout", "false_returns")
    each("lidar", chances, lambda value: value <= 1, "must be at most 1, a chance")
    positive(
        "mpc", "knots", "knot_growth", "nominal_acceleration_m_s2", "min_horizon_s",
        "cold_iterations",
    )  # fmt: skip
    need(scenario.mpc.knots >= 2, "mpc.knots", "must be at least 2")
    need(
        scenario.mpc.cost in COSTS,
        "mpc.cost",
        f"must be {' or '.join(COSTS)}, got {scenario.mpc.cost!r}",
    )
    for name, value in dc.asdict(scenario.mpc.weighted).items():
        good = math.isfinite(value) and value > 0
        need(good, f"mpc.weighted.{name}", f"must be positive, got {value}")
    need(
        0.0 <= scenario.mpc.solve_delay_s <= scenario.control_period_s,
        "mpc.solve_delay_s",
        f"must be from 0 to control_period_s, got {scenario.mpc.solve_delay_s}",
    )
    not_negative("mpc", "keep_out_margin_m", "fuel_weight")
    if scenario.disturbance is not None:
        positive("disturbance", "reset_period_s")
        not_negative("disturbance", "max_relative_magnitude", "increment_std_n")
    if scenario.force_noise is not None:
        not_negative("force_noise", "std_n", "correlation_time_s")
    if scenario.kicks is not None:
        not_negative("kicks", "velocity_std_m_s")
        period = scenario.control_period_s
        why = f"must be at least control_period_s, {period:g} s"
        each("kicks", ("mean_interval_s",), lambda value: value >= period, why)
    transit = scenario.transit
    positive("transit", "cube_m", "min_distance_m", "max_distance_m", "max_hover_share")
    not_negative("transit", "seed", "index", "end_clearance_m")
    need(
        transit.min_distance_m < transit.max_distance_m,
        "transit.min_distance_m",
        "must be below transit.max_distance_m",
    )
    need(
        (transit.start_m is None) == (transit.goal_m is None),
        "transit",
        "needs start_m and goal_m both or neither",
    )
    for name in ("start_m", "goal_m", "start_velocity_m_s"):
        value = getattr(transit, name)
        if value is not None:
            need(
                len(value) == 3 and bool(np.isfinite(value).all()),
                f"transit.{name}",
                f"must be three numbers, got {value}",
            )
    if transit.start_velocity_m_s is not None:
        slow = np.abs(transit.start_velocity_m_s).max() <= scenario.spacecraft.speed_limit_m_s
        why = "must be within spacecraft.speed_limit_m_s per axis"
        need(bool(slow), "transit.start_velocity_m_s", f"{why}, got {transit.start_velocity_m_s}")
    positive("arrival", "radius_m", "speed_m_s", "dwell_s", "deadline_s")


def _is_path(body: typing.Any) -> bool:
    return isinstance(body, str) and body.endswith((".yaml", ".yml"))
