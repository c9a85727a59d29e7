"""Windows of consecutive steps of packed flights, as a torch `Dataset`, and batches of them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
import torch
from torch.utils.data import Dataset

from proxops.systems.common import InputError, generator
from proxops.training.data import PARTS, PackedFlights

Batch = dict[str, torch.Tensor]


class WindowDataset(Dataset[Batch]):
    """Windows of T consecutive steps; each window lies within one flight.

    A window is a dict of tensors, and a batch has one more axis in front. All are float32 unless
    the table says otherwise; all are in SI, and vectors are in K, but `commanded_force` is along S.

    ```
    time           (T,)       s since the start of the flight
    state          (T, 6)     position and velocity: the truth, which a policy does not see
    target         (T, 6)     position and velocity to reach
    commanded_force  (T, 3)     force over the period before the step
    mpc_force      (T, 3)     the label; 0 where the MPC was not asked
    labelled       (T,)       bool: whether the MPC was asked
    kicked         (T,)       bool: whether a velocity kick follows before the next step
    frames         (T, planes, rays)  only with `frames`: ranges, +inf where no ray returned
    ```

    The windows of a flight start every `stride` steps. One more window ends with the flight, so
    that every step is in a window. A flight that is shorter than a window has none.

    An index is a number, for one window, or a list of numbers, for a batch.
    """

    def __init__(
        self,
        flights: PackedFlights,
        part: str,
        length: int,
        stride: int | None = None,
        *,
        frames: bool = False,
    ):
        """Chooses the windows of one part of the flights.

        Args:
          part: `training`, `validation` or `test`.
          length: T, the number of steps in a window.
          stride: steps from the start of one window to the start of the next; None: T.
          frames: whether windows hold lidar frames.

        Raises:
          InputError: there is no such part, or none of its flights is as long as a window.
        """
        stride = length if stride is None else stride
        if part not in PARTS:
            raise InputError(f"there is no part {part!r}; choose from {', '.join(PARTS)}")
        if length < 1 or stride < 1:
            raise InputError(
                f"windows need a length and a stride of at least 1, got {length} and {stride}"
            )
        self.flights, self.length = flights, length
        self._frames = frames
        chosen = flights.part(part)
        starts = [flight.start + _starts(flight.steps, length, stride) for flight in chosen]
        self.starts = np.concatenate([np.zeros(0, dtype=np.int64), *starts])
        if len(self.starts) == 0:
            longest = max((flight.steps for flight in chosen), default=0)
            raise InputError(
                f"{flights.folder}: the {part} part has {len(chosen)} flights, the longest of "
                f"{longest} steps; no window of {length} fits"
            )

    def __len__(self) -> int:
        return len(self.starts)

    def __getitem__(self, index: int | Sequence[int]) -> Batch:
        if isinstance(index, int | np.integer):
            return {name: values[0] for name, values in self.batch([int(index)]).items()}
        return self.batch(index)

    def batch(self, indices: Sequence[int]) -> Batch:
        """Several windows at once; the batch is the first axis of each tensor."""
        items = np.asarray(indices, dtype=np.int64)
        packed = self.flights
        rows = (self.starts[items][:, None] + np.arange(self.length)).ravel()
        label = packed.mpc_force[rows]
        labelled = ~np.isnan(label[:, 0])
        columns = {
            "time": packed.time[rows],
            "state": packed.state[rows],
            "target": packed.target[rows],
            "commanded_force": packed.commanded_force[rows],
            "mpc_force": np.where(labelled[:, None], label, 0.0),
        }
        columns = {name: values.astype(np.float32) for name, values in columns.items()}
        columns |= {"labelled": labelled, "kicked": packed.kick[rows].any(axis=1)}
        if self._frames:
            columns["frames"] = packed.frames(rows)
        return {
            name: torch.from_numpy(values.reshape(len(items), self.length, *values.shape[1:]))
            for name, values in columns.items()
        }


def _starts(steps: int, length: int, stride: int) -> np.ndarray:
    """First steps of a flight's windows, in rising order."""
    if steps < length:
        return np.zeros(0, dtype=np.int64)
    last = steps - length
    return np.union1d(np.arange(0, last + 1, stride), [last]).astype(np.int64)


class WindowBatches:
    """Batches of windows, each built at once; the last batch may be smaller.

    Shuffled, the order is a function of the seed and of `epoch`, which is set before each epoch.
    """

    def __init__(self, windows: WindowDataset, size: int, *, shuffle: bool = False, seed: int = 0):
        """Takes the windows and the number of windows in a batch."""
        assert size >= 1
        self.windows, self.epoch = windows, 0
        self._size, self._shuffle, self._seed = size, shuffle, seed

    def __len__(self) -> int:
        """Number of batches."""
        return -(-len(self.windows) // self._size)

    def __iter__(self) -> Iterator[Batch]:
        """Gives the batches of the epoch."""
        order = np.arange(len(self.windows))
        if self._shuffle:
            order = generator(self._seed, self.epoch).permutation(order)
        for start in range(0, len(order), self._size):
            yield self.windows.batch(order[start : start + self._size].tolist())


def frame_batches(
    flights: PackedFlights, length: int, stride: int | None, size: int, seed: int
) -> tuple[WindowBatches, WindowBatches]:
    """Batches of windows with frames: shuffled ones to train on, and those for validation."""
    training, validation = (
        WindowDataset(flights, part, length, stride, frames=True)
        for part in ("training", "validation")
    )
    return (
        WindowBatches(training, size, shuffle=True, seed=seed),
        WindowBatches(validation, size),
    )
