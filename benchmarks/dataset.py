"""Compares training windows from packed flights with the same windows read from NetCDF logs.

Expert flights of seed 0 are flown first, unless a folder of logs is given. Everything runs on one
core; windows are in random order, ours and the other readers' in turn:

    python benchmarks/dataset.py [--logs FOLDER | --flights 6] [--length 32] [--rounds 5]
"""

import argparse
import os
import statistics
import tempfile
import time
import tracemalloc
from collections.abc import Callable
from pathlib import Path

for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ[name] = "1"

import h5py
import numpy as np
import torch
import xarray as xr
from rich.console import Console
from rich.table import Table

from proxops.diagrams.flight import fly
from proxops.diagrams.scenario import load_scenario
from proxops.training.data import PackedFlights, pack_flights
from proxops.training.loop import WindowDataset

CONSOLE = Console()
BATCH = 64
COLUMNS = ("state", "target", "force", "mpc_force", "ranges")


def timed(call: Callable) -> float:
    started = time.process_time()
    call()
    return time.process_time() - started


def packing(logs: Path, cache: Path) -> PackedFlights:
    """Packs, opens again, and says what each took and holds."""
    packed: list[PackedFlights] = []
    pack = timed(lambda: packed.append(pack_flights(logs, cache)))
    again = timed(lambda: pack_flights(logs, cache))
    flights = packed[0]
    table = Table(title=f"packing {len(flights.flights)} flights, {len(flights)} steps")
    table.add_column("")
    table.add_column("value", justify="right")
    before = sum(path.stat().st_size for path in logs.glob("*.nc"))
    after = sum(path.stat().st_size for path in cache.iterdir())
    hits = 100.0 * len(flights.ray) / (len(flights) * flights.setting.planes * flights.setting.rays)
    for name, value in {
        "packing, ms a flight": f"{1e3 * pack / len(flights.flights):.0f}",
        "opening what is packed, verified, ms": f"{1e3 * again:.0f}",
        "logs, kB a step": f"{before / len(flights) / 1e3:.2f}",
        "packed, kB a step": f"{after / len(flights) / 1e3:.2f}",
        "rays that return": f"{hits:.1f} %",
    }.items():
        table.add_row(name, value)
    CONSOLE.print(table)
    return flights


def h5py_windows(logs: Path, flights: PackedFlights, starts: np.ndarray, length: int) -> None:
    """The same windows, each a slice of its log's open file."""
    files = [h5py.File(logs / flight.name) for flight in flights.flights]
    firsts = np.array([flight.start for flight in flights.flights])
    for start in starts:
        flight = int(np.searchsorted(firsts, start, side="right")) - 1
        rows = slice(start - firsts[flight], start - firsts[flight] + length)
        window = {name: files[flight][name][rows] for name in COLUMNS}
        ranges = window["ranges"]
        torch.from_numpy(np.where(np.isfinite(ranges), ranges, -100.0).astype(np.float32))
    for file in files:
        file.close()


def xarray_windows(logs: Path, flights: PackedFlights, starts: np.ndarray, length: int) -> None:
    """The same windows, each by opening its log as a lazy dataset."""
    firsts = np.array([flight.start for flight in flights.flights])
    for start in starts:
        flight = int(np.searchsorted(firsts, start, side="right")) - 1
        rows = slice(start - firsts[flight], start - firsts[flight] + length)
        path = logs / flights.flights[flight].name
        with xr.open_dataset(path, engine="h5netcdf") as data:
            ranges = data[list(COLUMNS)].isel(time=rows).load()["ranges"].values
        torch.from_numpy(np.where(np.isfinite(ranges), ranges, -100.0).astype(np.float32))


def windows(logs: Path, flights: PackedFlights, length: int, rounds: int) -> None:
    kinds: dict[str, dict] = {
        "dense frames": {"frames": True},
        "no lidar": {},
    }
    random = np.random.default_rng(0)
    calls: dict[str, tuple[int, Callable]] = {}
    for name, options in kinds.items():
        dataset = WindowDataset(flights, "training", length, 1, **options)
        picks = random.integers(0, len(dataset), (4 if options.get("frames") else 40, BATCH))
        dataset.batch(picks[0])  # Compiled now.
        calls[f"ours: {name}"] = (
            picks.size, lambda dataset=dataset, picks=picks: [dataset.batch(k) for k in picks]
        )  # fmt: skip
        if "frames" in options:
            calls["ours: dense frames, one by one"] = (
                BATCH, lambda dataset=dataset, picks=picks: [dataset[int(k)] for k in picks[0]]
            )  # fmt: skip
            starts = dataset.starts[picks[0, :16]]
            for reader in (h5py_windows, xarray_windows):
                calls[f"{reader.__name__.partition('_')[0]}: dense frames"] = (
                    len(starts),
                    lambda reader=reader, starts=starts: reader(logs, flights, starts, length),
                )
    times: dict[str, list[float]] = {name: [] for name in calls}
    for _ in range(rounds):
        for name, (count, call) in calls.items():
            times[name].append(timed(call) / count)
    slowest = statistics.median(times["h5py: dense frames"])
    table = Table(title=f"windows of {length} steps, batches of {BATCH}, median of {rounds}")
    for heading in ("", "windows/s", "220,000 steps (s)", "over h5py"):
        table.add_column(heading, justify="right" if heading else "left")
    for name in calls:
        each = statistics.median(times[name])
        epoch = 220_000 / length * each
        table.add_row(name, f"{1 / each:,.0f}", f"{epoch:.2f}", f"{slowest / each:.1f} x")
    CONSOLE.print(table)


def memory(logs: Path, cache: Path) -> None:
    """Peak of what packing allocates, for half of the flights and for all: it must not grow."""
    paths = sorted(logs.glob("*.nc"))
    peaks = []
    with tempfile.TemporaryDirectory(dir=cache.parent) as name:
        for count in sorted({max(1, len(paths) // 2), len(paths)}):
            folder = Path(name) / str(count)
            folder.mkdir()
            for path in paths[:count]:
                (folder / path.name).symlink_to(path.resolve())
            tracemalloc.start()
            pack_flights(folder)
            peaks.append(f"{count} flights {tracemalloc.get_traced_memory()[1] / 2**20:.0f} MiB")
            tracemalloc.stop()
    CONSOLE.print(f"peak of packing: {', '.join(peaks)}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--logs", type=Path)
    parser.add_argument("--flights", type=int, default=6)
    parser.add_argument("--length", type=int, default=32)
    parser.add_argument("--rounds", type=int, default=5)
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        logs, cache = arguments.logs, Path(name) / "packed"
        if logs is None:
            logs = Path(name) / "logs"
            logs.mkdir()
            for index in range(arguments.flights):
                scenario = load_scenario(
                    None, {"transit.seed": 0, "transit.index": index}, on_true_state=True
                )
                fly(scenario).to_netcdf(logs / f"{index:05d}.nc")
        flights = packing(logs, cache)
        memory(logs, cache)
        windows(logs, flights, arguments.length, arguments.rounds)


if __name__ == "__main__":
    main()
