"""Dispersions: how values of a scenario are distributed, read from YAML."""

from __future__ import annotations

import dataclasses as dc
import functools
import typing
from collections.abc import Callable
from pathlib import Path

from proxops.assets import ASSETS
from proxops.diagrams.scenario.body import Body
from proxops.diagrams.scenario.distributions import (
    Choice,
    Distribution,
    Fixed,
    finite_number,
    parse_distribution,
)
from proxops.diagrams.scenario.keys import (
    default_at,
    field_at,
    is_path,
    value_at,
    why_not_dispersed,
)
from proxops.diagrams.scenario.quantities import QUANTITY
from proxops.diagrams.scenario.scenario_config import Scenario
from proxops.diagrams.scenario.typed_yaml import (
    fits,
    in_words,
    is_number,
    is_yaml_path,
    read_mapping,
)
from proxops.systems.common import InputError, limits_of

_FOLDER = ASSETS / "dispersions"
BASE = "based_on"
"""The key of a file that names the dispersions that it changes."""
# The key whose values are paths, relative to the file.
_MESH = "truth.mesh"
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
        """Gives what the drawn number is multiplied by.

        Raises:
          InputError: it is the scenario's own value, which is not a number other than zero.
        """
        if self.times == "size":
            return float(body.shape.extents.max())
        if self.times == "thrust":
            return scenario.spacecraft.thrust_limit_n
        if self.times == "thrust_acceleration":
            return scenario.spacecraft.thrust_limit_n / scenario.spacecraft.mass_kg
        if self.times != "value":
            return 1.0
        now = value_at(scenario, self.key)
        if not (is_number(now) and now):
            raise InputError(
                f"{self.key} has times: value, but its value is {now!r}: give the values themselves"
            )
        return float(now)


@dc.dataclass(frozen=True)
class Dispersions:
    """Dispersions of the worlds of a scenario at a body: how far values may be from belief."""

    scenario: Scenario
    """Before the draw."""
    body: Body
    """As believed."""
    each: typing.Sequence[Dispersion] = ()
    name: str = ""
    """The name or the path of the dispersions, for messages."""

    @classmethod
    def of(cls, scenario: Scenario, body: Body, name: str | None = None) -> typing.Self:
        """Reads the dispersions of a name, or those of the scenario, which may have none.

        Raises:
          InputError: see `load_dispersions`.
        """
        name = name or scenario.dispersions
        return (
            cls(scenario, body)
            if name is None
            else cls(scenario, body, loaded_dispersions(name), name)
        )

    @property
    def keys(self) -> list[str]:
        """The dispersed keys."""
        return [each.key for each in self.each]

    def _find(self, key: str) -> Dispersion | None:
        return next((each for each in self.each if each.key == key), None)

    def rms(self, key: str) -> float | None:
        """Gives the root mean square of a value's error, which does not depend on a draw.

        Errors are counted from `Quantity.about`. None: the value is not dispersed, or no number.
        """
        found = self._find(key)
        if found is None:
            return None
        unit = found.unit(self.scenario, self.body)
        rms = found.distribution.rms(QUANTITY[key].about / unit)
        return None if rms is None else abs(unit) * rms

    def ends(self, key: str) -> tuple[float, float] | None:
        """Gives the least and the greatest value of a key, or of any number of its list.

        None: the value is not dispersed.

        Raises:
          InputError: it has no end.
        """
        found = self._find(key)
        if found is None:
            return None
        ends = found.distribution.bounds()
        if ends is None:
            raise InputError(f"{self.name}: {key} has no end that assurance.bounds could hold")
        unit = found.unit(self.scenario, self.body)
        return unit * ends[0], unit * ends[1]

    def greatest_error(self, key: str) -> float:
        """Gives the greatest error of a value, counted from `Quantity.about`; 0: not dispersed.

        Raises:
          InputError: it has no end.
        """
        ends, about = self.ends(key), QUANTITY[key].about
        return 0.0 if ends is None else max(abs(each - about) for each in ends)

    def values_of(self, key: str) -> list[typing.Any]:
        """Gives the values of a key that are given one by one; none if it is not dispersed so."""
        found = self._find(key)
        if found is None:
            return []
        return [*getattr(found.distribution, "values", ())]

    def check(self) -> None:
        """Checks that no value can be drawn that is beyond its limits.

        Raises:
          InputError: one can; the message gives the key, the bound and the limit.
        """
        for each in self.each:
            try:
                unit = each.unit(self.scenario, self.body)
            except InputError as error:
                raise InputError(f"{self.name}: {error}") from error
            bounds, limits = each.distribution.bounds(), each.limits
            if bounds is None or limits is None:
                continue
            low, high = sorted(unit * bound for bound in bounds)
            for bound, beyond in ((low, low < limits[0]), (high, high > limits[1])):
                if beyond:
                    raise InputError(
                        f"{self.name}: {each.key} may be drawn as {bound:g}, but it must be "
                        f"from {limits[0]:g} to {limits[1]:g}"
                    )


def load_dispersions(name_or_path: str | Path) -> list[Dispersion]:
    """Reads dispersions: a name that ships with proxops, or the path of a YAML file.

    Each key of the file is a dotted key of the scenario. Its value is a distribution, such as
    `{normal: 1.0, three_sigma: 0.1}`, or a plain value, which every flight has. The key `based_on`
    names dispersions that ship: what the file does not say itself is as they say.

    Raises:
      InputError: there are no such dispersions; a key is unknown, or not of the world; or a
        distribution is wrong. The message names the file and the key.
    """
    found = []
    for key, entry in dispersion_entries(name_or_path).items():
        complaint = why_not_dispersed(key)
        if complaint is not None:
            raise InputError(f"{name_or_path}: {complaint}")
        try:
            each = _parse(key, entry)
        except InputError as error:
            raise InputError(f"{name_or_path}: {key} {error}") from error
        found.append(_in_folder(each, Path(name_or_path).parent) if key == _MESH else each)
    return found


def _in_folder(each: Dispersion, folder: Path) -> Dispersion:
    """Makes relative paths among values absolute."""

    def read(value: typing.Any) -> typing.Any:
        return str((folder / value).resolve()) if is_path(value) else value

    return dc.replace(each, distribution=_with_each(each.distribution, read))


def dispersion_entries(name_or_path: str | Path) -> dict[str, typing.Any]:
    """Gives the entries of dispersions by key, with those of what they are based on.

    Raises:
      InputError: there are no such dispersions.
    """
    path = Path(name_or_path)
    if not is_yaml_path(name_or_path):
        path = _FOLDER / f"{name_or_path}.yaml"
        if path not in _shipped():
            raise InputError(
                f"no dispersions {name_or_path!r} ship with proxops ({_known()} do); for your own, "
                "give the path of a .yaml file"
            )
    tree = dict(read_mapping(path))
    base = tree.pop(BASE, None)
    if base is None:
        return tree
    if _FOLDER / f"{base}.yaml" not in _shipped():
        raise InputError(
            f"{name_or_path}: {BASE} must name dispersions that ship with proxops: {_known()}"
        )
    return dispersion_entries(base) | tree


def _shipped() -> list[Path]:
    return sorted(_FOLDER.glob("*.yaml"))


def _known() -> str:
    return ", ".join(path.stem for path in _shipped())


def loaded_dispersions(name_or_path: str) -> list[Dispersion]:
    """Gives what `load_dispersions` gives; it is read again only if the file has changed."""
    path = Path(name_or_path)
    return _loaded_at(name_or_path, path.stat().st_mtime_ns if path.is_file() else 0)


@functools.lru_cache(maxsize=4)
def _loaded_at(name_or_path: str, changed: int) -> list[Dispersion]:
    return load_dispersions(name_or_path)


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


def _with_each(
    distribution: Distribution, read: Callable[[typing.Any], typing.Any]
) -> Distribution:
    """The distribution with each value that a file gives one by one read anew."""
    if isinstance(distribution, Choice):
        return dc.replace(distribution, values=tuple(map(read, distribution.values)))
    return distribution


def _types_of(key: str) -> tuple[typing.Any, ...]:
    """The types of which a key's value may be; of a list, those of its numbers."""
    kind = field_at(key).type
    # Of a list, each number is drawn by itself.
    return typing.get_args(kind) or (kind,)


def _check_values(key: str, distribution: Distribution) -> None:
    """Raises `InputError` if a value may be drawn that the scenario's key does not take."""
    options: typing.Sequence[typing.Any] = _types_of(key)
    if isinstance(distribution, Choice):
        values = distribution.values
    else:
        values = [distribution.value(0.5)]
        options = [float if option is int else option for option in options]  # It is rounded.
    for value in values:
        if not any(fits(value, option) for option in options):
            wanted = " or ".join(map(in_words, options))
            of_list = typing.get_origin(field_at(key).type) is list
            each = " for each number of the list" if of_list else ""
            raise InputError(f"needs {wanted}{each}, got {value!r}")
        if is_number(value):
            finite_number(value, "its value")
