"""Campaigns: many flights in parallel. Each is stored when it ends, so a campaign can resume."""

from __future__ import annotations

import contextlib
import dataclasses as dc
import fcntl
import functools
import hashlib
import json
import re
import tempfile
import typing
from collections.abc import Callable, Generator, Iterable, Mapping, Sequence
from pathlib import Path

from proxops.diagrams.flight.named_controllers import WITH_BUNDLE
from proxops.diagrams.flight.origin import Provenance, own_version, provenance
from proxops.diagrams.flight.parallel import Workers
from proxops.diagrams.flight.simulation import fly
from proxops.diagrams.logs import FlightLog
from proxops.diagrams.scenario import (
    Body,
    Scenario,
    UnflyableWorldError,
    dispersed_values,
    draw_world,
    dump_scenario,
    load_body,
    of_transit,
)
from proxops.systems.common import InputError, make_folder, write_whole

# Greatest number of letters of a controller's name that a file's name contains.
_LONGEST_LABEL = 60

Row = dict[str, typing.Any]
Describe = Callable[[FlightLog, Path | None], Row]
"""Makes the row that a campaign stores for a flight, from its log and the path of the log's file
(None if logs are not kept). It is sent to the workers, so it must be a function of a module."""
Choose = Callable[[Mapping[str, Row]], set[str]]
"""Gives, of some flights' rows by their names, the names of those whose logs stay. What does not
stay among some flights must not stay among more."""


@dc.dataclass(frozen=True)
class Flight:
    """One flight of a campaign; it pickles, so it can be sent to any worker."""

    name: str
    """Name of the flight's files; it is unique in the campaign."""
    scenario: Scenario
    """The whole scenario; nobody may change it."""
    controller: str
    """Name of the controller, as `named_controller` takes it."""
    provenance: Provenance
    """A campaign uses a stored flight again only if its provenance is the same."""

    @property
    def stored(self) -> Row:
        """The flight as its JSON file holds it; the scenario is YAML there."""
        texts = {"scenario": dump_scenario(self.scenario), "provenance": dc.asdict(self.provenance)}
        return vars(self) | texts


def transit_flights(scenario: Scenario, controller: str, seed: int, count: int) -> list[Flight]:
    """Gives the flights of transits 0 … count - 1 of a seed by one controller.

    If the scenario gives a start and a goal, they are ignored. Its start velocity is that of every
    flight. If it has dispersions, each flight has a world of its own, drawn from them.

    Raises:
      InputError: see `provenance` and `draw_world`.
    """
    body = load_body(scenario.body)
    label = controller_label(controller)
    flights, origins = [], {}  # By the mesh of the true body, which may be drawn, too.
    for index in range(count):
        drawn = draw_world(of_transit(scenario, seed, index), body)
        mesh = drawn.truth.mesh
        if mesh not in origins:
            true = dc.replace(scenario, truth=dc.replace(scenario.truth, mesh=mesh))
            origins[mesh] = provenance(true, body, controller)
        name = f"{label}-{seed}-{index:05d}"
        flights.append(Flight(name, drawn, controller, origins[mesh]))
    return flights


def file_label(text: str) -> str:
    """Makes a text fit for a file's name: every other character becomes a hyphen."""
    return "".join(letter if letter.isalnum() else "-" for letter in text)


def controller_label(controller: str) -> str:
    """Makes a controller's name fit for a file's name.

    A name with a bundle's path is cut, and a hash of the whole name is added, so that different
    paths give different labels.
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
    keep_logs: bool | Choose = False,
    describe: Describe = _summary,
    workers: Workers = Workers(),
) -> list[Row]:
    """Flies the flights that are not stored yet and returns the row of every flight, in order.

    When a flight ends, its log is written to `folder`/NAME.nc, if logs are kept, and then its row
    to `folder`/NAME.json. A file that exists is complete. If a campaign is interrupted, by Ctrl-C
    or `kill -9`, it continues where it stopped when it is run again. A flight is locked while it
    is flown, so two campaigns in one folder, or the processes that a killed campaign left behind,
    share the work.

    Args:
      flights: the flights of the campaign.
      folder: is created if it does not exist.
      keep_logs: whether to write the logs too; or which of those flown now stay. A flight that is
        stored is flown again for its log only if all are kept.
      describe: makes the row of a flight; by default, the row is the log's summary.
      workers: fly, and report how many flights have ended.

    Returns:
      One row for each flight, in the order of `flights`. If a flight cannot begin in its world, its
      row has the reason as `unflyable`, and `controller`, `seed`, `transit` and `dispersed` alone.

    Raises:
      InputError: the folder cannot be written; it holds other flights under the same names; or a
        flight repeatedly ended the process that flew it.
    """
    make_folder(folder)
    rows: dict[str, Row] = {}
    todo = []
    for flight in flights:
        row = _finished(flight, folder, keep_logs is True)
        if row is None:
            todo.append(flight)
        else:
            rows[flight.name] = row
    _make_tables(todo)
    kept = f"; {len(rows)} are there from before" if rows else ""
    done, text = _progress(rows, len(flights))
    workers.progress(done, text + kept)
    held: set[str] = set()
    # Flights that another process is flying come last, and are then waited for.
    for wait in (False, True):
        task = functools.partial(
            _fly_one,
            folder=folder.resolve(),
            keep_logs=None if callable(keep_logs) else keep_logs,
            describe=describe,
            wait=wait,
        )
        with contextlib.closing(workers.results(todo, task)) as results:
            for name, row in results:
                if row is not None:
                    rows[name] = row
                    if callable(keep_logs) and "unflyable" not in row:
                        held = _let_logs_go(
                            folder, keep_logs, {each: rows[each] for each in (*held, name)}
                        )
                    workers.progress(*_progress(rows, len(flights)))
        todo = [flight for flight in todo if flight.name not in rows]
        if not todo:
            break
    return [rows[flight.name] for flight in flights]


def fly_many(
    scenarios: Mapping[str, Scenario],
    controller: str = "mpc",
    folder: Path | None = None,
    **options: typing.Any,
) -> dict[str, Row]:
    """Flies scenarios on all cores, such as those of a sweep: see `run_campaign`.

    `pandas.DataFrame(fly_many({"60 kg": …, "90 kg": …})).T` is a table of all figures.

    Args:
      scenarios: by names, which become names of files in `folder`, so they are made of letters,
        digits, hyphens, blanks and dots. Each has a transit of its own; with dispersions, its world
        is drawn.
      controller: a name that `named_controller` takes.
      folder: keeps the rows, so that no flight is flown twice; None: they are not kept.
      options: those of `run_campaign`.

    Returns:
      The summary of each flight, by its name.

    Raises:
      InputError: a scenario cannot be flown; or see `run_campaign`.
    """
    flights = []
    for name, scenario in scenarios.items():
        if re.fullmatch(r"[\w. -]+", name) is None:
            raise InputError(f"{name!r} is no name of a file: use letters, digits, blanks, - and .")
        body = load_body(scenario.body)
        drawn = draw_world(scenario, body)
        flights.append(Flight(name, drawn, controller, provenance(drawn, body, controller)))
    with contextlib.ExitStack() as stack:
        if folder is None:
            folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        rows = run_campaign(flights, folder, **options)
    return dict(zip(scenarios, rows, strict=True))


def _let_logs_go(folder: Path, choose: Choose, rows: Mapping[str, Row]) -> set[str]:
    """Removes the logs of flights that are not chosen; gives the names of the others."""
    chosen = choose(rows)
    for name in rows.keys() - chosen:
        (folder / f"{name}.nc").unlink(missing_ok=True)
    return chosen


def _progress(rows: Mapping[str, Row], count: int) -> tuple[float, str]:
    """Gives the share of the flights that have ended, and a text, for a `Progress`."""
    failures = sum(not row.get("success", True) for row in rows.values())
    return len(rows) / max(count, 1), f"{len(rows)} of {count} flights, {failures} without success"


def run_groups(
    groups: Mapping[str, Sequence[Flight]], folder: Path, **options: typing.Any
) -> dict[str, list[Row]]:
    """Flies groups of flights as one campaign and returns each group's rows, in order.

    The first flight of each group is flown before the second flight of any, so that an interrupted
    campaign has flights of all groups. `options` are those of `run_campaign`.

    Raises:
      InputError: see `run_campaign`.
    """
    places = [(k, name) for name, flights in groups.items() for k in range(len(flights))]
    places.sort(key=lambda place: place[0])
    found = run_campaign([groups[name][k] for k, name in places], folder, **options)
    rows: dict[str, list[Row]] = {name: [] for name in groups}
    for (_, name), row in zip(places, found, strict=True):
        rows[name].append(row)
    return rows


def _fly_one(
    flight: Flight, folder: Path, keep_logs: bool | None, describe: Describe, wait: bool
) -> Row | None:
    """The row of a flight; None if another process flies it and is not waited for.

    Args:
      keep_logs: None: a log is written, but a flight is not flown again for it.
    """
    with _locked(folder, flight.name, wait) as locked:
        if not locked:
            return None
        row = _finished(flight, folder, keep_logs is True)
        if row is not None:
            return row  # Another process has flown it meanwhile.
        own, asked = own_version(), flight.provenance.version
        if asked != own:  # On another machine of a cluster.
            raise InputError(
                f"a worker has proxops {own}, but the campaign is of proxops {asked}: install that "
                "there"
            )
        for part in folder.glob(f".{flight.name}.*.part"):
            part.unlink()  # A process that was killed left it.
        path = None if keep_logs is False else folder / f"{flight.name}.nc"
        try:
            log = fly(flight.scenario, flight.controller, body=_body_of(flight))
        except UnflyableWorldError as error:
            row = {
                "controller": flight.controller,
                "seed": flight.scenario.transit.seed,
                "transit": flight.scenario.transit.index,
                "dispersed": dispersed_values(flight.scenario),
                "unflyable": str(error),
            }
        except InputError as error:
            raise InputError(f"flight {flight.name}: {error}") from error
        else:
            if path is not None:
                log.to_netcdf(path)
            row = describe(log, path)
        text = json.dumps({"flight": flight.stored, "summary": row})
        write_whole(folder / f"{flight.name}.json", lambda name: name.write_text(text))
        return row


@contextlib.contextmanager
def _locked(folder: Path, name: str, wait: bool) -> Generator[bool]:
    """Locks a flight; gives whether it could. `wait` until no other process flies it.

    The operating system frees the locks of a process that ends. One file holds all locks: a flight
    locks one byte, at an offset that is computed from its name.
    """
    place = int.from_bytes(hashlib.sha256(name.encode()).digest()[:7])
    try:
        file = (folder / ".lock").open("ab")
    except OSError as error:
        raise InputError(f"cannot write in {folder}: {error.strerror}") from error
    with file:
        try:
            fcntl.lockf(file, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB), 1, place)
        except (BlockingIOError, PermissionError):
            yield False
        except OSError as error:
            raise InputError(
                f"{folder} is on a file system without locks ({error.strerror}): use a folder on "
                "another one"
            ) from error
        else:
            yield True


def _make_tables(flights: Iterable[Flight]) -> None:
    """Makes the gravity tables of flights that have none yet, for the workers to read."""
    tabulated = [flight for flight in flights if flight.scenario.gravity == "table"]
    for flight in {flight.scenario.body: flight for flight in tabulated}.values():
        # Building the field writes the table into the user's cache folder.
        _ = _body_of(flight).gravity_field


# Each worker loads the body only once, because loading it takes long. Where the file has changed,
# its hash has, too.
@functools.lru_cache(maxsize=1)
def _body(name: str, gravity: str, sha256: str) -> Body:
    return load_body(name).with_gravity(gravity)


def _body_of(flight: Flight) -> Body:
    return _body(flight.scenario.body, flight.scenario.gravity, flight.provenance.body)


def _finished(flight: Flight, folder: Path, keep_logs: bool) -> Row | None:
    """Gives the row of a flight that is stored, or None."""
    path = folder / f"{flight.name}.json"
    if not path.is_file():
        return None
    try:
        content = json.loads(path.read_text())
        flown, summary = content["flight"], content["summary"]
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise InputError(f"{path} is not the summary of a flight; remove this file") from error
    wanted = flight.stored
    if flown != wanted:
        raise InputError(
            f"{folder} holds flights with another {_difference(flown, wanted)}, such as "
            f"{path.name}: give another output folder, or remove these files to fly them anew"
        )
    if keep_logs and "unflyable" not in summary and not (folder / f"{flight.name}.nc").is_file():
        return None
    return summary


def _difference(flown: typing.Any, wanted: Row) -> str:
    """Says in words what differs between two flights, as their JSON files hold them."""
    one, other = _parts(flown), _parts(wanted)
    differing = [name for name in {**other, **one} if one.get(name) != other.get(name)]
    return ", or another ".join(differing) or "name"


def _parts(stored: typing.Any) -> Row:
    """What a stored flight was flown with, by the words for it; an earlier version's has less."""
    stored = stored if isinstance(stored, dict) else {}
    origin = stored.get("provenance")
    origin = origin if isinstance(origin, dict) else {}
    return {
        "scenario": stored.get("scenario"),
        "controller": stored.get("controller"),
        "version of proxops": origin.get("version"),
        "body": origin.get("body"),
        **{f"content of the {kind}'s file": each for kind, each in origin.get("files", {}).items()},
    }
