"""Reads, writes and changes scenarios: typed YAML with all that defines a flight."""

import copy
import dataclasses as dc
import functools
import typing
from pathlib import Path

from pydrake.common.yaml import yaml_dump_typed

from proxops.diagrams.scenario.navigation_config import LidarNavigationConfig
from proxops.diagrams.scenario.renamed_keys import refuse_renamed, translate_renamed
from proxops.diagrams.scenario.scenario_checks import check_scenario
from proxops.diagrams.scenario.scenario_config import LearnedLidarConfig, Scenario
from proxops.diagrams.scenario.truth_config import TruthConfig
from proxops.diagrams.scenario.typed_yaml import (
    apply_overrides,
    load_typed,
    parse_mapping,
    read_mapping,
)


def load_scenario(
    path: str | Path | None = None,
    overrides: typing.Sequence[str] | typing.Mapping[str, typing.Any] = (),
    *,
    on_true_state: bool = False,
) -> Scenario:
    """Reads a scenario: the defaults, changed by a file, if any, and then by the overrides.

    Args:
      path: YAML file with the values that differ from the defaults; None: no file.
      overrides: texts `key.subkey=value` with the value in YAML, or a mapping of such keys to
        values.
      on_true_state: whether the default of `navigation` is `!TrueState`, as the paper flies and as
        training data need it.

    Raises:
      InputError: the file cannot be read or is not YAML, a key is unknown (the message gives the
        nearest valid one), or a value has the wrong type or is beyond its limits.
    """
    source = "scenario" if path is None else str(path)
    tree = {} if path is None else read_mapping(Path(path))
    if path is not None:
        _from_file(tree, Path(path).parent)
    apply_overrides(tree, overrides)
    refuse_renamed(tree, source)
    if on_true_state:
        tree.setdefault("navigation", {"_tag": "!TrueState"})
    scenario = load_typed(Scenario, tree, source)
    check_scenario(scenario, source)
    if _is_path(scenario.body):
        scenario.body = str(Path(scenario.body).resolve())
    if isinstance(scenario.lidar, LearnedLidarConfig):
        scenario.lidar.bundle = str(Path(scenario.lidar.bundle).resolve())
    if scenario.policy.bundle is not None:
        scenario.policy.bundle = str(Path(scenario.policy.bundle).resolve())
    if scenario.truth.mesh is not None:
        scenario.truth.mesh = str(Path(scenario.truth.mesh).resolve())
    settings = scenario.navigation
    if isinstance(settings, LidarNavigationConfig) and settings.map is not None:
        settings.map = str(Path(settings.map).resolve())
    if _is_path(scenario.dispersions):
        scenario.dispersions = str(Path(scenario.dispersions or "").resolve())
    if scenario.assurance is not None and _is_path(scenario.assurance.bounds):
        scenario.assurance.bounds = str(Path(str(scenario.assurance.bounds)).resolve())
    return scenario


def dump_scenario(scenario: Scenario) -> str:
    """Gives the whole scenario as YAML, from which `load_scenario` reads an equal scenario."""
    text = yaml_dump_typed(scenario, schema=Scenario)
    assert text is not None  # pydrake returns None only if it writes to a file.
    return text


def parse_scenario(text: str, source: str = "scenario") -> Scenario:
    """Reads the scenario in a YAML text that this or an earlier version wrote.

    Logs, manifests and campaigns hold such texts. Keys by their old names are translated.

    Raises:
      InputError: the text is not a scenario; see `load_scenario`.
    """
    return copy.deepcopy(_parsed(text, source))


# Reading YAML takes 20 ms, and each flight's text is read several times.
@functools.lru_cache(maxsize=4)
def _parsed(text: str, source: str) -> Scenario:
    tree = parse_mapping(text, source)
    translate_renamed(tree)
    scenario = load_typed(Scenario, tree, source)
    check_scenario(scenario, source)
    return scenario


def change_scenario(
    scenario: Scenario, changes: typing.Sequence[str] | typing.Mapping[str, typing.Any]
) -> Scenario:
    """Gives a copy of a scenario in which some values are changed.

    Args:
      changes: dotted keys and their new values, such as `{"hybrid.gate": "paper"}`, or texts
        `key.subkey=value` with the value in YAML.

    Raises:
      InputError: a key is unknown, or a value has the wrong type or is beyond its limits.
    """
    tree = parse_mapping(dump_scenario(scenario), "scenario")
    apply_overrides(tree, changes)
    refuse_renamed(tree, "scenario")
    changed = load_typed(Scenario, tree, "scenario")
    check_scenario(changed, "scenario")
    return changed


def believed(scenario: Scenario) -> Scenario:
    """Gives the scenario as the controllers know it: the world is as they are told."""
    return dc.replace(scenario, truth=TruthConfig(), dispersions=None, dispersed=[])


def _from_file(tree: dict[str, typing.Any], folder: Path) -> None:
    """Makes the paths in a scenario file absolute, in place; they are relative to its folder."""
    for key in ("body", "dispersions"):
        if _is_path(tree.get(key)):
            tree[key] = str((folder / tree[key]).resolve())
    assurance = tree.get("assurance")
    if isinstance(assurance, dict) and _is_path(assurance.get("bounds")):
        assurance["bounds"] = str((folder / assurance["bounds"]).resolve())
    for section, key in (
        ("lidar", "bundle"), ("policy", "bundle"), ("truth", "mesh"), ("navigation", "map"),
    ):  # fmt: skip
        part = tree.get(section)
        if isinstance(part, dict) and isinstance(part.get(key), str) and "\0" not in part[key]:
            part[key] = str((folder / part[key]).resolve())


def _is_path(body: typing.Any) -> bool:
    return isinstance(body, str) and body.endswith((".yaml", ".yml")) and "\0" not in body
