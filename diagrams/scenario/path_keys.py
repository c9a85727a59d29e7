"""The keys of a scenario that are paths, and how they become absolute."""

from __future__ import annotations

import typing
from collections.abc import Iterable, Iterator
from pathlib import Path

from proxops.diagrams.scenario.scenario_config import Scenario
from proxops.diagrams.scenario.typed_yaml import is_yaml_path

# The value of each key is a path, or null.
_PATHS = ("lidar.bundle", "policy.bundle", "truth.mesh", "navigation.map")
# The value of each key is the path of a YAML file, or a name that is none.
_NAMES_OR_PATHS = ("body", "dispersions", "assurance.bounds")


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
        section = tree
        for name in parents:
            section = section.get(name)
            if not isinstance(section, dict):
                break
        else:
            if is_path(section.get(last), named=key in _NAMES_OR_PATHS):
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
