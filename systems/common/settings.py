"""`config`: dataclasses that a YAML file fills, with a limit and a unit for each of their fields.

The dataclass of what a scenario configures stands beside the system that it configures.
"""

from __future__ import annotations

import dataclasses as dc
import math
import typing
from collections.abc import Sequence

from proxops.systems.common.errors import InputError

_KEY = "limits"
FAR, LONG = 1e9, 1e8
"""The greatest length (m) and the greatest time (s) that a scenario accepts."""
Config = typing.TypeVar("Config", bound=type)


@dc.dataclass(frozen=True)
class _Range:
    """The limits of a number."""

    at_least: float | None
    above: float | None
    at_most: float | None
    below: float | None
    unit: str

    @property
    def words(self) -> str:
        """What is permitted."""
        bounds = {
            "at least": self.at_least, "above": self.above,
            "at most": self.at_most, "below": self.below,
        }  # fmt: skip
        return ", ".join(f"{word} {bound:g}" for word, bound in bounds.items() if bound is not None)

    def complaint(self, value: float) -> str | None:
        """Says what is wrong with a value; None if nothing is."""
        low, finite = self.at_least, isinstance(value, int) or math.isfinite(value)
        if low is not None and low >= 0.0 and not (finite and (value > 0.0 or value == low)):
            return "must be positive" if low > 0.0 else "must not be negative"
        if not finite:
            return "must be finite"
        for bound, good, words in (
            (low, low is None or value >= low, "at least"),
            (self.above, self.above is None or value > self.above, "above"),
            (self.at_most, self.at_most is None or value <= self.at_most, "at most"),
            (self.below, self.below is None or value < self.below, "below"),
        ):
            if not good:
                return f"must be {words} {bound:g}{self.unit and ' '}{self.unit}"
        return None


@dc.dataclass(frozen=True)
class _Vector:
    """The size of a list, and the limits of each of its numbers."""

    size: int
    each: _Range

    @property
    def words(self) -> str:
        """What is permitted."""
        return f"{self.size} numbers, each {self.each.words}"

    @property
    def unit(self) -> str:
        """That of each number."""
        return self.each.unit

    def complaint(self, value: Sequence[float]) -> str | None:
        """Says what is wrong with a value; None if nothing is."""
        if len(value) != self.size:
            return f"must be {self.size} numbers"
        found = (self.each.complaint(number) for number in value)
        return next((f"{text}, each of its numbers" for text in found if text), None)


@dc.dataclass(frozen=True)
class _Choice:
    """The permitted values of a text."""

    options: tuple[str, ...]

    def complaint(self, value: str) -> str | None:
        """Says what is wrong with a value; None if nothing is."""
        return None if value in self.options else f"must be {' or '.join(self.options)}"


@typing.dataclass_transform()
def config(cls: Config) -> Config:
    """Makes a class the dataclass of a section of a scenario; used as `@config`.

    Its annotations are resolved, because pydrake reads no postponed ones. Nor does it take frozen
    dataclasses, tuples, enums or literals.
    """
    made = dc.dataclass(slots=True)(cls)
    types = typing.get_type_hints(made)
    for field in dc.fields(made):
        field.type = types[field.name]
    return typing.cast(Config, made)


def number(
    default: float | None,
    *,
    at_least: float | None = None,
    above: float | None = None,
    at_most: float | None = None,
    below: float | None = None,
    unit: str = "",
) -> typing.Any:
    """Makes a dataclass field that holds a finite number within limits.

    Args:
      default: the default of the field.
      at_least: least permitted value; None: no such limit, as for the others.
      above: the value must be greater than this.
      at_most: greatest permitted value.
      below: the value must be less than this.
      unit: the unit that the error message gives.
    """
    limits = _Range(at_least, above, at_most, below, unit)
    return dc.field(default=default, metadata={_KEY: limits})


def vector(
    default: Sequence[float], *, at_least: float, at_most: float, unit: str = ""
) -> typing.Any:
    """Makes a dataclass field that holds as many finite numbers as its default, within limits.

    Args:
      default: the default of the field.
      at_least: least permitted value of each number.
      at_most: greatest permitted value of each number.
      unit: the unit that the error message gives.
    """
    limits = _Vector(len(default), _Range(at_least, None, at_most, None, unit))
    return dc.field(default_factory=lambda: list(default), metadata={_KEY: limits})


def one_of(default: str, options: Sequence[str]) -> typing.Any:
    """Makes a dataclass field that holds one of the texts `options`."""
    return dc.field(default=default, metadata={_KEY: _Choice(tuple(options))})


def limits_of(field: dc.Field) -> tuple[float, float] | None:
    """Gives the least and the greatest number that a field may hold; None if it has no limits.

    For a list, the limits are those of each of its numbers.
    """
    limits = field.metadata.get(_KEY)
    limits = limits.each if isinstance(limits, _Vector) else limits
    if not isinstance(limits, _Range):
        return None
    low, high = limits.at_least, limits.at_most
    if low is None:
        low = -math.inf if limits.above is None else math.nextafter(limits.above, math.inf)
    if high is None:
        high = math.inf if limits.below is None else math.nextafter(limits.below, -math.inf)
    return low, high


def limits_in_words(field: dc.Field) -> str:
    """Says what numbers a field may hold; "" if it has no limits."""
    return getattr(field.metadata.get(_KEY), "words", "")


def unit_of(field: dc.Field) -> str:
    """Gives the unit of a field; "" if it has none."""
    return getattr(field.metadata.get(_KEY), "unit", "")


def choices_of(field: dc.Field) -> tuple[str, ...]:
    """Gives the texts of which a field holds one; () if it may hold others."""
    return getattr(field.metadata.get(_KEY), "options", ())


def values_in_words(config: typing.Any) -> str:
    """Names all numbers of a dataclass that are not 0, in its units: "thrust 0.05, surface 500 m".

    "" if all are 0.
    """
    found = []
    for field in dc.fields(config):
        unit = field.metadata[_KEY].unit
        suffix = "deg" if unit == "degrees" else unit.replace("/", "_").replace("^", "")
        name = field.name.removesuffix(f"_{suffix}").replace("_", " ")
        value = getattr(config, field.name)
        found += [f"{name} {value:.3g}{unit and ' '}{unit}"] if value else []
    return ", ".join(found)


def check_limits(config: typing.Any, source: str, key: str = "") -> None:
    """Checks all fields of a dataclass, nested dataclasses included, against their limits.

    Args:
      config: the dataclass.
      source: the origin of the values, such as a file name; the message begins with it.
      key: the dotted key of the dataclass in the source.

    Raises:
      InputError: a value is beyond its limits; the message names its key.
    """
    for field in dc.fields(config):
        value = getattr(config, field.name)
        path = f"{key}.{field.name}" if key else field.name
        if dc.is_dataclass(value):
            check_limits(value, source, path)
            continue
        limits = field.metadata.get(_KEY)
        complaint = None if limits is None or value is None else limits.complaint(value)
        if complaint is not None:
            raise InputError(f"{source}: {path} {complaint}, got {value!r}")
