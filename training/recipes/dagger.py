"""DAgger: a policy flies, the expert labels the states it came to, and its guidance learns them.

S. Ross, G. Gordon and J. A. Bagnell, A reduction of imitation learning and structured prediction
to no-regret online learning, AISTATS 2011. From expert flights a policy learns what to do where the
expert flies. Its own flights lead elsewhere, and a round of them shows it what to do there.
"""

from __future__ import annotations

import dataclasses as dc
import itertools
import math
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from proxops.diagrams.flight import Flight, Workers, provenance, run_campaign
from proxops.diagrams.scenario import draw_world, is_blocked, load_body, of_transit
from proxops.training.data import Labels, at_rest, joined_labels, labels_by_flight
from proxops.training.export import publish
from proxops.training.recipes.any_body import any_body_learner
from proxops.training.recipes.pilot import pilot_learner
from proxops.training.recipes.recipe import Learner, Round

# Share of the whole work at which data that are missing are made anew; mostly there are none.
_PREPARED = 0.02
# Shares of a round at which its flights and its labels end.
_FLOWN, _LABELLED = 0.4, 0.55
# Of the transits that are not blocked one in this many is flown, because those are easy.
_CLEAR_EVERY = 7


@dc.dataclass(frozen=True, kw_only=True)
class DaggerSettings:
    """Settings of a run of DAgger."""

    rounds: int = 2
    flights: int | None = None
    """Flights of each round, at each body of a family; the straight line is blocked in three out of
    four. None: 240 of a pilot, 3 at each body."""
    seed: int = 100
    """Seed of the transits of the first round; each further round uses the next seed."""
    minutes: float = math.inf
    """After this time no round begins but the first, or the first that was not finished before."""
    epochs: int | None = None
    """Epochs of each round's training; None: for any body 80, for a pilot those of its first
    training, see `pilot_learner`."""
    dispersions: str | None = "after_survey"
    """For any body: see `any_body_learner`. A pilot flies in the worlds of its data."""


def run_dagger(
    data: Path | None,
    first: Path,
    out: Path,
    settings: DaggerSettings,
    workers: Workers = Workers(),
) -> dict[str, Any]:
    """Flies, labels and trains, round by round; writes and returns the last report.

    The expert's share of the flights is 1 before the first round and 0 in all rounds: the schedule
    without a parameter of Ross, Gordon and Bagnell (2011), section 3.1.

    Each round leaves flights/, labels/, and what its recipe writes of a policy, in `out`/round-N.
    The last policy's bundle and report are in `out` too. After a kill it continues with the flight,
    the labels or the epoch where it was.

    Args:
      data: what `proxops collect` wrote, from which a pilot was trained; None: for any body.
      first: what `proxops train` wrote.
      workers: fly and label, and report the progress of all rounds.

    Raises:
      InputError: the policy was trained from other data or by another version, or see
        `run_campaign`, `labels_by_flight` and `train`.
    """
    started, resumed = time.monotonic(), True
    preparing = workers.part(0.0, _PREPARED)
    if data is None:
        learner = any_body_learner(first, settings.dispersions, preparing)
    else:
        learner = pilot_learner(data, first, preparing)
    folder, labels, outcomes, report = learner.folder, learner.labels, [], {}
    for number in range(1, settings.rounds + 1):
        if not resumed and time.monotonic() - started > 60.0 * settings.minutes:
            break
        share = workers.part(_PREPARED, 1.0).part(
            (number - 1) / settings.rounds, number / settings.rounds
        )
        share.progress(0.0, f"round {number}")
        flights = round_flights(learner, folder / "bundle", settings, number)
        folder = out / f"round-{number}"
        resumed = (folder / "bundle").is_dir()  # It is written last.
        outcome, more = _fly_and_label(flights, folder, learner.states, share)
        labels = joined_labels([labels, more])
        outcomes.append(outcome)
        this = Round(number, number == settings.rounds, settings.epochs, outcomes)
        report = learner.learn(labels, folder, this, share.part(_LABELLED, 1.0).progress)
    publish(folder, out, learner.files)
    workers.progress(1.0, "done")
    return report


def round_flights(
    learner: Learner, bundle: Path, settings: DaggerSettings, number: int
) -> list[list[Flight]]:
    """The flights of a round in each scenario, in its world; they depend on the arguments alone."""
    seed, rounds = settings.seed + number - 1, []
    for member, scenario in enumerate(learner.scenarios(number)):
        body = load_body(scenario.body)
        policy = dc.replace(scenario.policy, bundle=str(bundle.resolve()))
        plain = dc.replace(scenario, policy=policy, log_ranges=False)
        origin, flights = provenance(plain, body, "policy"), []
        for index in hard_transits(settings.flights or learner.flights):
            flown = draw_world(at_rest(of_transit(plain, seed, index)), body)
            if learner.own_mass:
                flown = dc.replace(flown, spacecraft=scenario.spacecraft)
            name = f"member-{member:05d}-{seed}-{index:05d}"
            flights.append(Flight(name, flown, "policy", origin))
        rounds.append(flights)
    return rounds


def hard_transits(count: int) -> list[int]:
    """Numbers of `count` transits of a set: all blocked ones, and a few of the others."""
    hard = (each for each in itertools.count() if is_blocked(each) or each % _CLEAR_EVERY == 0)
    return list(itertools.islice(hard, count))


def _fly_and_label(
    flights: Sequence[Sequence[Flight]], folder: Path, states: int | None, workers: Workers
) -> tuple[dict[str, int], Labels]:
    """How the flights of a round went, and the expert's forces along them, by member."""
    everything = [flight for group in flights for flight in group]
    rows = run_campaign(
        everything, folder / "flights", keep_logs=True, workers=workers.part(0.0, _FLOWN)
    )
    # A world that cannot be flown is no flight, and has no log.
    paths = [[folder / "flights" / f"{flight.name}.nc" for flight in group] for group in flights]
    logs = [(k, path) for k, group in enumerate(paths) for path in group if path.exists()]
    parts = labels_by_flight(
        [path for _, path in logs], folder / "labels", workers.part(_FLOWN, _LABELLED), states
    )
    for (member, _), part in zip(logs, parts, strict=True):
        part["member"] = np.full(len(part["state"]), member)
    labels = joined_labels(parts)
    rows = [row for row in rows if "unflyable" not in row]
    outcome = {
        "flights": len(rows),
        "arrived": sum(row.get("arrival_time_s") is not None for row in rows),
        "violations": sum(bool(row.get("keep_out_violations")) for row in rows),
        "collisions": sum(bool(row.get("collided")) for row in rows),
        "labels": len(labels["state"]),
    }
    return outcome, labels
