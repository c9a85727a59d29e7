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
class LearnedLidarConfig:
    """A network in the ray-caster's place: see `proxops.systems.LearnedLidar`.

    Chosen by `lidar: !LearnedLidar {bundle: ...}`; what is not explained is as in `LidarConfig`.
    """

    # Folder that `proxops train-lidar` wrote; in a file relative to it, else to where one is.
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
    # A ray returns if the network gives its hit at least this probability.
    hit_probability: float = 0.5


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
class TransitConfig:
    """Which transit is flown: number `index` of the set of `seed`, or the start and goal given."""

    seed: int = 10000
    index: int = 0
    # Positions in the body-fixed frame; both or neither. Start and goal are at rest in it.
    start_m: list[float] | None = None
    goal_m: list[float] | None = None
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
    lidar: LidarConfig | LearnedLidarConfig = dc.field(default_factory=LidarConfig)
    mpc: MpcConfig = dc.field(default_factory=MpcConfig)
    # None: the command is applied as it is.
    disturbance: RandomWalkDisturbanceConfig | None = None
    mismatch: MismatchConfig = dc.field(default_factory=MismatchConfig)
    transit: TransitConfig = dc.field(default_factory=TransitConfig)
    arrival: ArrivalConfig = dc.field(default_factory=ArrivalConfig)
    # The command is computed, and then held, this often.
    control_period_s: float = 10.0
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
    sensor = tree.get("lidar")
    if path is not None and isinstance(sensor, dict) and isinstance(sensor.get("bundle"), str):
        sensor["bundle"] = str((Path(path).parent / sensor["bundle"]).resolve())
    apply_overrides(tree, overrides)
    scenario = load_typed(Scenario, tree, source)
    check_scenario(scenario, source)
    if isinstance(scenario.lidar, LearnedLidarConfig):
        scenario.lidar.bundle = str(Path(scenario.lidar.bundle).resolve())
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
    if isinstance(scenario.lidar, LidarConfig):
        positive("lidar", "max_incidence_deg")
        each("lidar", ("max_incidence_deg",), lambda value: value <= 90, "must be at most 90")
    else:
        need(bool(scenario.lidar.bundle), "lidar.bundle", "must name the bundle's folder")
        positive("lidar", "hit_probability")
        each("lidar", ("hit_probability",), lambda value: value < 1, "must be below 1")
    positive("lidar", "max_range_m", "planes", "rays")
    not_negative("lidar", "noise_std_m", "dropout", "false_returns")
    each("lidar", ("bias_m",), lambda value: True, "must be finite")
    each("lidar", ("scale_error",), lambda value: value > -1, "must be above -1")
    chances = ("dropout", "false_returns")
    each("lidar", chances, lambda value: value <= 1, "must be at most 1, a chance")
    positive(
        "mpc", "knots", "knot_growth", "nominal_acceleration_m_s2", "min_horizon_s",
        "cold_iterations",
    )  # fmt: skip
    need(scenario.mpc.knots >= 2, "mpc.knots", "must be at least 2")
    not_negative("mpc", "keep_out_margin_m", "fuel_weight")
    if scenario.disturbance is not None:
        positive("disturbance", "reset_period_s")
        not_negative("disturbance", "max_relative_magnitude", "increment_std_n")
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
    for name in ("start_m", "goal_m"):
        value = getattr(transit, name)
        if value is not None:
            need(
                len(value) == 3 and bool(np.isfinite(value).all()),
                f"transit.{name}",
                f"must be three numbers, got {value}",
            )
    positive("arrival", "radius_m", "speed_m_s", "dwell_s", "deadline_s")


def _is_path(body: typing.Any) -> bool:
    return isinstance(body, str) and body.endswith((".yaml", ".yml"))
