"""Flight logs packed for training: a folder of memory maps with the returns of lidar frames."""

from __future__ import annotations

import dataclasses as dc
import hashlib
import json
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from proxops.systems.common import InputError, derived_seed
from proxops.training.data.flight_columns import HITS, ROWS, Setting
from proxops.training.data.normalisation import Normalisation

SCHEMA = 4
INDEX = "packed_flights.json"
# Where the hits of each step begin; one more at the end.
OFFSET = "offset"
COLUMNS: dict[str, tuple[int | None, str]] = {**ROWS, **HITS, OFFSET: (None, "<i8")}
"""By the name of a file NAME.bin: length of a row, None for a number, and type."""
PARTS = ("training", "validation", "test")
# Of each block of five transits: 60 %, 20 %, 20 %.
_BLOCK = ("training", "training", "training", "validation", "test")


def part_of_transit(seed: int, transit: int) -> str:
    """The part of transit number `transit` of a seed; it depends on the arguments alone.

    Of each block of five transits (0 … 4, 5 … 9, …) three are drawn for training, one for
    validation and one for testing. So the shares are exact over whole blocks. Flights that are
    added later move no earlier transit to another part. All flights of one transit, disturbed or
    not, are in the same part.
    """
    block, place = divmod(transit, len(_BLOCK))
    order = np.random.default_rng(derived_seed(0, seed, block)).permutation(len(_BLOCK))
    return _BLOCK[order[place]]


@dc.dataclass(frozen=True)
class PackedFlight:
    """One flight's entry in the index."""

    name: str
    """Name of its log file."""
    size: int
    mtime_ns: int
    sha256: str
    seed: int
    transit: int
    part: str
    start: int
    """Its first row."""
    steps: int
    """Number of its rows."""


class PackedFlights:
    """The steps of many flights: one row for each step, flight by flight; vectors are in K.

    - `time` (N,) in s; `state` and `target` (N, 6) in m and m/s.
    - `commanded_force` (N, 3) in N, along S: what was commanded over the period before the step, at
      first 0.
    - `mpc_force` (N, 3) in N: the label; NaN where the MPC was not asked.
    - `kick` (N, 3) in m/s^2: the acceleration by a velocity kick from this step to the next.
    - `ray`, `range` (m) and `offset`: the returns of row k are those from `offset[k]` up to
      `offset[k + 1]`. Ray r is ray r mod `rays` of plane r // `rays`.

    All are read-only memory maps.
    """

    time: np.ndarray
    state: np.ndarray
    target: np.ndarray
    commanded_force: np.ndarray
    mpc_force: np.ndarray
    kick: np.ndarray
    ray: np.ndarray
    range: np.ndarray
    offset: np.ndarray

    def __init__(self, folder: str | Path):
        """Opens what `pack_flights` wrote.

        Raises:
          InputError: the folder holds no packed set, or one of another version, or a file is
            missing or cut.
        """
        self.folder = Path(folder).resolve()
        try:
            index = json.loads((self.folder / INDEX).read_text())
            if index["schema"] != SCHEMA:
                raise ValueError(f"it is of version {index['schema']}, not {SCHEMA}")
            self.flights = tuple(PackedFlight(**flight) for flight in index["flights"])
            self.setting = Setting(**index["setting"])
            self.normalisation = Normalisation.of(index["normalisation"])
            for name in COLUMNS:
                setattr(self, name, _column(self.folder, name))
            steps = {len(getattr(self, name)) for name in ROWS} | {len(self.offset) - 1}
            if steps != {sum(flight.steps for flight in self.flights)} or self.offset[-1] != len(
                self.ray
            ):
                raise ValueError("its files do not fit together")
        except (OSError, ValueError, KeyError, TypeError, RecursionError) as error:
            raise InputError(
                f"{self.folder} is no packed set of flights, or it is damaged: {error}; pack the "
                "logs again"
            ) from error
        self.logs_sha256 = logs_sha256(self.flights)

    def __repr__(self) -> str:
        return (
            f"PackedFlights({str(self.folder)!r}: {len(self.flights)} flights, {len(self)} steps)"
        )

    def __len__(self) -> int:
        """Number of steps."""
        return len(self.time)

    def part(self, name: str) -> list[PackedFlight]:
        """Flights of one part: `training`, `validation` or `test`."""
        return [flight for flight in self.flights if flight.part == name]

    def frames(self, rows: np.ndarray) -> np.ndarray:
        """Lidar frames (N, planes, rays), float32, of rows (N,) as in the logs; +inf: no return."""
        shape = len(rows), self.setting.planes * self.setting.rays
        frames = np.full(shape, np.inf, dtype=np.float32)
        first = self.offset[rows]
        counts = self.offset[np.asarray(rows) + 1] - first
        # The hits of all rows, one row after the other: where each row's begin, plus 0, 1, 2, ...
        hits = np.arange(counts.sum()) + np.repeat(first - (np.cumsum(counts) - counts), counts)
        frames[np.repeat(np.arange(len(rows)), counts), self.ray[hits]] = self.range[hits]
        return frames.reshape(-1, self.setting.planes, self.setting.rays)


def _column(folder: Path, name: str) -> np.ndarray:
    """A column as a read-only memory map; there is none of an empty file."""
    path, (width, kind) = folder / f"{name}.bin", COLUMNS[name]
    # Plain arrays on the same memory: numpy is faster with them than with its own memmap class.
    column = np.asarray(np.memmap(path, kind, "r")) if path.stat().st_size else np.empty(0, kind)
    return column if width is None else column.reshape(-1, width)


def logs_sha256(flights: Iterable[PackedFlight]) -> str:
    """Hash of the names, sizes and contents of the logs that a set is packed from."""
    lines = [f"{flight.name}\t{flight.size}\t{flight.sha256}\n" for flight in flights]
    return hashlib.sha256("".join(lines).encode()).hexdigest()


def part_rows(flights: PackedFlights, part: str) -> np.ndarray:
    """Rows (N,) of all steps of a part."""
    ranges = [np.arange(each.start, each.start + each.steps) for each in flights.part(part)]
    return np.concatenate([np.zeros(0, dtype=np.int64), *ranges])
