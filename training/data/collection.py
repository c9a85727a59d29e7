"""A training set: its expert flights, their manifest, and the report on them."""

from __future__ import annotations

import dataclasses as dc
import typing
from collections.abc import Mapping, Sequence
from importlib import metadata
from pathlib import Path

import numpy as np

from proxops.diagrams.flight import Flight, Row, Workers, body_sha256, provenance, run_campaign
from proxops.diagrams.logs import FlightLog
from proxops.diagrams.scenario import (
    Body,
    LearnedLidarConfig,
    Scenario,
    draw_world,
    dump_scenario,
    load_body,
)
from proxops.systems.common import InputError, file_sha256, write_json
from proxops.systems.lidar import LidarBundle
from proxops.systems.shapes import clearances
from proxops.training.data.collection_report import (
    CLEARANCE_EDGES,
    GOAL_EDGES,
    collection_report,
    collection_sections,
)
from proxops.training.data.recovery import flight_scenario, kind_of
from proxops.training.reports import SMALL_COMMAND, write_markdown


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


def collection_flights(
    scenario: Scenario,
    body: Body,
    mix: Mapping[str, int],
    seed: int,
    count: int,
    learned_lidar: LearnedLidarConfig | None = None,
) -> list[Flight]:
    """The expert flights 0 … count - 1 of a seed; a longer set begins with a shorter one.

    Args:
      learned_lidar: gives the frames of all flights except the nominal ones, as in the paper.

    Raises:
      InputError: no transit or start is found for a flight, or the learned lidar cannot be used.
    """
    disturbed = scenario if learned_lidar is None else dc.replace(scenario, lidar=learned_lidar)
    origins = [provenance(wanted, body, "mpc") for wanted in (scenario, disturbed)]
    flights = []
    for index in range(count):
        kind = kind_of(mix, index)
        nominal = kind == "nominal"
        flown = flight_scenario(kind, scenario if nominal else disturbed, body, seed, index)
        flown = draw_world(flown, body)
        origin = origins[0 if nominal else 1]
        flights.append(Flight(f"{seed}-{index:05d}", flown, "mpc", origin))
    return flights


def learned_lidar_of(
    scenario: Scenario, bundle: Path, kind: str | None = None
) -> LearnedLidarConfig:
    """A learned lidar with the errors of the scenario's lidar.

    Args:
      bundle: folder that `proxops train-lidar` wrote: `bundle` or `paper_bundle`.
      kind: `RAY_NETWORK` or `FRAME_NETWORK`, if the bundle has to be of one kind.

    Raises:
      InputError: there is no bundle, it is damaged, or it is of another kind.
    """
    found = LidarBundle.load(bundle).kind
    if kind not in (None, found):
        raise InputError(f"{bundle} is a {found}, not a {kind}")
    names = {field.name for field in dc.fields(LearnedLidarConfig)}
    given = [each.name for each in dc.fields(scenario.lidar) if each.name in names]
    known: dict[str, typing.Any] = {name: getattr(scenario.lidar, name) for name in given}
    known["bundle"] = str(bundle.resolve())  # Flights may be flown from another folder.
    return LearnedLidarConfig(**known)


def describe_flight(log: FlightLog, path: Path | None) -> Row:
    """The manifest's row of a flight: its summary, its file, and statistics of its commands.

    `zero_commands` counts the `commands` below `SMALL_COMMAND` of the thrust limit on x, on y, on
    z, and on all three. `goal_distances` and `clearances` are histograms of the rows over
    `GOAL_EDGES` and `CLEARANCE_EDGES`, with one more bin at either end.
    """
    data, unit = log.dataset, log.scenario.arrival.radius_m
    states = data["state"].values
    commands = data["mpc_force"].values
    commands = commands[np.isfinite(commands).all(axis=1)]
    small = np.abs(commands) < SMALL_COMMAND * log.scenario.spacecraft.thrust_limit_n
    distances = np.linalg.norm(states[:, :3] - data["target"].values[:, :3], axis=1)
    heights = clearances(log.body.keep_out_semi_axes, states[:, :3])
    row = log.summary | {
        "rows": len(states),
        "commands": len(commands),
        "zero_commands": [*small.sum(axis=0).tolist(), int(small.all(axis=1).sum())],
        "goal_distances": _counts(distances / unit, GOAL_EDGES),
        "clearances": _counts(heights / unit, CLEARANCE_EDGES),
    }
    if path is not None:
        row |= {"file": path.name, "bytes": path.stat().st_size, "sha256": file_sha256(path)}
    return row


def _counts(values: np.ndarray, edges: Sequence[float]) -> list[int]:
    """Numbers of values below the first edge, between neighbouring edges, and above the last."""
    return np.bincount(
        np.searchsorted(edges, values, side="right"), minlength=len(edges) + 1
    ).tolist()


def make_manifest(
    scenario: Scenario, body: Body, mix: Mapping[str, int], seed: int, rows: Sequence[Row]
) -> dict[str, typing.Any]:
    """The content of `manifest.json`: how the set was made, and a row for each flight.

    Args:
      rows: rows of `describe_flight`, in the order of the flights. Their files are relative to the
        manifest's `folder`. Flights that could not begin in their worlds are listed apart.
    """
    all_flights = [
        {"index": index, "kind": kind_of(mix, index), **row} for index, row in enumerate(rows)
    ]
    flights = [flight for flight in all_flights if "unflyable" not in flight]
    return {
        "proxops_version": metadata.version("proxops"),
        "body_sha256": body_sha256(body),
        "scenario": dump_scenario(scenario),
        "mix": dict(mix),
        "seed": seed,
        "folder": "flights",
        "flights": flights,
        "unflyable": [flight for flight in all_flights if "unflyable" in flight],
    }


def check_files(folder: Path, rows: Sequence[Row]) -> None:
    """Raises `InputError` for the first log that is missing or has another length than before."""
    for row in rows:
        if "unflyable" in row:
            continue
        path = folder / row["file"]
        length = path.stat().st_size if path.is_file() else None
        if length != row["bytes"]:
            raise InputError(
                f"{path} has {length} bytes and had {row['bytes']} when it was written: remove "
                f"it and run again to fly it anew"
            )


def _refuse_others(flights: Sequence[Flight], folder: Path) -> None:
    """Raises `InputError` if a folder has logs of other flights, which a training would learn."""
    others = {path.name for path in folder.glob("*.nc")} - {f"{each.name}.nc" for each in flights}
    if others:
        raise InputError(
            f"{folder} has {len(others)} logs of other flights, such as {min(others)}, from which "
            "a training would learn too: remove them, or give another --out"
        )
