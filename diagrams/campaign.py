"""Many flights: in parallel with Dask, durable one by one, resumable at any point."""

from __future__ import annotations

import contextlib
import dataclasses as dc
import functools
import hashlib
import json
import os
import typing
from collections.abc import Callable, Generator, Sequence
from importlib import metadata
from pathlib import Path

import numba
from pydrake.common.yaml import yaml_dump_typed

from proxops.diagrams.body import BodyConfig, load_body
from proxops.diagrams.flight_log import make_folder, write_whole
from proxops.diagrams.scenario import (
    LearnedLidarConfig,
    Scenario,
    dump_scenario,
    parse_scenario,
)
from proxops.diagrams.simulation import fly
from proxops.systems.errors import InputError
from proxops.systems.lidar_bundle import LidarBundle

Row = dict[str, typing.Any]


@dc.dataclass(frozen=True)
class Flight:
    """One flight of a campaign, as text, so that it can be sent to any worker."""

    name: str
    """Of its files, unique in the campaign."""
    scenario: str
    """YAML of the whole scenario."""
    controller: str
    """As `named_controller` knows it."""
    made_with: str
    """Version of proxops, hash of the body, and of the lidar's bundle if it is a learned one:
    flights made with others are not mixed in."""


def transit_flights(scenario: Scenario, controller: str, seed: int, count: int) -> list[Flight]:
    """Flights of transits 0 … count - 1 of a seed by one controller."""
    body = load_body(scenario.body)
    constants = yaml_dump_typed(body.config, schema=BodyConfig) or ""
    digest = hashlib.sha256((constants + body.shape.sha256).encode()).hexdigest()
    made_with = f"proxops {metadata.version('proxops')}, body {digest}"
    if isinstance(scenario.lidar, LearnedLidarConfig):
        made_with += f", lidar {LidarBundle.load(scenario.lidar.bundle).sha256}"
    label = "".join(letter if letter.isalnum() else "-" for letter in controller)
    flights = []
    for index in range(count):
        transit = dc.replace(scenario.transit, seed=seed, index=index, start_m=None, goal_m=None)
        text = dump_scenario(dc.replace(scenario, transit=transit))
        flights.append(Flight(f"{label}-{seed}-{index:05d}", text, controller, made_with))
    return flights


def run_campaign(
    flights: Sequence[Flight],
    folder: Path,
    *,
    keep_logs: bool = False,
    workers: int | None = None,
    scheduler: str | None = None,
    progress: Callable[[Row], None] | None = None,
) -> list[Row]:
    """Flies what has not been flown yet and returns every flight's summary, in order.

    A flight's summary is written to `folder`/NAME.json, and its log to NAME.nc before, when it is
    over; a file that exists is whole. A campaign that was interrupted, by Ctrl-C or `kill -9`,
    goes on where it stopped when it is run again.

    Args:
      folder: made if it does not exist.
      keep_logs: writes the logs too.
      workers: processes on this machine; None: one for each core. 1 flies in this process.
      scheduler: address of a Dask scheduler whose workers fly instead; they need proxops, and
        `folder` under the same path.
      progress: is called with the summary of each flight that is over, earlier ones first.

    Raises:
      InputError: the folder cannot be written, or holds other flights under the same names.
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
            if progress is not None:
                progress(row)
    workers = min(workers or os.cpu_count() or 1, len(todo))
    with contextlib.closing(_results(todo, folder, keep_logs, workers, scheduler)) as results:
        for name, row in results:
            rows[name] = row
            if progress is not None:
                progress(row)
    return [rows[flight.name] for flight in flights]


def _results(
    flights: Sequence[Flight], folder: Path, keep_logs: bool, workers: int, scheduler: str | None
) -> Generator[tuple[str, Row]]:
    """Name and summary of each flight as it ends."""
    if scheduler is None and workers <= 1:
        for flight in flights:
            yield flight.name, _fly_one(flight, folder, keep_logs)
        return
    from dask.distributed import as_completed  # Slow to import: only when it is needed.

    with _client(workers, scheduler) as client:
        futures = [
            client.submit(
                _fly_one_alone, flight, folder.resolve(), keep_logs, key=flight.name, pure=False
            )
            for flight in flights
        ]
        names = {future.key: flight.name for future, flight in zip(futures, flights, strict=True)}
        done = as_completed(futures)
        del futures
        for future in done:
            yield names[future.key], future.result()
            future.release()


@contextlib.contextmanager
def _client(workers: int, scheduler: str | None):
    import dask.config
    from dask.distributed import Client, LocalCluster

    if scheduler is not None:
        try:
            client = Client(scheduler, timeout="10s")
        except (OSError, ValueError, TimeoutError) as error:
            raise InputError(f"no Dask scheduler answers at {scheduler}: {error}") from error
        with client:
            yield client
        return
    settings = {
        "distributed.worker.multiprocessing-method": "spawn",
        # Dask would put these variables into this process's environment too.
        "distributed.nanny.pre-spawn-environ": {},
        # A worker that is killed is replaced, and its flight flown again.
        "distributed.scheduler.allowed-failures": 3,
    }
    with (
        dask.config.set(settings),
        LocalCluster(
            n_workers=workers,
            threads_per_worker=1,
            processes=True,
            dashboard_address=None,  # pyright: ignore[reportArgumentType]  (documented: none)
        ) as cluster,
        Client(cluster) as client,
    ):
        yield client


def _fly_one_alone(flight: Flight, folder: Path, keep_logs: bool) -> Row:
    """As `_fly_one`, in a worker beside others: one flight is one thread's work."""
    numba.set_num_threads(1)
    return _fly_one(flight, folder, keep_logs)


def _fly_one(flight: Flight, folder: Path, keep_logs: bool) -> Row:
    scenario = parse_scenario(flight.scenario)
    log = fly(scenario, flight.controller, body=_body(scenario.body))
    if keep_logs:
        log.to_netcdf(folder / f"{flight.name}.nc")
    row = log.summary
    text = json.dumps({"flight": dc.asdict(flight), "summary": row})
    write_whole(folder / f"{flight.name}.json", lambda path: path.write_text(text))
    return row


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
