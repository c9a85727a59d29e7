"""DAgger: the pilot flies, the expert says what it would have done, and the guidance learns it.

S. Ross, G. Gordon and J. A. Bagnell, A reduction of imitation learning and structured prediction
to no-regret online learning, AISTATS 2011. What a pilot learns from expert flights is to fly where
the expert flies; its own flights go elsewhere, and a round of them shows it what to do there.
"""

from __future__ import annotations

import dataclasses as dc
import functools
import json
import math
import time
from pathlib import Path
from typing import Any

from proxops.diagrams.flight import Flight, Row, Workers, provenance, run_campaign
from proxops.diagrams.scenario import Scenario, dump_scenario, is_blocked, load_body, of_transit
from proxops.systems.common import InputError, silent, write_whole
from proxops.training.data import at_rest, label_flights, pack_flights
from proxops.training.export import write_folder, write_report
from proxops.training.loop import seeded, train
from proxops.training.pilot.examples import commands_of, joined, labelled_commands
from proxops.training.pilot.network import Pilot
from proxops.training.pilot.recipe import (
    collected_scenario,
    data_sha256,
    expert_labels,
    export_pilot,
    known_commands,
    pilot_report,
)
from proxops.training.pilot.settings import settings_of
from proxops.training.pilot.shape import (
    PILOT_FILE,
    PilotShape,
    load_pilot,
    pilot_sha256,
    save_pilot,
)
from proxops.training.pilot.tasks import guidance_task

# Of the transits that are not blocked one in this many is flown, because those are easy.
_CLEAR_EVERY = 7
# Shares of a round at which its flights, its labels and its training end.
_FLOWN, _LABELLED = 0.35, 0.5


@dc.dataclass(frozen=True)
class DaggerSettings:
    """Of a run of DAgger."""

    rounds: int = 2
    flights: int = 240
    """In each round, three in four of transits whose straight line is blocked."""
    seed: int = 100
    """Of the transits of the first round; the next has the next."""
    minutes: float = math.inf
    """No round is begun after these."""


def run_dagger(
    data: Path,
    pilot_folder: Path,
    out: Path,
    settings: DaggerSettings,
    workers: Workers = Workers(),
) -> dict[str, Any]:
    """Flies, labels and trains, round by round; writes and returns the last report.

    The expert's share of the flights is 1 at first, in those that `proxops collect` wrote, and 0 in
    all rounds: the schedule without a parameter of Ross, Gordon and Bagnell (2011), section 3.1.

    Each round leaves flights/, labels/, the guidance's checkpoint and curves, pilot.ckpt, bundle/,
    report.json, report.md and forces.png in `out`/round-N; the last five of the last round are in
    `out` too. Run again after a kill, it goes on with the flight, the labels or
    the epoch where it was; with more rounds it adds to those there are.

    Args:
      data: what `proxops collect` wrote, from which the pilot was trained.
      pilot_folder: what `proxops train --recipe proxops` wrote.
      workers: fly and label, and report how far all rounds are.

    Raises:
      InputError: the pilot was trained from other data, or see `run_campaign`, `label_flights` and
        `training_loop.train`.
    """
    started = time.monotonic()
    scenario = collected_scenario(data)
    flights = pack_flights(data / "flights")
    shape, pilot, origin = load_pilot(pilot_folder)
    if origin["logs_sha256"] != flights.logs_sha256:
        raise InputError(f"the pilot in {pilot_folder} was trained from other data than {data}")
    learned = settings_of(origin)
    plans = expert_labels(scenario, pilot_folder, learned, workers.reporting(silent))
    known = known_commands(flights, plans)
    expert_only = len(known.force)
    bundle, history, report = pilot_folder / "bundle", [], {}
    left: Path | None = None
    for number in range(1, settings.rounds + 1):
        if history and left is None and time.monotonic() - started > 60.0 * settings.minutes:
            break
        folder = out / f"round-{number}"
        this_round = workers.part((number - 1) / settings.rounds, number / settings.rounds)
        this_round.progress(0.0, f"round {number}")
        campaign = dagger_flights(scenario, bundle, settings, number)
        rows = run_campaign(
            campaign, folder / "flights", keep_logs=True, workers=this_round.part(0.0, _FLOWN)
        )
        logs = [folder / "flights" / f"{flight.name}.nc" for flight in campaign]
        labels = label_flights(logs, folder / "labels", this_round.part(_FLOWN, _LABELLED))
        known = joined([known, labelled_commands(labels)])
        history.append(_flown(rows) | {"labels": len(labels["state"])})

        # As many steps as without the labels, so that a round takes as long as the first training;
        # but the last, whose pilot stays, sees all examples as often.
        share = 1.0 if number == settings.rounds else expert_only / len(known.force)
        schedule = dc.replace(
            learned.guidance, epochs=max(1, round(share * learned.guidance.epochs))
        )
        learned_from = data_sha256(flights, known)
        identity = (
            f"DAgger round {number} of {pilot_sha256(pilot_folder)}, {settings.flights} flights, "
            f"seed {settings.seed}, {learned}, {learned_from}"
        )
        bundle = folder / "bundle"
        finished = _finished(folder, identity)
        if finished is not None:
            report, history, left = finished, finished["rounds"], folder
            continue
        pilot = restarted(shape, pilot, learned.seed + number)
        task = guidance_task(
            pilot.guidance, pilot.filter.motion, known, commands_of(flights, "validation"),
            schedule, learned.seed + number, identity,
        )  # fmt: skip
        trained = train(
            task,
            schedule,
            folder,
            learned.seed + number,
            device=learned.device,
            precision=learned.precision,
            progress=this_round.part(_LABELLED, 1.0).progress,
        )
        pilot.cpu().eval()
        save_pilot(folder, shape, pilot, origin)
        report = pilot_report(pilot, learned, {"guidance": trained}, flights.logs_sha256)
        report |= {
            "recipe": "proxops, DAgger",
            "identity": identity,
            "rounds": list(history),
        }
        report = write_report(pilot, flights, report, folder)
        export_pilot(pilot, flights, report, bundle, learned_from)
        _publish(folder, out)
        left = None
    if left is not None:
        _publish(left, out)  # Again: the run that finished it may have ended before.
    workers.progress(1.0, "done")
    return report


def dagger_flights(
    scenario: Scenario, bundle: Path, settings: DaggerSettings, number: int
) -> list[Flight]:
    """The flights of a round: a function of its arguments alone."""
    body = load_body(scenario.body)
    seed = settings.seed + number - 1
    policy = dc.replace(scenario.policy, bundle=str(bundle.resolve()))
    plain = dc.replace(scenario, policy=policy, log_ranges=False)
    origin = provenance(plain, body, "policy")
    flights = []
    for index in _chosen_transits(settings.flights):
        text = dump_scenario(at_rest(of_transit(plain, seed, index)))
        flights.append(Flight(f"{seed}-{index:05d}", text, "policy", origin))
    return flights


def _chosen_transits(count: int) -> list[int]:
    chosen: list[int] = []
    index = 0
    while len(chosen) < count:
        if is_blocked(index) or index % _CLEAR_EVERY == 0:
            chosen.append(index)
        index += 1
    return chosen


def restarted(shape: PilotShape, pilot: Pilot, seed: int) -> Pilot:
    """A pilot that sees as the one given, and whose guidance begins anew."""
    with seeded(seed):
        fresh = shape.make()
    kept = {
        name: weights
        for name, weights in pilot.state_dict().items()
        if not name.startswith("guidance.")
    }
    fresh.load_state_dict(kept, strict=False)
    fresh.filter.motion.requires_grad_(False)
    return fresh


def _flown(rows: list[Row]) -> dict[str, int]:
    """How the flights of a round went, before it was learned from."""
    return {
        "flights": len(rows),
        "arrived": sum(row["arrival_time_s"] is not None for row in rows),
        "violations": sum(row["keep_out_violations"] > 0 for row in rows),
        "collisions": sum(row["collided"] for row in rows),
    }


def _finished(folder: Path, identity: str) -> dict[str, Any] | None:
    """The report of a round that is over; None if it is not, or was another."""
    try:
        report = json.loads((folder / "report.json").read_text())
    except (OSError, ValueError):
        return None
    # The bundle is written last.
    return report if report.get("identity") == identity and (folder / "bundle").is_dir() else None


def _publish(folder: Path, out: Path) -> None:
    """Copies what a round leaves, each file whole or not at all."""
    for name in (PILOT_FILE, "report.json", "report.md", "forces.png"):
        content = (folder / name).read_bytes()
        write_whole(out / name, functools.partial(_write, content=content))
    files = {path.name: path.read_bytes() for path in sorted((folder / "bundle").iterdir())}
    write_folder(out / "bundle", files)


def _write(path: Path, content: bytes) -> None:
    path.write_bytes(content)
