"""Many flights: in parallel with Dask, durable one by one, resumable at any point."""

from __future__ import annotations

import contextlib
import dataclasses as dc
import fcntl
import functools
import hashlib
import json
import typing
from collections.abc import Callable, Generator, Mapping, Sequence
from importlib import metadata
from pathlib import Path

from pydrake.common.yaml import yaml_dump_typed

from proxops.diagrams.flight.named_controllers import controller_source
from proxops.diagrams.flight.parallel import Workers
from proxops.diagrams.flight.scenario_systems import WITH_BUNDLE, bundle_of
from proxops.diagrams.flight.simulation import fly
from proxops.diagrams.logs import FlightLog
from proxops.diagrams.scenario import (
    Body,
    BodyConfig,
    LearnedLidarConfig,
    Scenario,
    dump_scenario,
    load_body,
    of_transit,
    parse_scenario,
)
from proxops.systems.common import InputError, make_folder, write_whole
from proxops.systems.lidar import LidarBundle
from proxops.systems.policy import PolicyBundle

# Letters of a controller's name that are taken into that of a file.
_LONGEST_LABEL = 60

Row = dict[str, typing.Any]
Describe = Callable[[FlightLog, Path | None], Row]
"""What is kept of a flight, from its log and, if it is kept, the log's file. It is sent to the
workers, so it must be a function of a module."""


@dc.dataclass(frozen=True)
class Flight:
    """One flight of a campaign, as text, so that it can be sent to any worker."""

    name: str
    """Of its files, unique in the campaign."""
    scenario: str
    """YAML of the whole scenario."""
    controller: str
    """As `named_controller` knows it."""
    provenance: str
    """Version of proxops, hash of the body, and of the bundles of a learned lidar and of the
    policy, or of the file of a controller of one's own, if they fly: flights made with others are
    not mixed in."""


def body_sha256(body: Body) -> str:
    """Hash of a body's constants and shape."""
    constants = yaml_dump_typed(body.config, schema=BodyConfig) or ""
    return hashlib.sha256((constants + body.shape.sha256).encode()).hexdigest()


def version_and_body(body: Body) -> str:
    """What every flight, and every plan of the expert, is made with."""
    return f"proxops {metadata.version('proxops')}, body {body_sha256(body)}"


def provenance(scenario: Scenario, body: Body, controller: str) -> str:
    """What a flight's `provenance` says of flights of this scenario by this version.

    Raises:
      InputError: no such bundle, or no such module.
    """
    origin = version_and_body(body)
    if isinstance(scenario.lidar, LearnedLidarConfig):
        origin += f", lidar {LidarBundle.load(scenario.lidar.bundle).sha256}"
    bundle = bundle_of(controller, scenario)
    if bundle is not None:
        origin += f", policy {PolicyBundle.load(bundle).sha256}"
    source = controller_source(controller)
    if source is not None:
        origin += f", controller {hashlib.sha256(source.read_bytes()).hexdigest()}"
    return origin


def transit_flights(scenario: Scenario, controller: str, seed: int, count: int) -> list[Flight]:
    """Flights of transits 0 … count - 1 of a seed by one controller.

    A start and a goal of the scenario's own are left out; its start velocity is every flight's.

    Raises:
      InputError: see `provenance`.
    """
    origin = provenance(scenario, load_body(scenario.body), controller)
    label = controller_label(controller)
    flights = []
    for index in range(count):
        text = dump_scenario(of_transit(scenario, seed, index))
        flights.append(Flight(f"{label}-{seed}-{index:05d}", text, controller, origin))
    return flights


def file_label(text: str) -> str:
    """A text as it may stand in a file's name."""
    return "".join(letter if letter.isalnum() else "-" for letter in text)


def controller_label(controller: str) -> str:
    """A controller's name as it may stand in a file's.

    Paths that differ may look alike there, or be long: they end in a hash of the name.
    """
    plain = file_label(controller)
    kind, colon, _ = controller.partition(":")
    if not (colon and kind in WITH_BUNDLE):
        return plain
    return f"{plain[:_LONGEST_LABEL]}-{hashlib.sha256(controller.encode()).hexdigest()[:8]}"


def _summary(log: FlightLog, path: Path | None) -> Row:
    return log.summary


def run_campaign(
    flights: Sequence[Flight],
    folder: Path,
    *,
    keep_logs: bool = False,
    describe: Describe = _summary,
    workers: Workers = Workers(),
) -> list[Row]:
    """Flies what has not been flown yet and returns every flight's summary, in order.

    A flight's summary is written to `folder`/NAME.json, and its log to NAME.nc before, when it is
    over; a file that exists is whole. A campaign that was interrupted, by Ctrl-C or `kill -9`,
    goes on where it stopped when it is run again. A flight is locked while it is flown, so that
    two campaigns in one folder, or what a killed one left running, share the work.

    Args:
      folder: made if it does not exist.
      keep_logs: writes the logs too.
      describe: makes the row that is kept of a flight; by default its log's summary.
      workers: fly, and report how many flights are over.

    Raises:
      InputError: the folder cannot be written, or holds other flights under the same names, or a
        flight ended the process that flew it again and again.
    """
    make_folder(folder)
    rows: dict[str, Row] = {}
    todo = []
    for flight in flights:
        row = _finished(flight, folder, keep_logs)
        if row is None:
            todo.append(flight)
        else:
            rows[flight.name] = row
    workers.progress(*_progress(rows, len(flights)))
    task = functools.partial(
        _fly_one, folder=folder.resolve(), keep_logs=keep_logs, describe=describe
    )
    with contextlib.closing(workers.results(todo, task)) as results:
        for name, row in results:
            rows[name] = row
            workers.progress(*_progress(rows, len(flights)))
    return [rows[flight.name] for flight in flights]


def _progress(rows: Mapping[str, Row], count: int) -> tuple[float, str]:
    """The share of the flights that are over, and a text, for a `Progress`."""
    failures = sum(not row["success"] for row in rows.values())
    return len(rows) / max(count, 1), f"{len(rows)} of {count} flights, {failures} without success"


def run_groups(
    groups: Mapping[str, Sequence[Flight]], folder: Path, **options: typing.Any
) -> dict[str, list[Row]]:
    """Groups of flights as one campaign; each group's rows, in order.

    The first flights of all groups come first, so that a campaign that was interrupted has
    something of each. `options` are those of `run_campaign`.
    """
    places = [(k, name) for name, flights in groups.items() for k in range(len(flights))]
    places.sort(key=lambda place: place[0])
    found = run_campaign([groups[name][k] for k, name in places], folder, **options)
    rows: dict[str, list[Row]] = {name: [] for name in groups}
    for (_, name), row in zip(places, found, strict=True):
        rows[name].append(row)
    return rows


def _fly_one(flight: Flight, folder: Path, keep_logs: bool, describe: Describe) -> Row:
    with _locked(folder, flight.name):
        row = _finished(flight, folder, keep_logs)
        if row is not None:
            return row  # Somebody else's, by now.
        for part in folder.glob(f".{flight.name}.*.part"):
            part.unlink()  # Of a process that was killed.
        scenario = parse_scenario(flight.scenario)
        log = fly(scenario, flight.controller, body=_body(scenario.body))
        path = folder / f"{flight.name}.nc" if keep_logs else None
        if path is not None:
            log.to_netcdf(path)
        row = describe(log, path)
        text = json.dumps({"flight": dc.asdict(flight), "summary": row})
        write_whole(folder / f"{flight.name}.json", lambda name: name.write_text(text))
        return row


@contextlib.contextmanager
def _locked(folder: Path, name: str) -> Generator[None]:
    """Waits until no other process flies this flight; the system frees the locks of the dead.

    One file holds all locks: a byte for each flight, at a place that its name gives.
    """
    place = int.from_bytes(hashlib.sha256(name.encode()).digest()[:7])
    try:
        file = (folder / ".lock").open("ab")
    except OSError as error:
        raise InputError(f"cannot write in {folder}: {error.strerror}") from error
    with file:
        fcntl.lockf(file, fcntl.LOCK_EX, 1, place)
        yield


# A body is a campaign's one large thing: loaded once in each worker.
_body = functools.lru_cache(maxsize=1)(load_body)


def _finished(flight: Flight, folder: Path, keep_logs: bool) -> Row | None:
    """The summary of a flight that is over, or None."""
    path = folder / f"{flight.name}.json"
    if not path.is_file() or (keep_logs and not (folder / f"{flight.name}.nc").is_file()):
        return None
    try:
        content = json.loads(path.read_text())
        flown, summary = content["flight"], content["summary"]
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise InputError(f"{path} is not the summary of a flight: remove it") from error
    if flown != dc.asdict(flight):
        raise InputError(
            f"{path} is of a flight with another scenario, body, controller or version: "
            "give another output folder, or remove that one"
        )
    return summary
