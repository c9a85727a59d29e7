"""Folders of short real flights, for tests of what reads many logs."""

import shutil
from functools import cache
from pathlib import Path

from exported_once import made_once
from short_flights import BRIEF, short_scenario

from proxops.diagrams.flight.simulation import fly
from proxops.diagrams.logs.flight_log import FlightLog

# Transit, and what else differs: transit 1 is flown twice, undisturbed and disturbed.
FLIGHTS: dict[str, tuple[int, dict[str, object]]] = {
    "a-0": (0, {}),
    "a-1": (1, {}),
    "a-2": (2, {"arrival__deadline_s": 137.0}),
    "a-3": (3, {"arrival__deadline_s": 137.0}),
    "a-4": (4, {"disturbance": {}, "noise_seed": 4}),
    "b-1": (1, {"disturbance": {}, "noise_seed": 9}),
    "b-5": (5, {"disturbance": {}, "noise_seed": 5}),
}


@cache
def flight(name: str) -> FlightLog:
    """One of `FLIGHTS`, each from another start; do not change it."""
    transit, changes = FLIGHTS[name]
    start = [160e3, 100.0 * list(FLIGHTS).index(name), 0.0]
    own = {"transit__seed": 3, "transit__index": transit, "transit__start_m": start}
    return fly(short_scenario(**(BRIEF | own | changes)))


def _write(folder: Path) -> None:
    folder.mkdir()
    for name in FLIGHTS:
        flight(name).to_netcdf(folder / f"{name}.nc")


def copy_flights(folder: Path) -> Path:
    """A folder with a log of each of `FLIGHTS`, to be changed at will."""
    target = folder / "flights"
    target.mkdir()
    for path in made_once("flights", _write).glob("*.nc"):
        shutil.copy2(path, target)
    return target
