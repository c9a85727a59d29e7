"""Sequence windows of packed flights, as a torch `Dataset` that builds whole batches at once."""

from __future__ import annotations

import math
import typing
from collections.abc import Iterator, Sequence

import numpy as np
import torch
from torch.utils.data import DataLoader, Dataset, Sampler

from proxops.systems.common import InputError, derived_seed, generator
from proxops.training.data import PARTS, PackedFlights, fill_frames, fill_hits, window_keys

# The paper's value for no return, of normalised frames too.
NO_RETURN = -100.0

Batch = dict[str, torch.Tensor]


class WindowDataset(Dataset[Batch]):
    """Windows of T steps in a row, none over the end of a flight.

    A window is a dict of tensors; a batch has one more axis in front. All are float32 but where
    it is said; vectors are in K, in SI or normalised.

    ```
    time           (T,)       s since the start of the flight, never normalised
    state          (T, 6)     position and velocity; privileged, a policy does not see it
    target         (T, 6)
    applied_force  (T, 3)     the force before the step: what the hold gives at it
    mpc_force      (T, 3)     the label; 0 where the MPC was not asked
    labelled       (T,)       bool: whether the MPC was asked
    kicked         (T,)       bool: whether a push from outside follows, up to the next step
    frames         (T, planes, rays)  if `frames`: ranges, `no_return` where none
    hit_ray        (T, K)     int32, if `hits`: plane * rays + ray in it, rising
    hit_range      (T, K)     if `hits`
    hit_mask       (T, K)     bool, if `hits`: whether there is a hit in this place
    ```

    Windows of a flight start every `stride` steps; one more ends with the flight, so that each of
    its steps is in a window. A flight shorter than a window has none.

    It can be indexed with a number, for one window, or with a list of numbers, for a batch.
    """

    def __init__(
        self,
        flights: PackedFlights,
        part: str,
        length: int,
        stride: int | None = None,
        *,
        frames: bool = False,
        hits: int | None = None,
        random_hits: bool = False,
        normalise: bool = True,
        no_return: float = NO_RETURN,
        seed: int = 0,
    ):
        """Chooses windows of a part, and what they hold.

        Args:
          part: `training`, `validation` or `test`.
          length: T, steps in a window.
          stride: steps from the start of a window to that of the next; None: T.
          frames: gives dense frames.
          hits: K, gives up to so many hits of each frame.
          random_hits: if there are more than K, takes a random choice of them, a function of
            (seed, epoch, window, step); otherwise evenly spread ones.
          normalise: with the constants of the training part; otherwise all is in SI.
          no_return: what frames say of rays that did not return.
          seed: of random hits.

        Raises:
          InputError: no such part, or no flight of it is as long as a window.
        """
        stride = length if stride is None else stride
        if part not in PARTS:
            raise InputError(f"there is no part {part!r}; choose from {', '.join(PARTS)}")
        if length < 1 or stride < 1 or (hits is not None and hits < 1):
            raise InputError(
                f"windows need a length, stride and hits of at least 1, got {length}, {stride}, "
                f"{hits}"
            )
        self.flights, self.length = flights, length
        self._frames, self._hits, self._random_hits = frames, hits, random_hits
        self._normalise, self._no_return, self._seed = normalise, no_return, seed
        # Shared, so that workers that live on from epoch to epoch see it change.
        self._epoch = torch.zeros((), dtype=torch.int64).share_memory_()
        chosen = flights.part(part)
        starts = [flight.start + _starts(flight.steps, length, stride) for flight in chosen]
        self.starts = np.concatenate([np.zeros(0, dtype=np.int64), *starts])
        if len(self.starts) == 0:
            longest = max((flight.steps for flight in chosen), default=0)
            raise InputError(
                f"{flights.folder}: the {part} part has {len(chosen)} flights, the longest of "
                f"{longest} steps; no window of {length} fits"
            )

    @property
    def epoch(self) -> int:
        """Set it before each epoch: random hits and the order of batches depend on it."""
        return int(self._epoch)

    @epoch.setter
    def epoch(self, value: int) -> None:
        self._epoch.fill_(value)

    def __len__(self) -> int:
        return len(self.starts)

    def __getitem__(self, index: int | Sequence[int]) -> Batch:
        if isinstance(index, int | np.integer):
            return {name: values[0] for name, values in self.batch([int(index)]).items()}
        return self.batch(index)

    def batch(self, indices: Sequence[int]) -> Batch:
        """Several windows at once, each tensor with the batch's axis in front."""
        items = np.asarray(indices, dtype=np.int64)
        if items.size and not (items.min() >= 0 and items.max() < len(self)):
            raise IndexError(f"windows are numbered from 0 to {len(self) - 1}")
        packed = self.flights
        rows = (self.starts[items][:, None] + np.arange(self.length)).ravel()
        label = packed.mpc_force[rows]
        labelled = ~np.isnan(label[:, 0])
        columns = {
            "time": packed.time[rows],
            "state": self._motion(packed.state[rows]),
            "target": self._motion(packed.target[rows]),
            "applied_force": self._force(packed.applied_force[rows]),
            "mpc_force": np.where(labelled[:, None], self._force(label), 0.0),
        }
        columns = {name: values.astype(np.float32) for name, values in columns.items()}
        columns |= {"labelled": labelled, "kicked": packed.kick[rows].any(axis=1)}
        mean, std = 0.0, 1.0
        if self._normalise:
            scale = packed.normalisation.range
            mean, std = scale.mean[0], scale.std[0]
        found = packed.offset, packed.ray, packed.range
        if self._frames:
            planes, rays = packed.setting.planes, packed.setting.rays
            frames = np.empty((len(rows), planes * rays), dtype=np.float32)
            fill_frames(rows, *found, self._no_return, mean, std, frames)
            columns["frames"] = frames.reshape(-1, planes, rays)
        if self._hits is not None:
            shape = len(rows), self._hits
            hits = {
                "hit_ray": np.empty(shape, dtype=np.int32),
                "hit_range": np.empty(shape, dtype=np.float32),
                "hit_mask": np.empty(shape, dtype=np.bool_),
            }
            keys = window_keys(derived_seed(self._seed, self.epoch), items, self.length)
            fill_hits(rows, keys, *found, self._random_hits, mean, std, *hits.values())
            columns |= hits
        return {
            name: torch.from_numpy(values.reshape(len(items), self.length, *values.shape[1:]))
            for name, values in columns.items()
        }

    def _motion(self, states: np.ndarray) -> np.ndarray:
        if not self._normalise:
            return states
        scales = self.flights.normalisation
        parts = [scales.position.apply(states[:, :3]), scales.velocity.apply(states[:, 3:])]
        return np.concatenate(parts, axis=1)

    def _force(self, forces: np.ndarray) -> np.ndarray:
        return self.flights.normalisation.force.apply(forces) if self._normalise else forces


def _starts(steps: int, length: int, stride: int) -> np.ndarray:
    """First steps of a flight's windows, rising."""
    if steps < length:
        return np.zeros(0, dtype=np.int64)
    last = steps - length
    return np.union1d(np.arange(0, last + 1, stride), [last]).astype(np.int64)


class _BatchSampler(Sampler[list[int]]):
    """Lists of windows; shuffled, the order is a function of (seed, epoch)."""

    def __init__(self, dataset: WindowDataset, batch_size: int, shuffle: bool, seed: int):
        self._dataset, self._batch_size = dataset, batch_size
        self._shuffle, self._seed = shuffle, seed

    def __len__(self) -> int:
        return -(-len(self._dataset) // self._batch_size)

    def __iter__(self) -> Iterator[list[int]]:
        order = np.arange(len(self._dataset))
        if self._shuffle:
            order = generator(self._seed, self._dataset.epoch).permutation(order)
        for start in range(0, len(order), self._batch_size):
            yield order[start : start + self._batch_size].tolist()


class WindowLoader(DataLoader[Batch]):
    """Batches of windows; `epoch` is the dataset's."""

    def __init__(self, windows: WindowDataset, **options: typing.Any):
        super().__init__(windows, **options)
        self._windows = windows

    @property
    def epoch(self) -> int:
        """As of `WindowDataset`."""
        return self._windows.epoch

    @epoch.setter
    def epoch(self, value: int) -> None:
        self._windows.epoch = value


def frame_loaders(
    flights: PackedFlights, length: int, stride: int | None, batch_size: int, seed: int
) -> tuple[WindowLoader, WindowLoader]:
    """Batches of windows with frames, in SI: shuffled ones to train on, and the validation part's.

    Rays that did not return are +inf, as a policy gets them in flight.
    """
    training, validation = (
        WindowDataset(
            flights, part, length, stride, frames=True, normalise=False, no_return=math.inf
        )
        for part in ("training", "validation")
    )
    return (
        window_loader(training, batch_size, shuffle=True, seed=seed),
        window_loader(validation, batch_size),
    )


def window_loader(
    dataset: WindowDataset,
    batch_size: int,
    *,
    shuffle: bool = False,
    seed: int = 0,
    workers: int = 0,
    **options: typing.Any,
) -> WindowLoader:
    """Batches of windows, each built in one call; `options` are `DataLoader`'s.

    Without workers batches are built in this process, which is fast enough unless frames are
    dense. Workers are spawned once and live on. The last batch may be smaller.
    """
    if batch_size < 1:
        raise InputError(f"a batch needs at least 1 window, got {batch_size}")
    if workers > 0:
        options |= {"multiprocessing_context": "spawn", "persistent_workers": True}
    return WindowLoader(
        dataset,
        # Lists of indices are handed to the dataset whole.
        sampler=_BatchSampler(dataset, batch_size, shuffle, seed),
        batch_size=None,
        num_workers=workers,
        **options,
    )
