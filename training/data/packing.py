"""Packs a folder of flight logs, completely or not at all, and again when the logs change."""

from __future__ import annotations

import contextlib
import dataclasses as dc
import fcntl
from collections.abc import Generator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from proxops.systems.common import (
    InputError,
    Progress,
    file_sha256,
    make_folder,
    silent,
    whole_folder,
    write_json,
)
from proxops.training.data.flight_columns import FlightColumns, Setting, read_columns
from proxops.training.data.normalisation import Moments
from proxops.training.data.packed_flights import (
    COLUMNS,
    INDEX,
    OFFSET,
    SCHEMA,
    PackedFlight,
    PackedFlights,
    part_of_transit,
)

# Flights of a set may differ in mass by this share: the load differs from day to day.
_MASS_SPREAD = 0.05


def pack_flights(
    folder: str | Path,
    cache: str | Path | None = None,
    progress: Progress = silent,
) -> PackedFlights:
    """Packs the logs of a folder, or opens the cache if it was packed from these logs.

    One log is in memory at a time. If several processes ask at once, one packs and the others wait
    for its result.

    Args:
      folder: folder with one *.nc file for each flight.
      cache: folder for the packed set; None: `packed` in `folder`.
      progress: is called with the share of the logs that are packed.

    Raises:
      InputError: there are no logs, one is damaged, they differ in a property that must be shared,
        none is in the training part, or the cache cannot be written.
    """
    folder = Path(folder)
    cache = folder / "packed" if cache is None else Path(cache)
    logs = sorted(folder.glob("*.nc"))
    if not logs:
        inside = folder / "flights"
        there = f": give {inside}" if any(inside.glob("*.nc")) else ""
        raise InputError(f"{folder} holds no flight logs (*.nc){there}")
    if cache.exists() and not (cache / INDEX).exists():
        raise InputError(f"{cache} exists and is no packed set of flights: give another name")
    make_folder(cache.parent)
    with _locked(cache):
        with contextlib.suppress(InputError):  # Missing, old or damaged: then it is made anew.
            packed = PackedFlights(cache)
            if _unchanged(packed, logs):
                return packed
        with whole_folder(cache) as part:
            write_json(part / INDEX, _write_columns(logs, part, progress), indent=1)
    return PackedFlights(cache)


def _unchanged(packed: PackedFlights, logs: Sequence[Path]) -> bool:
    """Whether the set was packed from these logs; reads only logs with another date."""
    if [flight.name for flight in packed.flights] != [path.name for path in logs]:
        return False
    for flight, path in zip(packed.flights, logs, strict=True):
        status = path.stat()
        if status.st_size != flight.size:
            return False
        if status.st_mtime_ns != flight.mtime_ns and file_sha256(path) != flight.sha256:
            return False
    return True


def _write_columns(logs: Sequence[Path], part: Path, progress: Progress) -> dict[str, Any]:
    """Writes all columns into the folder `part`; returns the index."""
    flights: list[PackedFlight] = []
    masses: list[float] = []
    setting: Setting | None = None
    moments = {name: Moments(n) for name, n in (
        ("position", 3), ("velocity", 3), ("force", 3), ("range", 1)
    )}  # fmt: skip
    row = hit = 0
    with contextlib.ExitStack() as stack:
        files = {name: stack.enter_context((part / f"{name}.bin").open("wb")) for name in COLUMNS}
        np.zeros(1, COLUMNS[OFFSET][1]).tofile(files[OFFSET])
        for done, path in enumerate(logs, start=1):
            columns = read_columns(path)
            setting = setting or columns.setting
            _check_together(path, columns.setting, logs[0], setting)
            masses.append(columns.setting.mass_kg)
            flights.append(_entry(path, columns, row))
            ends = {OFFSET: hit + np.cumsum(columns.hit_counts)}
            for name, values in {**columns.rows, **columns.hits, **ends}.items():
                values.astype(COLUMNS[name][1]).tofile(files[name])
            if flights[-1].part == "training":
                state, label = columns.rows["state"], columns.rows["mpc_force"]
                moments["position"].add(state[:, :3])
                moments["velocity"].add(state[:, 3:])
                moments["force"].add(label[np.isfinite(label).all(axis=1)])
                moments["range"].add(columns.hits["range"][:, None])
            row += flights[-1].steps
            hit += len(columns.hits["ray"])
            progress(done / len(logs), f"packing, {done} of {len(logs)}")
    if not any(flight.part == "training" and flight.steps for flight in flights):
        raise InputError(
            f"{logs[0].parent}: none of its transits is of the training part, which normalisation "
            "needs: collect more (of five in a row three are)"
        )
    assert setting is not None
    return {
        "schema": SCHEMA,
        "setting": dc.asdict(dc.replace(setting, mass_kg=float(np.mean(masses)))),
        "normalisation": {name: dc.asdict(each.scale()) for name, each in moments.items()},
        "flights": [dc.asdict(flight) for flight in flights],
    }


def _entry(path: Path, columns: FlightColumns, row: int) -> PackedFlight:
    status = path.stat()
    return PackedFlight(
        name=path.name,
        size=status.st_size,
        mtime_ns=status.st_mtime_ns,
        sha256=file_sha256(path),
        seed=columns.seed,
        transit=columns.transit,
        part=part_of_transit(columns.seed, columns.transit),
        start=row,
        steps=len(columns.rows["time"]),
    )


def _check_together(path: Path, setting: Setting, first: Path, wanted: Setting) -> None:
    """Raises `InputError` if a flight differs from the first in what a set must share."""
    for field in dc.fields(Setting):
        here, there = getattr(setting, field.name), getattr(wanted, field.name)
        if field.name == "mass_kg" and abs(here - there) <= _MASS_SPREAD * there:
            continue
        if here != there:
            values = "" if field.name == "body" else f" ({here} and {there})"
            raise InputError(
                f"{path} and {first.name} differ in {field.name}{values}: flights of a "
                "training set must share it; move one kind to a folder of its own"
            )


@contextlib.contextmanager
def _locked(cache: Path) -> Generator[None]:
    """Lets one process pack at a time; the system frees the lock of a process that dies."""
    try:
        file = cache.with_name(f".{cache.name}.lock").open("ab")
    except OSError as error:
        raise InputError(f"cannot write in {cache.parent}: {error.strerror}") from error
    with file:
        fcntl.flock(file, fcntl.LOCK_EX)
        yield
