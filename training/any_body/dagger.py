"""DAgger at a family: the guidance flies on navigation, and the expert labels where it came to.

See `proxops.training.pilot.dagger` for the method. The flights are on the navigation's state, those
of the first round in worlds that differ from what is believed. The labels are the expert's forces
at the true states.
"""

from __future__ import annotations

import dataclasses as dc
import json
from collections.abc import Sequence
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np

from proxops.diagrams.flight import Flight, Workers, provenance, run_campaign
from proxops.diagrams.scenario import Scenario, draw_world, load_body, of_transit
from proxops.systems.common import InputError
from proxops.training.any_body.recipe import Family, known_family, learn
from proxops.training.any_body.settings import AnyBodySettings
from proxops.training.data import (
    Labels,
    at_rest,
    hard_transits,
    joined_labels,
    labels_by_flight,
    round_logs,
    round_outcome,
)
from proxops.training.export import publish
from proxops.training.loop import Schedule

# Share of the whole work at which bodies and plans end that have to be made anew; mostly there are
# none.
_PLANNED = 0.02
# Shares of a round at which its flights and its labels end.
_FLOWN, _LABELLED = 0.4, 0.6


@dc.dataclass(frozen=True, kw_only=True)
class AnyBodyDagger:
    """Settings of a run of DAgger at a family."""

    rounds: int = 2
    flights: int = 3
    """Flights of each round at each member; the straight line is blocked in most of them."""
    labels: int = 100
    """So many states of each flight are labelled at most: more flights teach more than more of the
    states of one."""
    seed: int = 100
    """Seed of the transits of the first round; each further round uses the next seed."""
    epochs: int = 80
    """Epochs of each round's training: more than the first, because there is more to learn."""
    dispersions: str | None = "after_survey"
    """The worlds that the first round flies in; None: as believed. Later rounds fly as believed,
    which takes a third of the time."""


def run_any_body_dagger(
    guidance: Path, out: Path, settings: AnyBodyDagger, workers: Workers = Workers()
) -> dict[str, Any]:
    """Flies, labels and trains, round by round; writes and returns the last report.

    Each round leaves flights/, labels/, and what `train_any_body` leaves of a guidance, in
    `out`/round-N. The last bundle and report are in `out` too. After a kill it continues with the
    flight, the labels or the epoch where it was.

    Args:
      guidance: what `train_any_body` wrote.
      workers: fly and label, and report the progress of all rounds.

    Raises:
      InputError: there is no guidance in the folder, or see `run_campaign`, `label_flights` and
        `train`.
    """
    first = trained_settings(guidance)
    family, labels = known_family(guidance, first, workers.part(0.0, _PLANNED))
    bundle, rounds, report = guidance / "bundle", [], {}
    for number in range(1, settings.rounds + 1):
        folder = out / f"round-{number}"
        share = workers.part(_PLANNED, 1.0).part(
            (number - 1) / settings.rounds, number / settings.rounds
        )
        share.progress(0.0, f"round {number}")
        flights = round_flights(family, bundle, settings, number)
        outcome, more = _fly_and_label(flights, folder, settings.labels, share)
        labels = {name: np.concatenate([labels[name], more[name]]) for name in labels}
        rounds.append(outcome)
        schedule = dc.replace(first.schedule, epochs=settings.epochs, patience=settings.epochs)
        own = dc.replace(first, seed=first.seed + number, schedule=schedule)
        told = {"recipe": "any-body, DAgger", "rounds": list(rounds)}
        progress = share.part(_LABELLED, 1.0).progress
        report = learn(family, labels, own, folder, told, progress)
        bundle = folder / "bundle"
    publish(bundle.parent, out, ("report.json", "report.md"))
    workers.progress(1.0, "done")
    return report


def trained_settings(guidance: Path) -> AnyBodySettings:
    """The settings that a guidance was trained with.

    Raises:
      InputError: the folder holds none, or it was trained by another version.
    """
    try:
        report = json.loads((guidance / "report.json").read_text())
        version, fields = report.get("proxops", "before 1.4.0"), report["settings"]
        schedule = Schedule(**fields.pop("schedule"))
        settings = AnyBodySettings(**fields, schedule=schedule)
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise InputError(
            f"{guidance} is not what `proxops train --recipe any-body` wrote: its report.json "
            f"cannot be read ({error})"
        ) from error
    if version != metadata.version("proxops"):
        raise InputError(
            f"{guidance} was made by proxops {version}, and this is {metadata.version('proxops')}: "
            "train anew in another folder"
        )
    return settings


def round_flights(
    family: Family, bundle: Path, settings: AnyBodyDagger, number: int
) -> list[list[Flight]]:
    """The flights of a round at each member that is learned at; they depend on the arguments."""
    seed = settings.seed + number - 1
    if number > 1:
        settings = dc.replace(settings, dispersions=None)
    return [
        _member_flights(scenario, member, bundle, seed, settings)
        for member, scenario in enumerate(family.scenarios[: family.learned])
    ]


def _member_flights(
    scenario: Scenario, member: int, bundle: Path, seed: int, settings: AnyBodyDagger
) -> list[Flight]:
    body = load_body(scenario.body)
    # With the margin of flights, not the expert's, a member at the edge may be just beyond.
    policy = dc.replace(scenario.policy, bundle=str(bundle.resolve()), beyond_family=True)
    plain = dc.replace(scenario, policy=policy, log_ranges=False, dispersions=settings.dispersions)
    origin, flights = provenance(plain, body, "policy"), []
    for index in hard_transits(settings.flights):
        drawn = draw_world(at_rest(of_transit(plain, seed, index)), body)
        # Of the drawn world, all but the mass: the examples are those of the member's own.
        flown = dc.replace(drawn, spacecraft=scenario.spacecraft)
        name = f"member-{member:05d}-{seed}-{index:05d}"
        flights.append(Flight(name, flown, "policy", origin))
    return flights


def _fly_and_label(
    flights: Sequence[Sequence[Flight]], folder: Path, most: int, workers: Workers
) -> tuple[dict[str, int], Labels]:
    """How the flights of a round went, and the expert's forces along them, by member.

    Args:
      most: greatest number of states of a flight that are labelled.
    """
    everything = [flight for group in flights for flight in group]
    rows = run_campaign(
        everything, folder / "flights", keep_logs=True, workers=workers.part(0.0, _FLOWN)
    )
    logs = [round_logs(group, folder / "flights") for group in flights]
    members = [member for member, own in enumerate(logs) for _ in own]
    flown = [path for own in logs for path in own]
    parts = labels_by_flight(flown, folder / "labels", workers.part(_FLOWN, _LABELLED), most)
    sizes = [len(part["state"]) for part in parts]
    labels = joined_labels(parts) | {"member": np.repeat(members, sizes)}
    return round_outcome(rows, labels), labels
