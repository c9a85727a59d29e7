"""A training set from end to end: the flights, their manifest and the report on them."""

from __future__ import annotations

import typing
from collections.abc import Mapping, Sequence
from pathlib import Path

from proxops.diagrams.flight import Flight, Workers, run_campaign
from proxops.diagrams.scenario import LearnedLidarConfig, Scenario, load_body
from proxops.systems.common import InputError, write_json
from proxops.training.data.collection import (
    check_files,
    collection_flights,
    describe_flight,
    make_manifest,
)
from proxops.training.data.collection_report import collection_report, collection_sections
from proxops.training.reports import write_markdown


def collect(
    scenario: Scenario,
    mix: Mapping[str, int],
    seed: int,
    count: int,
    out: Path,
    *,
    learned_lidar: LearnedLidarConfig | None = None,
    workers: Workers = Workers(),
) -> tuple[dict[str, typing.Any], dict[str, typing.Any]]:
    """Flies the expert flights 0 … count - 1 of a seed; returns their manifest and report.

    Writes a log of each to `out`/flights, and manifest.json, report.json and report.md to `out`.
    Flights that are there already are not flown again: see `run_campaign`, also for `workers`.

    Args:
      learned_lidar: as of `collection_flights`.

    Raises:
      InputError: the folder has logs of other flights, no flight can begin in its world, or see
        `collection_flights`, `run_campaign` and `check_files`.
    """
    body = load_body(scenario.body)
    flights = collection_flights(scenario, body, mix, seed, count, learned_lidar)
    _refuse_others(flights, out / "flights")
    rows = run_campaign(
        flights,
        out / "flights",
        keep_logs=True,
        describe=describe_flight,
        workers=workers,
    )
    check_files(out / "flights", rows)
    manifest = make_manifest(scenario, body, mix, seed, rows)
    if not manifest["flights"]:
        reason = manifest["unflyable"][0]["unflyable"]
        raise InputError(f"none of the {count} flights can begin in its world; the first: {reason}")
    report = collection_report(manifest)
    write_json(out / "manifest.json", manifest)
    write_json(out / "report.json", report)
    title = f"Expert flights of seed {report['seed']}"
    write_markdown(out, title, collection_sections(report))
    return manifest, report


def _refuse_others(flights: Sequence[Flight], folder: Path) -> None:
    """Raises `InputError` if a folder has logs of other flights, which a training would learn."""
    others = {path.name for path in folder.glob("*.nc")} - {f"{each.name}.nc" for each in flights}
    if others:
        raise InputError(
            f"{folder} has {len(others)} logs of other flights, such as {min(others)}, from which "
            "a training would learn too: remove them, or give another --out"
        )
