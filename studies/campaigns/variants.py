"""Variants of a controller or of the scenario, flown on the same transits."""

from __future__ import annotations

import dataclasses as dc
import typing
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path

from proxops.diagrams.flight import (
    Flight,
    Row,
    Workers,
    controller_label,
    provenance,
    run_campaign,
    run_groups,
    transit_flights,
)
from proxops.diagrams.logs import FlightLog
from proxops.diagrams.scenario import (
    Body,
    Scenario,
    change_scenario,
    load_body,
    load_scenario,
)
from proxops.studies.campaigns.describing import describe_flight
from proxops.studies.figures import Results, aggregate_all
from proxops.systems.common import InputError, check_type

World = Callable[[Scenario, Body], Scenario]
"""Gives the scenario of a flight in its world, from the scenario with the flight's transit."""
Logs = Mapping[str, Mapping[int, FlightLog]]
"""Logs of flights, by the variant's name and the transit's number."""


@dc.dataclass(frozen=True)
class Variant:
    """A controller, and its changes to the scenario that all variants share."""

    name: str
    """Unique among the variants that are flown together."""
    controller: str
    """A name that `named_controller` takes."""
    changes: Mapping[str, typing.Any] = dc.field(default_factory=dict)
    """Keys and values of the scenario that `change_scenario` changes."""
    world: World | None = None
    """Gives the world of each flight; None: that of the scenario."""

    def applied_to(self, scenario: Scenario) -> Scenario:
        """The scenario that this variant flies, made from the one that all share."""
        return change_scenario(scenario, self.changes) if self.changes else scenario


def fly_variants(
    variants: Sequence[Variant],
    scenario: Scenario,
    seed: int,
    count: int,
    folder: Path,
    **options: typing.Any,
) -> dict[str, list[Row]]:
    """Flies transits 0 … count - 1 of a seed with each variant.

    All flights are one campaign. A flight that is already in the folder is not flown again.

    Args:
      options: those of `run_campaign`.

    Returns:
      The rows of each variant in the order of the transits, by the variant's name.

    Raises:
      InputError: two variants have names that are one in file names; or see `run_campaign`.
    """
    _check_names(variants)
    flights = {each.name: variant_flights(each, scenario, seed, range(count)) for each in variants}
    return run_groups(flights, folder, **options)


def evaluate(
    controllers: Sequence[str],
    scenario: Scenario | None = None,
    *,
    transits: int = 50,
    seed: int = 10_000,
    folder: Path,
    workers: Workers = Workers(),
) -> Results:
    """Flies the same transits with several controllers, and gives the figures of each.

    This is what `proxops evaluate` does, without its report.

    Args:
      controllers: names that `named_controller` takes.
      scenario: None: the default one.
      transits: the number of transits. seed: of the set of transits.
      folder: keeps the flights, so that no flight is flown twice.
      workers: fly.

    Raises:
      InputError: `scenario` is none; or see `fly_variants`.
    """
    scenario = load_scenario() if scenario is None else scenario
    check_type("evaluate", Scenario, scenario=scenario)
    rows = fly_variants(
        [Variant(name, name) for name in controllers], scenario, seed, transits, folder,
        describe=describe_flight, workers=workers,
    )  # fmt: skip
    return aggregate_all(rows)


def fly_logs(
    variants: Sequence[Variant],
    scenario: Scenario,
    seed: int,
    transits: Mapping[str, Sequence[int]],
    folder: Path,
    **options: typing.Any,
) -> dict[str, dict[int, FlightLog]]:
    """Flies some transits with their logs kept, and returns the logs.

    Flights repeat bit for bit, so the logs of a large campaign need not be kept.

    Args:
      transits: numbers of the transits by the variant's name; a variant that is not named here is
        not flown.
      folder: should be another one than that of flights whose logs are not kept.
      options: those of `run_campaign`.

    Raises:
      InputError: as `fly_variants`.
    """
    _check_names(variants)
    flights = [
        flight
        for each in variants
        for flight in variant_flights(each, scenario, seed, transits.get(each.name, ()))
    ]
    run_campaign(flights, folder, keep_logs=True, **options)
    return load_logs(folder, seed, transits)


def load_logs(
    folder: Path, seed: int, transits: Mapping[str, Sequence[int]]
) -> dict[str, dict[int, FlightLog]]:
    """The logs that `fly_logs` wrote into a folder."""
    return {
        name: {k: FlightLog.load(folder / f"{_flight_name(name, seed, k)}.nc") for k in numbers}
        for name, numbers in transits.items()
    }


def variant_flights(
    variant: Variant, scenario: Scenario, seed: int, transits: Iterable[int]
) -> list[Flight]:
    """The flights of one variant on some transits of a seed."""
    numbers = list(transits)
    changed = variant.applied_to(scenario)
    drawn = transit_flights(changed, variant.controller, seed, max(numbers, default=-1) + 1)
    flights = [
        dc.replace(drawn[number], name=_flight_name(variant.name, seed, number))
        for number in numbers
    ]
    if variant.world is None:
        return flights
    body = load_body(changed.body)
    return [_in_world(flight, variant.world, body) for flight in flights]


def _check_names(variants: Sequence[Variant]) -> None:
    names = [controller_label(each.name) for each in variants]
    if twice := {name for name in names if names.count(name) > 1}:
        raise InputError(f"two variants would write the same files: {', '.join(sorted(twice))}")


def _in_world(flight: Flight, world: World, body: Body) -> Flight:
    """The flight in another world."""
    scenario = world(flight.scenario, body)
    origin = flight.provenance
    if scenario.truth.mesh is not None:
        origin = provenance(scenario, body, flight.controller)
    return dc.replace(flight, scenario=scenario, provenance=origin)


def _flight_name(name: str, seed: int, number: int) -> str:
    return f"{controller_label(name)}-{seed}-{number:05d}"
