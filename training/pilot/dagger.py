"""DAgger: the pilot flies, the expert labels the states it came to, and the guidance learns them.

S. Ross, G. Gordon and J. A. Bagnell, A reduction of imitation learning and structured prediction
to no-regret online learning, AISTATS 2011. From expert flights a pilot learns what to do where the
expert flies. Its own flights lead elsewhere, and a round of them shows it what to do there.
"""

from __future__ import annotations

import dataclasses as dc
import json
import math
import shutil
import time
from importlib import metadata
from pathlib import Path
from typing import Any

from proxops.diagrams.flight import Flight, Workers, provenance, run_campaign
from proxops.diagrams.scenario import Scenario, draw_world, load_body, of_transit
from proxops.systems.common import InputError, Progress, write_whole
from proxops.training.data import (
    Labels,
    PackedFlights,
    at_rest,
    hard_transits,
    label_flights,
    pack_flights,
    round_logs,
    round_outcome,
)
from proxops.training.export import publish, write_report
from proxops.training.loop import seeded, train
from proxops.training.pilot.dimensions import PilotDimensions
from proxops.training.pilot.examples import Commands, commands_of, joined, labelled_commands
from proxops.training.pilot.network import Pilot
from proxops.training.pilot.pilot_file import PILOT_FILE, load_pilot, pilot_sha256, save_pilot
from proxops.training.pilot.recipe import (
    collected_scenario,
    data_sha256,
    expert_labels,
    export_pilot,
    known_commands,
    pilot_report,
)
from proxops.training.pilot.settings import PilotSettings, settings_of
from proxops.training.pilot.tasks import guidance_task

# Shares of the whole work at which flights are packed and plans computed that are missing.
_PACKED, _PLANNED = 0.01, 0.02
# Shares of a round at which its flights and its labels end.
_FLOWN, _LABELLED = 0.35, 0.5
# A round's folder has the identity of its training in this file.
_NOTE = "training.txt"


@dc.dataclass(frozen=True, kw_only=True)
class DaggerSettings:
    """Settings of a run of DAgger."""

    rounds: int = 2
    flights: int = 240
    """Flights of each round; the straight line is blocked in three out of four."""
    seed: int = 100
    """Seed of the transits of the first round; each further round uses the next seed."""
    minutes: float = math.inf
    """After this time no round begins but the first, or the first that was not finished before."""


@dc.dataclass(frozen=True)
class _FirstTraining:
    """The training that all rounds build on: its data, its pilot, its settings."""

    flights: PackedFlights
    dimensions: PilotDimensions
    pilot: Pilot
    origin: dict[str, Any]
    settings: PilotSettings


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
    report.json, report.md and forces.png in `out`/round-N. The last five of the last round are in
    `out` too. After a kill it continues with the flight, the labels or the epoch where it was.

    The last round is trained for longer than the others. So with more rounds than before, what was
    the last round is trained anew, from its flights and labels, and the rounds that are new follow:
    the pilot is the same as if all rounds had been asked for at once.

    Args:
      data: what `proxops collect` wrote, from which the pilot was trained.
      pilot_folder: what `proxops train --recipe proxops` wrote.
      workers: fly and label, and report the progress of all rounds.

    Raises:
      InputError: the pilot was trained from other data or by another version, or see
        `run_campaign`, `label_flights` and `train`.
    """
    started = time.monotonic()
    scenario = collected_scenario(data)
    first = _first_training(data, pilot_folder, workers.part(0.0, _PACKED).progress)
    plans = expert_labels(scenario, pilot_folder, first.settings, workers.part(_PACKED, _PLANNED))
    commands = known_commands(first.flights, plans)
    expert_only = len(commands.force)
    bundle, history, report, resumed = pilot_folder / "bundle", [], {}, False
    for number in range(1, settings.rounds + 1):
        if history and not resumed and time.monotonic() - started > 60.0 * settings.minutes:
            break
        folder = out / f"round-{number}"
        this_round = workers.part(_PLANNED, 1.0).part(
            (number - 1) / settings.rounds, number / settings.rounds
        )
        this_round.progress(0.0, f"round {number}")
        campaign = dagger_flights(scenario, bundle, settings, number)
        outcome, labels = _fly_and_label(campaign, folder, this_round)
        commands = joined([commands, labelled_commands(labels)])
        history.append(outcome)
        # A round takes as many steps as the first training, although it has more examples. Only
        # the last, whose pilot is kept, shows each example as often as the first training did.
        share = 1.0 if number == settings.rounds else expert_only / len(commands.force)
        epochs = max(1, round(share * first.settings.guidance.epochs))
        identity = (
            f"proxops {metadata.version('proxops')}, DAgger round {number} of "
            f"{pilot_sha256(pilot_folder)}, {settings.flights} flights, seed {settings.seed}, "
            f"{first.settings}, {data_sha256(first.flights, commands)}, {epochs} epochs"
        )
        bundle, finished = folder / "bundle", _finished(folder, identity)
        resumed = finished is not None
        if finished is None:
            _forget_shorter_or_longer(folder, identity)
            progress = this_round.part(_LABELLED, 1.0).progress
            told = {"identity": identity, "rounds": list(history)}
            report = _train_round(first, commands, number, epochs, told, folder, progress)
        else:
            report, history = finished, finished["rounds"]
        if not resumed or number == settings.rounds:
            # An earlier run may have ended between the last round and this.
            publish(folder, out, (PILOT_FILE, "report.json", "report.md", "forces.png"))
    workers.progress(1.0, "done")
    return report


def _first_training(data: Path, pilot_folder: Path, progress: Progress) -> _FirstTraining:
    flights = pack_flights(data / "flights", progress=progress)
    dimensions, pilot, origin = load_pilot(pilot_folder)
    if origin.get("logs_sha256") != flights.logs_sha256:
        raise InputError(f"the pilot in {pilot_folder} was trained from other data than {data}")
    return _FirstTraining(flights, dimensions, pilot, origin, settings_of(origin))


def _fly_and_label(
    campaign: list[Flight], folder: Path, workers: Workers
) -> tuple[dict[str, int], Labels]:
    """How the flights of a round went, and the expert's forces along them."""
    rows = run_campaign(
        campaign, folder / "flights", keep_logs=True, workers=workers.part(0.0, _FLOWN)
    )
    logs = round_logs(campaign, folder / "flights")
    labels = label_flights(logs, folder / "labels", workers.part(_FLOWN, _LABELLED))
    return round_outcome(rows, labels), labels


def _train_round(
    first: _FirstTraining,
    commands: Commands,
    number: int,
    epochs: int,
    told: dict[str, Any],
    folder: Path,
    progress: Progress,
) -> dict[str, Any]:
    """Trains a guidance from nothing; writes the round's pilot, its bundle and its report.

    Args:
      commands: all that is known of the expert by now.
      told: `identity` and `rounds`, for the report.
    """
    settings, flights = first.settings, first.flights
    seed = settings.seed + number
    schedule = dc.replace(settings.guidance, epochs=epochs)
    pilot = restarted(first.dimensions, first.pilot, seed)
    held = commands_of(flights, "validation")
    motion, identity = pilot.filter.motion, told["identity"]
    task = guidance_task(pilot.guidance, motion, commands, held, schedule, seed, identity)
    options: Any = {"device": settings.device, "precision": settings.precision}
    trained = train(task, folder, seed, progress=progress, **options)
    pilot.cpu().eval()
    save_pilot(folder, first.dimensions, pilot, first.origin)
    report = pilot_report(pilot, settings, {"guidance": trained}, flights.logs_sha256)
    report = report | {"recipe": "proxops, DAgger"} | told
    report = write_report(pilot, flights, report, folder)
    export_pilot(pilot, flights, report, folder / "bundle", data_sha256(flights, commands))
    return report


def dagger_flights(
    scenario: Scenario, bundle: Path, settings: DaggerSettings, number: int
) -> list[Flight]:
    """The flights of a round, in worlds that are drawn as those of the set were.

    They depend on the arguments alone.
    """
    body = load_body(scenario.body)
    seed = settings.seed + number - 1
    policy = dc.replace(scenario.policy, bundle=str(bundle.resolve()))
    plain = dc.replace(scenario, policy=policy, log_ranges=False)
    origin = provenance(plain, body, "policy")
    flights = []
    for index in hard_transits(settings.flights):
        flown = draw_world(at_rest(of_transit(plain, seed, index)), body)
        flights.append(Flight(f"{seed}-{index:05d}", flown, "policy", origin))
    return flights


def restarted(dimensions: PilotDimensions, pilot: Pilot, seed: int) -> Pilot:
    """A pilot with the parts of the one given, but with a new guidance."""
    with seeded(seed):
        fresh = dimensions.make()
    kept = {
        name: weights
        for name, weights in pilot.state_dict().items()
        if not name.startswith("guidance.")
    }
    fresh.load_state_dict(kept, strict=False)
    fresh.filter.motion.requires_grad_(False)
    return fresh


def _forget_shorter_or_longer(folder: Path, identity: str) -> None:
    """Removes what a training of the same, but for another number of epochs, left of a round.

    What any other training left stays, and `train` refuses it.
    """
    note = folder / _NOTE
    known = note.read_text(encoding="utf-8") if note.is_file() else identity
    same, _, _ = identity.rpartition(", ")
    if known != identity and known.rpartition(", ")[0] == same:
        # The bundle too: it says that a round is over.
        for name in ("bundle", "curves"):
            shutil.rmtree(folder / name, ignore_errors=True)
        (folder / "guidance.ckpt").unlink(missing_ok=True)
    write_whole(note, lambda path: path.write_text(identity, encoding="utf-8"))


def _finished(folder: Path, identity: str) -> dict[str, Any] | None:
    """The report of a round if it is over and has this identity; else None."""
    try:
        report = json.loads((folder / "report.json").read_text())
    except (OSError, ValueError):
        return None
    # The bundle is written last.
    return report if report.get("identity") == identity and (folder / "bundle").is_dir() else None
