"""Dispersions: how values of a scenario are distributed, read from YAML."""

from __future__ import annotations

import dataclasses as dc
import functools
import typing
from collections.abc import Sequence
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
    dotted_fields,
    is_path,
    value_at,
    why_not_dispersed,
)
from proxops.diagrams.scenario.quantities import QUANTITY
from proxops.diagrams.scenario.scenario_config import Scenario
from proxops.diagrams.yaml_files import (
    file_of,
    fits,
    in_words,
    is_number,
    read_mapping,
)
from proxops.systems.common import InputError, last_change, limits_of

_SHIPPED = {path.stem: path for path in sorted((ASSETS / "dispersions").glob("*.yaml"))}
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
        return limits_of(dotted_fields()[self.key])

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
    each: Sequence[Dispersion] = ()
    name: str = ""
    """The name or the path of the dispersions, for messages."""

    @classmethod
    def of(cls, scenario: Scenario, body: Body, name: str | None = None) -> typing.Self:
        """Reads the dispersions of a name, or those of the scenario, which may have none.

        Raises:
          InputError: see `load_dispersions`.
        """
        name = name or scenario.dispersions
        if name is None:
            return cls(scenario, body)
        return cls(scenario, body, load_dispersions(name), name)

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


def load_dispersions(name_or_path: str | Path) -> Sequence[Dispersion]:
    """Reads dispersions: a name that ships with proxops, or the path of a YAML file.

    Each key of the file is a dotted key of the scenario. Its value is a distribution, such as
    `{normal: 1.0, three_sigma: 0.1}`, or a plain value, which every flight has. The key `based_on`
    names dispersions that ship: what the file does not say itself is as they say.

    Raises:
      InputError: there are no such dispersions; a key is unknown, or not of the world; or a
        distribution is wrong. The message names the file and the key.
    """
    return _loaded(name_or_path, last_change(Path(name_or_path)))


@functools.lru_cache(maxsize=4)
def _loaded(name_or_path: str | Path, _changed: int) -> Sequence[Dispersion]:
    """Read again only if the file has changed: each flight of a campaign asks for them."""
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
    return tuple(found)


def _in_folder(each: Dispersion, folder: Path) -> Dispersion:
    """Makes relative paths among values absolute."""
    assert isinstance(each.distribution, Choice)
    values = (
        str((folder / value).resolve()) if is_path(value) else value
        for value in each.distribution.values
    )
    return dc.replace(each, distribution=dc.replace(each.distribution, values=tuple(values)))


def dispersion_entries(name_or_path: str | Path) -> dict[str, typing.Any]:
    """Gives the entries of dispersions by key, with those of what they are based on.

    Raises:
      InputError: there are no such dispersions.
    """
    tree = read_mapping(file_of(name_or_path, _SHIPPED, "dispersions"))
    if BASE not in tree:
        return tree
    base = str(tree.pop(BASE))
    if base not in _SHIPPED:
        raise InputError(
            f"{name_or_path}: {BASE} must name dispersions that ship with proxops: "
            f"{', '.join(_SHIPPED)}"
        )
    return dispersion_entries(base) | tree


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
    kind = dotted_fields()[key].type
    options: Sequence[typing.Any] = typing.get_args(kind) or (kind,)  # Of a list, its numbers'.
    if isinstance(distribution, Choice):
        values = distribution.values
    else:
        values = [distribution.value(0.5)]
        options = [float if option is int else option for option in options]  # It is rounded.
    for value in values:
        if not any(fits(value, option) for option in options):
            wanted = " or ".join(map(in_words, options))
            of_list = typing.get_origin(kind) is list
            each = " for each number of the list" if of_list else ""
            raise InputError(f"needs {wanted}{each}, got {value!r}")
        if is_number(value):
            finite_number(value, "its value")
