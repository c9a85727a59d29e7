"""Reads, writes and changes scenarios: typed YAML with all that defines a flight."""

import copy
import functools
import os
import typing
from pathlib import Path

from proxops.assets import ASSETS
from proxops.diagrams.scenario.dispersions import load_dispersions
from proxops.diagrams.scenario.keys import (
    Overrides,
    apply_overrides,
    given_keys,
    make_paths_absolute,
    overrides_of,
)
from proxops.diagrams.scenario.quantities import QUANTITY
from proxops.diagrams.scenario.scenario_checks import check_scenario
from proxops.diagrams.scenario.scenario_config import Scenario
from proxops.diagrams.yaml_files import (
    TAG,
    dump_typed,
    file_of,
    load_typed,
    parse_mapping,
    read_mapping,
    tree_of,
)
from proxops.systems.common import InputError

_SPEED = "speed_limit_m_s"


def shipped_scenarios() -> dict[str, Path]:
    """Gives the files of the scenarios that ship, by their names."""
    return {path.parent.name: path for path in sorted(ASSETS.glob("*/scenario.yaml"))}


def load_scenario(
    path: str | Path | None = None,
    overrides: Overrides = (),
    *,
    transit: int | None = None,
    on_true_state: bool = False,
    **values: typing.Any,
) -> Scenario:
    """Reads a scenario: the defaults, changed by a file, if any, and then by the overrides.

    For instance `load_scenario(transit=3, dispersions="after_survey")`, `load_scenario("bennu")`,
    or `load_scenario("visit.yaml", **{"spacecraft.mass_kg": 120})`.

    Args:
      path: YAML file with the values that differ from the defaults, or the name of a scenario that
        ships; None: no file. A path in it is relative to its folder.
      overrides: texts `key.subkey=value` with the value in YAML, or a mapping of such keys to
        values. A path among them is relative to the working directory.
      transit: number of the transit, `transit.index`.
      on_true_state: whether the default of `navigation` is `!TrueState`, as the paper flies and as
        training data need it.
      values: more overrides, by their keys.

    Raises:
      InputError: no such scenario ships, the file cannot be read or is not YAML, a key is unknown
        (the message gives the nearest valid one), a value has the wrong type or is beyond its
        limits, or an override gives a value that the scenario's dispersions draw for each flight.
    """
    if not isinstance(path, str | Path | None):
        raise InputError(
            f"load_scenario takes a file's path first, not a {type(path).__name__}; changes are "
            "keywords, such as load_scenario(transit=1), or its second argument"
        )
    overrides = {**overrides_of(overrides), **values}
    if transit is not None:
        overrides["transit.index"] = transit
    tree: dict[str, typing.Any] = {}
    if path is not None:
        file = _file_of(path)
        tree = read_mapping(file)
        if "mesh" in tree:
            raise InputError(f"{path} is a body's file: in a scenario, write body: {path}")
        make_paths_absolute(tree, file.parent)
    _change(tree, overrides)
    if on_true_state:
        tree.setdefault("navigation", {"_tag": "!TrueState"})
    return _made(tree, "scenario" if path is None else str(path), overrides)


def _file_of(name_or_path: str | Path) -> Path:
    """Gives the file of a scenario that ships under a name, or the path of any file that exists."""
    shipped = shipped_scenarios()
    # Unlike this, Path.exists raises if a name is too long.
    if str(name_or_path) not in shipped and os.path.exists(name_or_path):  # noqa: PTH110
        return Path(name_or_path)
    return file_of(name_or_path, shipped, "scenario")


def dump_scenario(scenario: Scenario) -> str:
    """Gives the whole scenario as YAML, from which `load_scenario` reads an equal scenario."""
    return dump_typed(scenario)


def dump_changes(scenario: Scenario) -> str:
    """Gives what differs from the defaults as YAML, for people; see `dump_scenario`."""
    return dump_typed(scenario, Scenario())


def parse_scenario(text: str, source: str = "scenario") -> Scenario:
    """Reads the scenario in a YAML text, such as logs, manifests and campaigns hold.

    Raises:
      InputError: the text is not a scenario; see `load_scenario`.
    """
    return copy.deepcopy(_parsed(text, source))


# Reading YAML takes 20 ms, and each flight's text is read several times.
@functools.lru_cache(maxsize=4)
def _parsed(text: str, source: str) -> Scenario:
    return _made(parse_mapping(text, source), source)


def change_scenario(scenario: Scenario, changes: Overrides) -> Scenario:
    """Gives a copy of a scenario in which some values are changed.

    Args:
      changes: dotted keys and their new values, such as `{"hybrid.gate": "paper"}`, or texts
        `key.subkey=value` with the value in YAML. A path among them is relative to the working
        directory.

    Raises:
      InputError: a key is unknown, a value has the wrong type or is beyond its limits, or the
        scenario's dispersions draw it for each flight.
    """
    tree = tree_of(scenario)
    _change(tree, changes)
    return _made(tree, "scenario", changes)


def _made(tree: typing.Mapping[str, typing.Any], source: str, changes: Overrides = ()) -> Scenario:
    """Makes and checks the scenario of nested dicts, to which changes have been made."""
    scenario = load_typed(Scenario, tree, source)
    check_scenario(scenario, source)
    _check_not_drawn(scenario, changes)
    return scenario


def _check_not_drawn(scenario: Scenario, changes: Overrides) -> None:
    """Raises `InputError` if a changed value would be replaced by one that dispersions draw."""
    given = QUANTITY.keys() & given_keys(changes)
    if scenario.dispersions is None or not given:
        return  # So the dispersions need not be there yet.
    for each in load_dispersions(scenario.dispersions):
        if each.key in given and each.times != "value":
            raise InputError(
                f"{each.key} is given, but dispersions {scenario.dispersions} draw it for each "
                "flight: leave out one of them, or fly dispersions of your own with your value"
            )


def _change(tree: dict[str, typing.Any], changes: Overrides) -> None:
    """Changes values in nested dicts, in place; what the caller gave is not changed."""
    given = dict(copy.deepcopy(overrides_of(changes)))
    before, craft = tree.get("spacecraft"), given.get("spacecraft")
    if isinstance(before, dict) and _SPEED in before:
        if isinstance(craft, str):  # A tag alone.
            craft = {TAG: f"!{craft}"}
        if isinstance(craft, dict):
            # The limit fits the body, not the spacecraft: another one keeps it.
            given["spacecraft"] = {_SPEED: before[_SPEED]} | craft
    apply_overrides(tree, given)
    make_paths_absolute(tree, Path(), given)
