"""Dotted keys of a scenario, such as `truth.lidar.dropout`, and the fields and values they name."""

from __future__ import annotations

import dataclasses as dc
import difflib
import functools
import math
import typing
from collections.abc import Iterator

from proxops.diagrams.scenario.quantities import KNOWN_ON_THE_DAY, QUANTITY
from proxops.diagrams.scenario.scenario_config import Scenario
from proxops.diagrams.scenario.typed_yaml import is_number


@functools.cache
def dotted_keys() -> tuple[str, ...]:
    """Gives the dotted keys of all values of a scenario; a section is none."""
    return tuple(_leaves(Scenario))


def _leaves(schema: type, prefix: str = "") -> Iterator[str]:
    """Yields the dotted keys of all values of a dataclass."""
    for field in dc.fields(schema):
        nested = _section(field)
        if nested is None:
            yield prefix + field.name
        else:
            yield from _leaves(nested, f"{prefix}{field.name}.")


def why_not_dispersed(key: typing.Any) -> str | None:
    """Says why no value of this key can be dispersed; None: it can be."""
    if key in QUANTITY:
        return None
    if key not in dotted_keys():
        near = difflib.get_close_matches(str(key), QUANTITY, n=1, cutoff=0.0)[0]
        return f"there is no key {key!r} in a scenario; the nearest is {near}"
    return (
        f"{key} cannot be dispersed, because it is a setting of what is on board, not of the "
        "world; disperse keys of truth, disturbance, force_noise and kicks, or what is known on "
        f"the day: {', '.join(KNOWN_ON_THE_DAY)}"
    )


def _section(field: dc.Field) -> type | None:
    """Gives the dataclass of a field that is a section; None for a value."""
    options = typing.get_args(field.type) or (field.type,)
    return next(
        (each for each in options if isinstance(each, type) and dc.is_dataclass(each)), None
    )


@functools.cache
def field_at(key: str) -> dc.Field:
    """Gives the field of a dotted key."""
    schema: typing.Any = Scenario
    *parents, last = key.split(".")
    for name in parents:
        schema = _section(_field_of(schema, name))
    return _field_of(schema, last)


def _field_of(schema: type, name: str) -> dc.Field:
    return next(each for each in dc.fields(schema) if each.name == name)


def default_at(key: str) -> typing.Any:
    """Gives the default of a dotted key."""
    field = field_at(key)
    if field.default_factory is not dc.MISSING:
        return field.default_factory()
    return field.default


def value_at(scenario: Scenario, key: str) -> typing.Any:
    """Gives the value of a dotted key; the default if the scenario does not have its section."""
    value: typing.Any = scenario
    for name in key.split("."):
        if value is None:
            return default_at(key)
        value = getattr(value, name)
    return value


def set_value(scenario: Scenario, key: str, value: typing.Any) -> None:
    """Sets a value in place; a section that the scenario does not have is made."""
    *parents, last = key.split(".")
    section: typing.Any = scenario
    for name in parents:
        if getattr(section, name) is None:
            field = _field_of(type(section), name)
            setattr(section, name, typing.cast(type, _section(field))())
        section = getattr(section, name)
    kind = field_at(key).type
    if kind is int and is_number(value):
        value = math.floor(value + 0.5)
    setattr(section, last, value)
