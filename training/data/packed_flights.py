"""Flight logs packed for training: a folder of memory maps with the returns of lidar frames."""

from __future__ import annotations

import dataclasses as dc
import hashlib
import json
import typing
from pathlib import Path

import numpy as np

from proxops.diagrams.scenario import parse_mapping
from proxops.systems.common import InputError
from proxops.training.data.column_file import open_column
from proxops.training.data.flight_columns import HITS, ROWS, Setting
from proxops.training.data.normalisation import Normalisation
from proxops.training.data.transit_split import PARTS

SCHEMA = 3
INDEX = "packed_flights.json"
# Where the hits of each step begin; one more at the end.
OFFSET = "offset"


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
    controller: str
    scenario_sha256: str
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

    All are read-only memory maps. Only the folder's name is pickled: a worker process opens the
    maps itself, and refuses a folder that was packed again in the meantime.
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

    def __repr__(self) -> str:
        return (
            f"PackedFlights({str(self.folder)!r}: {len(self.flights)} flights, {len(self)} steps)"
        )

    def __init__(self, folder: str | Path, *, verify: bool = True):
        """Opens what `pack_flights` wrote.

        Args:
          verify: reads every file to check that no bit has changed and that the contents make
            sense.

        Raises:
          InputError: the folder holds no packed set, or one of another version, or it is damaged;
            the message names the file.
        """
        self.folder = Path(folder).resolve()
        path = self.folder / INDEX
        try:
            index = json.loads(path.read_text())
            schema = index["schema"]
        except (OSError, ValueError, KeyError, TypeError, RecursionError) as error:
            raise InputError(
                f"{self.folder} is no packed set of flights: {INDEX} in it cannot be read ({error})"
            ) from error
        if schema != SCHEMA:
            raise InputError(f"{path} is of version {schema}, not {SCHEMA}: pack the logs again")
        try:
            self.flights = tuple(PackedFlight(**flight) for flight in index["flights"])
            self.setting = Setting(**index["setting"])
            self.logs_sha256 = str(index["logs_sha256"])
            columns = {name: dict(index["columns"][name]) for name in (*ROWS, *HITS, OFFSET)}
        except (KeyError, TypeError, ValueError) as error:
            raise InputError(f"{path} is damaged: {error}; pack the logs again") from error
        self.normalisation = Normalisation.from_json(index.get("normalisation"), str(path))
        for name, described in columns.items():
            setattr(self, name, open_column(self.folder / f"{name}.npy", described, verify))
        steps = sum(flight.steps for flight in self.flights)
        lengths = {name: len(getattr(self, name)) for name in ROWS} | {OFFSET: len(self.offset) - 1}
        wrong = [name for name, length in lengths.items() if length != steps]
        wrong += [name for name in HITS if len(getattr(self, name)) != self.offset[-1]]
        if wrong or logs_sha256(self.flights) != self.logs_sha256:
            raise InputError(f"{path} is damaged: it does not fit {', '.join(wrong) or 'itself'}")
        if verify:
            self._check_contents(path)

    def _check_contents(self, path: Path) -> None:
        """Raises `InputError` for a set that no packing gives, though its hashes fit."""
        if not _is_sound(self.setting):
            raise InputError(f"{path} is damaged: its setting cannot be; pack the logs again")
        ends = np.cumsum([0, *(flight.steps for flight in self.flights)])
        starts = [flight.start for flight in self.flights]
        sound = {
            "flights": starts == ends[:-1].tolist() and (np.diff(ends) >= 0).all(),
            "parts": all(flight.part in PARTS for flight in self.flights),
            "offset": self.offset[0] == 0 and (np.diff(self.offset) >= 0).all(),
            "ray": self.ray.max(initial=0) < self.setting.planes * self.setting.rays,
        }
        wrong = [name for name, good in sound.items() if not good]
        if wrong:
            raise InputError(
                f"{path} is damaged: {', '.join(wrong)} cannot be; pack the logs again"
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

    def __getstate__(self) -> dict[str, typing.Any]:
        return {"folder": str(self.folder), "logs_sha256": self.logs_sha256}

    def __setstate__(self, state: dict[str, typing.Any]) -> None:
        self.__init__(state["folder"], verify=False)
        if self.logs_sha256 != state["logs_sha256"]:
            raise InputError(f"{self.folder} has been packed anew since it was opened; start again")


def _is_sound(setting: Setting) -> bool:
    """Whether a setting has numbers that can be, and a body with a keep-out ellipsoid."""
    counts = setting.planes, setting.rays
    sizes = (
        setting.max_range_m, setting.control_period_s, setting.mass_kg, setting.thrust_limit_n
    )  # fmt: skip
    try:
        body = parse_mapping(setting.body, "the body")
        axes = np.array(body["keep_out_semi_axes_m"], dtype=float)
        return (
            all(isinstance(count, int) and count >= 1 for count in counts)
            and all(isinstance(size, float | int) and size > 0.0 for size in sizes)
            and isinstance(body["name"], str)
            and axes.shape == (3,)
            and bool((np.isfinite(axes) & (axes > 0.0)).all())
        )
    except Exception:  # YAML from a stranger makes its reader raise all sorts of errors.
        return False


def logs_sha256(flights: typing.Iterable[PackedFlight]) -> str:
    """Hash of the names, sizes and contents of the logs that a set is packed from."""
    lines = [f"{flight.name}\t{flight.size}\t{flight.sha256}\n" for flight in flights]
    return hashlib.sha256("".join(lines).encode()).hexdigest()


def part_rows(flights: PackedFlights, part: str) -> np.ndarray:
    """Rows (N,) of all steps of a part."""
    ranges = [np.arange(each.start, each.start + each.steps) for each in flights.part(part)]
    return np.concatenate([np.zeros(0, dtype=np.int64), *ranges])
