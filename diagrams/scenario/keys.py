"""Dotted keys of a scenario, such as `truth.lidar.dropout`: the fields, values and paths they name.

Changes of single values are texts such as `mpc.intervals=10`, or a mapping of such keys to values.
"""

from __future__ import annotations

import dataclasses as dc
import difflib
import functools
import math
import typing
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np

from proxops.diagrams.scenario.quantities import KNOWN_ON_THE_DAY, QUANTITY
from proxops.diagrams.scenario.scenario_config import Scenario
from proxops.diagrams.yaml_files import (
    TAG,
    is_number,
    is_yaml_path,
    leaves,
    read_yaml,
    sections_of,
)
from proxops.systems.common import InputError

Overrides = typing.Sequence[str] | typing.Mapping[str, typing.Any]
"""Texts `key.subkey=value`, whose values are YAML, or a mapping of such keys to values."""

# The value of each key is a path, or null.
_PATHS = ("lidar.bundle", "policy.bundle", "truth.mesh", "navigation.map", "sunlight.kernels")
# The value of each key is the path of a YAML file, or a name that is none.
_NAMES_OR_PATHS = ("body", "dispersions", "assurance.bounds", "spacecraft.model")


# --- fields and values ----------------------------------------------------------------------------


@functools.cache
def dotted_fields() -> dict[str, dc.Field]:
    """Gives the fields of all values of a scenario by their dotted keys; a section is none."""
    return dict(leaves(Scenario))


def default_at(key: str) -> typing.Any:
    """Gives the default of a dotted key."""
    field = dotted_fields()[key]
    return field.default if field.default_factory is dc.MISSING else field.default_factory()


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
            [field] = (each for each in dc.fields(section) if each.name == name)
            [made] = sections_of(field.type).values()
            setattr(section, name, made())
        section = getattr(section, name)
    if dotted_fields()[key].type is int and is_number(value):
        value = math.floor(value + 0.5)
    setattr(section, last, value)


def why_not_dispersed(key: typing.Any) -> str | None:
    """Says why no value of this key can be dispersed; None: it can be."""
    if key in QUANTITY:
        return None
    if key not in dotted_fields():
        near = difflib.get_close_matches(str(key), QUANTITY, n=1, cutoff=0.0)[0]
        return f"there is no key {key!r} in a scenario; the nearest is {near}"
    return (
        f"{key} cannot be dispersed, because it is no uncertain quantity of the world; "
        "disperse keys of truth, disturbance, force_noise and kicks, or what is known on "
        f"the day: {', '.join(KNOWN_ON_THE_DAY)}"
    )


def differing_values(scenario: Scenario) -> dict[str, typing.Any]:
    """Gives the values by which the world of a flight differs, by their keys as in the scenario.

    They are what was drawn from dispersions, and every value of `truth` that is not the default,
    but for values that mean nothing as the scenario is, such as the correlation of a surface
    without roughness.
    """

    def differs(key: str) -> bool:
        return value_at(scenario, key) != default_at(key)

    drawn = {*scenario.dispersed}
    return {
        key: value_at(scenario, key)
        for key in dotted_fields()
        if key in drawn
        or (key.startswith("truth.") and differs(key) and differs(QUANTITY[key].needs or key))
    }


# --- changes --------------------------------------------------------------------------------------


def overrides_of(overrides: Overrides) -> typing.Mapping[str, typing.Any]:
    """Gives overrides as a mapping of dotted keys to values.

    Raises:
      InputError: a text has another form, or its value is not YAML.
    """
    if isinstance(overrides, typing.Mapping):
        return overrides
    return dict(map(_split, [overrides] if isinstance(overrides, str) else overrides))


def _split(text: str) -> tuple[str, typing.Any]:
    key, equals, value = text.partition("=")
    if not equals or not key.strip():
        raise InputError(f"override {text!r} is not of the form key.subkey=value")
    return key.strip(), read_yaml(f"value: {value}", f"override {text!r}: the value")["value"]


def given_keys(overrides: Overrides) -> list[str]:
    """Lists the dotted keys of the values that overrides give, those in nested mappings too.

    Raises:
      InputError: see `overrides_of`.
    """
    return [key for key, _ in dotted_leaves(overrides_of(overrides))]


def dotted_leaves(
    tree: typing.Mapping[str, typing.Any], prefix: str = ""
) -> Iterator[tuple[str, typing.Any]]:
    """Yields the dotted keys of all values of nested mappings, with the values."""
    for key, value in tree.items():
        if isinstance(value, dict) and value:
            yield from dotted_leaves(value, f"{prefix}{key}.")
        else:
            yield prefix + key, value


def apply_overrides(tree: dict[str, typing.Any], values: typing.Mapping[str, typing.Any]) -> None:
    """Sets the values of dotted keys in nested dicts, in place."""
    for key, value in values.items():
        *parents, last = key.split(".")
        inner = tree
        for name in parents:
            if not isinstance(section := inner.get(name), dict):
                inner[name] = {TAG: f"!{section}"} if isinstance(section, str) else {}
            inner = inner[name]
        inner[last] = value.tolist() if isinstance(value, np.ndarray | np.generic) else value


# --- paths ----------------------------------------------------------------------------------------


def make_paths_absolute(
    tree: dict[str, typing.Any], folder: Path, changed: Iterable[str] | None = None
) -> None:
    """Makes the relative paths among the values of a scenario absolute, in place.

    What is no path is left as it is, for the checks to complain about: a value that is no text, an
    empty text, or one that no file can be called.

    Args:
      tree: keys and values of a scenario in nested dicts.
      folder: the paths are relative to it; a relative one is relative to the working directory.
      changed: dotted keys of values and sections; only paths at or in them are made absolute.
        None: all are.
    """
    for key in (*_PATHS, *_NAMES_OR_PATHS):
        if changed is not None and not any(f"{key}.".startswith(f"{part}.") for part in changed):
            continue
        *parents, last = key.split(".")
        section: typing.Any = tree
        for name in parents:
            section = section.get(name) if isinstance(section, dict) else None
        if isinstance(section, dict) and is_path(section.get(last), named=key in _NAMES_OR_PATHS):
            section[last] = str((folder / section[last]).resolve())


def is_path(value: typing.Any, named: bool = False) -> typing.TypeGuard[str]:
    """Tells whether a value is a path; with `named`, a text may be a name as well."""
    if not isinstance(value, str) or not value or "\0" in value:
        return False
    return not named or is_yaml_path(value)


def names_and_paths(scenario: Scenario) -> Iterator[tuple[str, str]]:
    """Yields key and value of each path of a scenario, and of each name that could be one."""
    for key in (*_PATHS, *_NAMES_OR_PATHS):
        value: typing.Any = scenario
        for name in key.split("."):
            value = getattr(value, name, None)
        if isinstance(value, str):
            yield key, value
