"""Dispersions: the world of each flight, drawn from named distributions."""

from __future__ import annotations

import copy
import dataclasses as dc
import functools
import hashlib
import typing
import warnings
from collections.abc import Callable
from pathlib import Path

from proxops.assets import ASSETS
from proxops.diagrams.scenario.body import Body
from proxops.diagrams.scenario.declared_bounds import (
    bounds_of_dispersions,
    exceeded,
    in_si,
    own_values,
)
from proxops.diagrams.scenario.distributions import Choice, Distribution, Fixed, parse_distribution
from proxops.diagrams.scenario.dotted_keys import (
    KNOWN_ON_THE_DAY,
    default_at,
    field_at,
    set_value,
    value_at,
    why_not_dispersed,
)
from proxops.diagrams.scenario.limits import check_limits, limits_of
from proxops.diagrams.scenario.navigation_config import LidarNavigationConfig
from proxops.diagrams.scenario.scenario_checks import check_scenario
from proxops.diagrams.scenario.scenario_config import (
    AssuranceBoundsConfig,
    AssuranceConfig,
    Scenario,
)
from proxops.diagrams.scenario.told_errors import errors_of_dispersions
from proxops.diagrams.scenario.transits import scenario_transit
from proxops.diagrams.scenario.typed_yaml import (
    fits,
    in_words,
    is_number,
    load_typed,
    read_mapping,
)
from proxops.systems.assurance import AssuranceBounds
from proxops.systems.common import InputError, derived_seed, generator

_FOLDER = ASSETS / "dispersions"
# A number that is drawn may be given as a multiple of these.
_TIMES = ("value", "size", "thrust", "thrust_acceleration")


@dc.dataclass(frozen=True)
class Dispersion:
    """How one value of a scenario is dispersed."""

    key: str
    """Dotted key of the value. Of a list, each number is drawn by itself."""
    distribution: Distribution
    times: str | None = None
    """What the drawn number is multiplied by. `value`: the scenario's own value; `size`: the
    greatest extent of the map in m; `thrust`: the thrust limit in N; `thrust_acceleration`: the
    thrust limit over the mass in m/s^2. None: nothing."""
    source: str = ""
    """Where the numbers come from."""

    @property
    def is_random(self) -> bool:
        """Whether the value differs from flight to flight."""
        return not isinstance(self.distribution, Fixed)

    @property
    def size(self) -> int | None:
        """How many numbers the value has, if it is a list; None if it is not."""
        template = default_at(self.key)
        return len(template) if isinstance(template, list) else None

    @property
    def limits(self) -> tuple[float, float] | None:
        """The least and the greatest number that the scenario permits; None without limits."""
        return limits_of(field_at(self.key))

    def in_its_unit(self, value: typing.Any, scenario: Scenario, body: Body) -> typing.Any:
        """Gives a value of the distribution, multiplied by its unit if it is a number."""
        return self.unit(scenario, body) * value if is_number(value) else value

    def unit(self, scenario: Scenario, body: Body) -> float:
        """Gives what the drawn number is multiplied by."""
        if self.times == "size":
            return float(body.shape.extents.max())
        if self.times == "thrust":
            return scenario.spacecraft.thrust_limit_n
        if self.times == "thrust_acceleration":
            return scenario.spacecraft.thrust_limit_n / scenario.spacecraft.mass_kg
        return float(value_at(scenario, self.key)) if self.times == "value" else 1.0


def load_dispersions(name_or_path: str) -> list[Dispersion]:
    """Reads dispersions: a name that ships with proxops, or the path of a YAML file.

    Each key of the file is a dotted key of the scenario. Its value is a distribution, such as
    `{normal: 1.0, three_sigma: 0.1}`, or a plain value, which every flight has.

    Raises:
      InputError: there are no such dispersions; a key is unknown, or not of the world; or a
        distribution is wrong. The message names the file and the key.
    """
    path = Path(name_or_path)
    if not name_or_path.endswith((".yaml", ".yml")):
        path = _FOLDER / f"{name_or_path}.yaml"
        if not path.is_file():
            known = ", ".join(sorted(file.stem for file in _FOLDER.glob("*.yaml")))
            raise InputError(
                f"no dispersions {name_or_path!r} ship with proxops ({known} do); for your own, "
                "give the path of a .yaml file"
            )
    tree = read_mapping(path)
    found = []
    for key, entry in tree.items():
        complaint = why_not_dispersed(key)
        if complaint is not None:
            raise InputError(f"{name_or_path}: {complaint}")
        try:
            found.append(_parse(key, entry))
        except InputError as error:
            raise InputError(f"{name_or_path}: {key} {error}") from error
    return found


def _loaded(name_or_path: str) -> list[Dispersion]:
    """Gives dispersions, read again only if their file has changed."""
    path = Path(name_or_path)
    return _loaded_at(name_or_path, path.stat().st_mtime_ns if path.is_file() else 0)


@functools.lru_cache(maxsize=4)
def _loaded_at(name_or_path: str, changed: int) -> list[Dispersion]:
    return load_dispersions(name_or_path)


def draw_world(scenario: Scenario, body: Body) -> Scenario:
    """Draws the world of a scenario's flight from the scenario's dispersions.

    Each draw depends on seed and number of the transit and on the dispersed key alone. The transit
    is the one of the scenario before the draw. The navigation is told the dispersions, as
    `navigation.expected`, and not the draw.

    Args:
      scenario: the scenario.
      body: the body of the scenario.

    Returns:
      The scenario with the drawn values, with their keys in `dispersed`, and without `dispersions`.
      Without dispersions nothing is drawn. The bounds of runtime assurance are values in any case.

    Raises:
      InputError: see `load_dispersions`; or a value may be drawn that is beyond its limits.
    """
    if scenario.dispersions is None:
        return _with_bounds(scenario, body, [])
    dispersions = _loaded(scenario.dispersions)
    check_dispersions(dispersions, scenario, body)

    def drawn(each: Dispersion, uniform: float) -> typing.Any:
        return each.in_its_unit(each.distribution.value(uniform), scenario, body)

    world = world_of(scenario, body, dispersions, drawn)
    world.dispersed = [each.key for each in dispersions if each.is_random]
    check_scenario(world, f"{scenario.dispersions}, transit {scenario.transit.index}")
    return world


def world_of(
    scenario: Scenario,
    body: Body,
    dispersions: typing.Sequence[Dispersion],
    value: Callable[[Dispersion, float], typing.Any],
) -> Scenario:
    """Makes the world of a scenario's flight from random numbers of its transit.

    Args:
      scenario: the scenario.
      body: the body of the scenario.
      dispersions: what is dispersed.
      value: gives the value of a dispersed quantity, or of one number of a list, from a uniform
        random number (0 to 1). The number depends on seed and number of the transit, on the key and
        on the place in the list alone.

    Returns:
      A copy of the scenario with the values, without `dispersions`. Its navigation is told how much
      is dispersed, unless the scenario says what it is to expect. It is not checked.
    """
    transit, world = scenario.transit, copy.deepcopy(scenario)
    if any(each.key in KNOWN_ON_THE_DAY for each in dispersions) and transit.start_m is None:
        # Another mass would permit other transits.
        ends = scenario_transit(scenario, body)
        world.transit.start_m, world.transit.goal_m = ends.start.tolist(), ends.goal.tolist()
    for each in dispersions:
        size = each.size
        values = [
            value(each, _uniform(transit.seed, transit.index, each.key, k))
            for k in range(size or 1)
        ]
        set_value(world, each.key, values[0] if size is None else values)
    if isinstance(world.navigation, LidarNavigationConfig) and world.navigation.expected is None:
        spread = _spread(dispersions, scenario, body)
        world.navigation.expected = errors_of_dispersions(spread, scenario, body)
    world.assurance = _with_bounds(scenario, body, dispersions).assurance
    world.dispersions = None
    return world


def assurance_bounds(scenario: Scenario, body: Body) -> AssuranceBounds:
    """Gives the errors within which a scenario's runtime assurance keeps its promise.

    Without runtime assurance, and without bounds, everything is as believed.

    Raises:
      InputError: see `AssuranceBounds` and `load_dispersions`; or dispersions that the bounds name
        have a value without an end.
    """
    if scenario.assurance is None:
        return AssuranceBounds()
    dispersions = [] if scenario.dispersions is None else _loaded(scenario.dispersions)
    return in_si(_bounds(scenario.assurance, scenario, body, dispersions))


def _with_bounds(
    scenario: Scenario, body: Body, dispersions: typing.Sequence[Dispersion]
) -> Scenario:
    """Gives a scenario in which the bounds of runtime assurance are values.

    It warns of what scenario and dispersions declare beyond them.
    """
    assurance = scenario.assurance
    if assurance is None:
        return scenario
    bounds = _bounds(assurance, scenario, body, dispersions)
    if assurance.bounds is not None and not scenario.dispersed:  # It was not drawn before.
        _warn_of_exceeded(bounds, dispersions, scenario, body)
    if assurance.bounds is bounds:
        return scenario
    return dc.replace(scenario, assurance=dc.replace(assurance, bounds=bounds))


def _bounds(
    assurance: AssuranceConfig,
    scenario: Scenario,
    body: Body,
    dispersions: typing.Sequence[Dispersion],
) -> AssuranceBoundsConfig:
    """Gives the bounds of runtime assurance: given, named, or what the scenario declares."""
    if assurance.bounds is None:
        return _declared(dispersions, scenario, body)
    if isinstance(assurance.bounds, str):
        return _named_bounds(assurance.bounds, scenario, body)
    return assurance.bounds


def _named_bounds(name: str, scenario: Scenario, body: Body) -> AssuranceBoundsConfig:
    """Reads bounds: their values in a YAML file, or dispersions."""
    path = Path(name)
    if name.endswith((".yaml", ".yml")):
        tree = read_mapping(path)
        if not any("." in str(key) for key in tree):
            bounds = load_typed(AssuranceBoundsConfig, tree, name)
            check_limits(bounds, name)
            return bounds
    try:
        return _ends(_loaded(name), name, {}, scenario, body)
    except InputError as error:
        raise InputError(f"assurance.bounds: {error}") from error


def _warn_of_exceeded(
    bounds: AssuranceBoundsConfig,
    dispersions: typing.Sequence[Dispersion],
    scenario: Scenario,
    body: Body,
) -> None:
    try:
        beyond = exceeded(_declared(dispersions, scenario, body), bounds)
    except InputError as error:
        beyond = [str(error)]
    if beyond:
        sources = [scenario.dispersions, "the scenario" if own_values(scenario, ()) else None]
        warnings.warn(
            f"{' and '.join(filter(None, sources))} may exceed assurance.bounds, so runtime "
            f"assurance does not promise to keep out: {'; '.join(beyond)}",
            stacklevel=2,
        )


def _declared(
    dispersions: typing.Sequence[Dispersion], scenario: Scenario, body: Body
) -> AssuranceBoundsConfig:
    """Gives the bounds that all worlds keep which a scenario and its dispersions declare."""
    own = own_values(scenario, [each.key for each in dispersions])
    return _ends(dispersions, scenario.dispersions or "", own, scenario, body)


def _ends(
    dispersions: typing.Sequence[Dispersion],
    name: str,
    own: typing.Mapping[str, typing.Any],
    scenario: Scenario,
    body: Body,
) -> AssuranceBoundsConfig:
    """Gives the bounds that all worlds keep of dispersions of a name, and of a scenario's own."""
    by_key = {each.key: each for each in dispersions}

    def reach(key: str, about: float) -> float | None:
        if key in by_key:
            ends = by_key[key].distribution.bounds()
            if ends is None:
                raise InputError(f"{name}: {key} has no end that assurance.bounds could hold")
            unit = by_key[key].unit(scenario, body)
            return max(abs(unit * end - about) for end in ends)
        if key in own:
            value = own[key]
            values = value if isinstance(value, list) else [value]
            return max(abs(each - about) for each in values)
        return None

    return bounds_of_dispersions(reach, [*by_key, *own], scenario, body)


def dispersed_values(scenario: Scenario) -> dict[str, typing.Any]:
    """Gives the values that were drawn for a scenario, by their keys."""
    return {key: value_at(scenario, key) for key in scenario.dispersed}


def check_dispersions(
    dispersions: typing.Sequence[Dispersion], scenario: Scenario, body: Body
) -> None:
    """Checks that no value can be drawn that is beyond its limits.

    Raises:
      InputError: one can; the message gives the key, the bound and the limit.
    """
    for each in dispersions:
        if each.times == "value" and not (is_number(now := value_at(scenario, each.key)) and now):
            raise InputError(
                f"{scenario.dispersions}: {each.key} has times: value, but its value is {now!r}: "
                "give the values themselves"
            )
        bounds, limits = each.distribution.bounds(), each.limits
        if bounds is None or limits is None:
            continue
        unit = each.unit(scenario, body)
        for bound, beyond in (
            (unit * bounds[0], unit * bounds[0] < limits[0]),
            (unit * bounds[1], unit * bounds[1] > limits[1]),
        ):
            if beyond:
                raise InputError(
                    f"{scenario.dispersions}: {each.key} may be drawn as {bound:g}, but it must be "
                    f"from {limits[0]:g} to {limits[1]:g}"
                )


def _spread(
    dispersions: typing.Sequence[Dispersion], scenario: Scenario, body: Body
) -> Callable[[str, float], float | None]:
    """Gives a function of key and number: the rms of what the value differs by from the number."""
    by_key = {each.key: each for each in dispersions}

    def spread(key: str, about: float) -> float | None:
        if key not in by_key:
            return None
        unit = by_key[key].unit(scenario, body)
        found = by_key[key].distribution.rms(about / unit)
        return None if found is None else unit * found

    return spread


def _uniform(seed: int, index: int, key: str, component: int) -> float:
    """A number from 0 to 1 that depends on the arguments alone."""
    name = int.from_bytes(hashlib.sha256(key.encode()).digest()[:4])
    return float(generator(derived_seed(seed, name), index, component).random())


def _parse(key: str, entry: typing.Any) -> Dispersion:
    if not isinstance(entry, dict):
        entry = {"fixed": entry}
    parameters = {name: value for name, value in entry.items() if name not in ("times", "source")}
    distribution = parse_distribution(parameters)
    _check_values(key, distribution)
    times = entry.get("times")
    if times not in (None, *_TIMES):
        raise InputError(f"has times: {times}, which must be one of {', '.join(_TIMES)}")
    if times == "value" and Dispersion(key, distribution).size is not None:
        raise InputError("is a list, which cannot be dispersed as a multiple of its value")
    return Dispersion(key, distribution, times, str(entry.get("source", "")))


def _check_values(key: str, distribution: Distribution) -> None:
    """Raises `InputError` if a value may be drawn that the scenario's key does not take."""
    kind = field_at(key).type
    # Of a list, each number is drawn by itself.
    options = typing.get_args(kind) or (kind,)
    if isinstance(distribution, Fixed):
        values = [distribution.same]
    elif isinstance(distribution, Choice):
        values = distribution.values
    else:
        values = [distribution.value(0.5)]
        options = [float if option is int else option for option in options]  # It is rounded.
    for value in values:
        if not any(fits(value, option) for option in options):
            wanted = " or ".join(map(in_words, options))
            each = " for each number of the list" if typing.get_origin(kind) is list else ""
            raise InputError(f"needs {wanted}{each}, got {value!r}")
