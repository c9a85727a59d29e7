"""A scenario: everything that a flight depends on besides its controller, as typed YAML."""

import dataclasses as dc
import difflib
import typing
from pathlib import Path

import numpy as np
import yaml
from pydrake.common.yaml import yaml_dump, yaml_dump_typed, yaml_load, yaml_load_typed

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
    """The ray-cast lidar: 12 planes of 360 rays."""

    # Standard deviation of the range noise; 0 switches it off.
    noise_std_m: float = 50.0
    # Beyond this a ray returns +inf.
    max_range_m: float = 350.0e3


@dc.dataclass
class MpcConfig:
    """The expert: see `proxops.systems.ModelPredictiveController`."""

    # Intervals of the plan, each with a constant force.
    knots: int = 30
    # Length of the plan's last interval over that of its first.
    knot_growth: float = 4.0
    # Time to go is max(min_horizon, sqrt(4 d / a) - c v / a): distance d, closing speed v,
    # nominal acceleration a, closing-speed weight c.
    nominal_acceleration_m_s2: float = 0.025
    closing_speed_weight: float = 0.6
    min_horizon_s: float = 300.0
    # Added to every semi-axis of the keep-out ellipsoid in the plan.
    keep_out_margin_m: float = 3.0e3
    # Relinearisations when there is no recent plan to start from; otherwise one a step.
    cold_iterations: int = 5


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
    lidar: LidarConfig = dc.field(default_factory=LidarConfig)
    mpc: MpcConfig = dc.field(default_factory=MpcConfig)
    # None: the command is applied as it is.
    disturbance: RandomWalkDisturbanceConfig | None = None
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
    if not isinstance(overrides, typing.Mapping):
        overrides = dict(_split_override(text) for text in overrides)
    for key, value in overrides.items():
        _assign(tree, key, value)
    scenario = load_typed(Scenario, tree, source)
    check_scenario(scenario, source)
    return scenario


def dump_scenario(scenario: Scenario) -> str:
    """The whole scenario as YAML that `load_scenario` reads back to an equal one."""
    return yaml_dump_typed(scenario, schema=Scenario)


def parse_scenario(text: str, source: str = "scenario") -> Scenario:
    """The scenario in a YAML text, for instance one that `dump_scenario` wrote."""
    scenario = load_typed(Scenario, yaml_load(data=text), source)
    check_scenario(scenario, source)
    return scenario


def load_typed(schema: type, tree: dict[str, typing.Any], source: str) -> typing.Any:
    """An instance of the dataclass `schema` from nested dicts, over its defaults.

    Raises:
      InputError: an unknown key or a value of the wrong type; `source` names the file in it.
    """
    _refuse_unknown_keys(schema, tree, source)
    try:
        return yaml_load_typed(schema=schema, data=yaml_dump(tree), defaults=schema())
    except (RuntimeError, ValueError, TypeError, AssertionError) as error:
        raise InputError(f"{source}: {error}") from error


def read_mapping(path: Path) -> dict[str, typing.Any]:
    """The mapping at the root of a YAML file, tags kept under the key `_tag`.

    Raises:
      InputError: the file cannot be read, is not YAML, is empty, or holds no mapping.
    """
    if path.is_dir():
        raise InputError(f"{path} is a directory; give a YAML file")
    try:
        text = path.read_text(encoding="utf-8")
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise InputError(f"{path} is not a text file: {error}") from error
    if not text.strip():
        raise InputError(f"{path} is empty; it needs at least one `key: value` line")
    try:
        tree = yaml_load(data=text)
    except (yaml.YAMLError, AttributeError) as error:
        raise InputError(f"{path} is not YAML: {' '.join(str(error).split())}") from error
    if tree is None:
        raise InputError(f"{path} is empty; it needs at least one `key: value` line")
    if not isinstance(tree, dict):
        raise InputError(f"{path} holds a {type(tree).__name__}, not `key: value` lines")
    return tree


def check_scenario(scenario: Scenario, source: str = "scenario") -> None:
    """Raises `InputError` for values that no flight can have, naming the key."""

    def need(good: bool, key: str, why: str) -> None:
        if not good:
            raise InputError(f"{source}: {key} {why}")

    def positive(section: str, *names: str) -> None:
        holder = getattr(scenario, section) if section else scenario
        for name in names:
            value = getattr(holder, name)
            key = f"{section}.{name}" if section else name
            need(np.isfinite(value) and value > 0, key, f"must be positive, got {value}")

    positive("", "control_period_s")
    positive("spacecraft", "mass_kg", "thrust_limit_n", "speed_limit_m_s")
    positive("lidar", "max_range_m")
    need(scenario.lidar.noise_std_m >= 0, "lidar.noise_std_m", "must not be negative")
    positive(
        "mpc", "knots", "knot_growth", "nominal_acceleration_m_s2", "min_horizon_s",
        "cold_iterations",
    )  # fmt: skip
    need(scenario.mpc.knots >= 2, "mpc.knots", "must be at least 2")
    need(scenario.mpc.keep_out_margin_m >= 0, "mpc.keep_out_margin_m", "must not be negative")
    if scenario.disturbance is not None:
        positive("disturbance", "reset_period_s")
        for name in ("max_relative_magnitude", "increment_std_n"):
            value = getattr(scenario.disturbance, name)
            need(value >= 0, f"disturbance.{name}", f"must not be negative, got {value}")
    transit = scenario.transit
    positive("transit", "cube_m", "min_distance_m", "max_distance_m", "max_hover_share")
    need(transit.seed >= 0, "transit.seed", f"must not be negative, got {transit.seed}")
    need(transit.index >= 0, "transit.index", f"must not be negative, got {transit.index}")
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


def _split_override(text: str) -> tuple[str, typing.Any]:
    key, equals, value = text.partition("=")
    if not equals or not key.strip():
        raise InputError(f"override {text!r} is not of the form key.subkey=value")
    try:
        return key.strip(), yaml_load(data=f"value: {value}")["value"]
    except yaml.YAMLError as error:
        raise InputError(f"override {text!r}: the value is not YAML") from error


def _assign(tree: dict[str, typing.Any], dotted_key: str, value: typing.Any) -> None:
    *parents, last = dotted_key.split(".")
    for name in parents:
        child = tree.get(name)
        if not isinstance(child, dict):
            child = tree[name] = {}
        tree = child
    tree[last] = value


def _refuse_unknown_keys(schema: type, tree: dict[str, typing.Any], source: str) -> None:
    """Raises `InputError` for the first key that `schema` lacks, with the nearest one it has."""
    fields = {field.name: field.type for field in dc.fields(schema)}
    for key, value in tree.items():
        if key == "_tag":
            continue
        if key not in fields:
            near = difflib.get_close_matches(str(key), fields, n=1, cutoff=0.0)[0]
            raise InputError(
                f"{source}: there is no key {key!r} in {schema.__name__}; the nearest is {near!r}"
            )
        options = typing.get_args(fields[key]) or (fields[key],)
        nested = [option for option in options if dc.is_dataclass(option)]
        if nested and isinstance(value, dict):
            tag = value.get("_tag", "!" + nested[0].__name__)
            chosen = {"!" + option.__name__: option for option in nested}.get(tag)
            if chosen is None:
                raise InputError(
                    f"{source}: {key} cannot be {tag}; "
                    f"choose from {', '.join('!' + option.__name__ for option in nested)}"
                )
            _refuse_unknown_keys(chosen, value, f"{source}: {key}")
        elif nested and not (value is None and type(None) in options):
            raise InputError(f"{source}: {key} needs `key: value` lines, got {value!r}")
