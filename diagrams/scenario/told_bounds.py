"""What runtime assurance is told: the bounds within which it keeps its promise."""

from __future__ import annotations

import dataclasses as dc
import typing
import warnings
from pathlib import Path

from proxops.diagrams.scenario.body import Body
from proxops.diagrams.scenario.declared_bounds import (
    bounds_of_dispersions,
    exceeded,
    in_si,
    own_values,
)
from proxops.diagrams.scenario.dispersions import BASE, Dispersion, loaded_dispersions
from proxops.diagrams.scenario.scenario_config import Scenario
from proxops.diagrams.scenario.typed_yaml import is_yaml_path, load_typed, read_mapping
from proxops.systems.assurance import AssuranceBounds, AssuranceBoundsConfig, AssuranceConfig
from proxops.systems.common import InputError, check_limits


def assurance_bounds(scenario: Scenario, body: Body) -> AssuranceBounds:
    """Gives the errors within which a scenario's runtime assurance keeps its promise.

    Without runtime assurance, and without bounds, everything is as believed.

    Raises:
      InputError: see `AssuranceBounds` and `load_dispersions`; or dispersions that the bounds name
        have a value without an end.
    """
    if scenario.assurance is None:
        return AssuranceBounds()
    dispersions = [] if scenario.dispersions is None else loaded_dispersions(scenario.dispersions)
    return in_si(_bounds(scenario.assurance, scenario, body, dispersions))


def with_bounds(
    scenario: Scenario, body: Body, dispersions: typing.Sequence[Dispersion]
) -> Scenario:
    """Gives a scenario in which the bounds of runtime assurance are values.

    It warns of what scenario and dispersions declare beyond them.

    Raises:
      InputError: see `assurance_bounds`.
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
    if is_yaml_path(name):
        tree = read_mapping(path)
        if not any("." in key for key in tree) and BASE not in tree:
            bounds = load_typed(AssuranceBoundsConfig, tree, name)
            check_limits(bounds, name)
            return bounds
    try:
        return _ends(loaded_dispersions(name), name, {}, scenario, body)
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
    """Gives the bounds for the worlds that a scenario and its dispersions declare."""
    own = own_values(scenario, [each.key for each in dispersions])
    return _ends(dispersions, scenario.dispersions or "", own, scenario, body)


def _ends(
    dispersions: typing.Sequence[Dispersion],
    name: str,
    own: typing.Mapping[str, typing.Any],
    scenario: Scenario,
    body: Body,
) -> AssuranceBoundsConfig:
    """Gives the bounds for the worlds of dispersions of a name, and of a scenario's own."""
    by_key = {each.key: each for each in dispersions}

    def reach(key: str) -> tuple[float, float] | None:
        if key in by_key:
            ends = by_key[key].distribution.bounds()
            if ends is None:
                raise InputError(f"{name}: {key} has no end that assurance.bounds could hold")
            unit = by_key[key].unit(scenario, body)
            return unit * ends[0], unit * ends[1]
        if key in own:
            value = own[key]
            values = value if isinstance(value, list) else [value]
            return min(values), max(values)
        return None

    return bounds_of_dispersions(reach, [*by_key, *own], scenario, body)
