"""Windows hold the steps they should and lie within one flight; batches come in order."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
import xarray as xr
from flight_folders import copy_flights

from proxops.systems import InputError
from proxops.training.data import PackedFlights, pack_flights
from proxops.training.loop import WindowBatches, WindowDataset


def row_of(packed: PackedFlights, state: torch.Tensor) -> int:
    """The row of the packed set that holds a state; states do not repeat."""
    (rows,) = np.nonzero((packed.state.astype(np.float32) == state.numpy()).all(axis=1))
    assert len(rows) == 1
    return int(rows[0])


def dense(packed: PackedFlights, row: int) -> np.ndarray:
    """A frame (4320,) from the packed hits, put in place one by one."""
    frame = np.full(4320, np.inf, dtype=np.float32)
    for hit in range(packed.offset[row], packed.offset[row + 1]):
        frame[packed.ray[hit]] = packed.range[hit]
    return frame


# --- which steps ----------------------------------------------------------------------------------


@pytest.mark.parametrize(("length", "stride"), [(1, 1), (4, None), (5, 2)])
@pytest.mark.parametrize("part", ["training", "validation", "test"])
def test_windows_cover_each_flight_and_stay_in_it(
    packed: PackedFlights, part: str, length: int, stride: int | None
) -> None:
    windows = WindowDataset(packed, part, length, stride)
    owner = np.repeat(np.arange(len(packed.flights)), [each.steps for each in packed.flights])
    seen = np.zeros(len(packed), dtype=int)
    for window in (windows[k] for k in range(len(windows))):
        rows = np.array([row_of(packed, state) for state in window["state"]])
        assert len(rows) == length
        assert (np.diff(rows) == 1).all()
        assert len(set(owner[rows])) == 1
        seen[rows] += 1
    inside = np.array([packed.flights[k].part == part for k in owner])
    assert not seen[~inside].any()
    if (stride or length) <= length:
        assert seen[inside].min() > 0
    for flight in packed.part(part):  # The end is never left out.
        assert seen[flight.start] == 1 or flight.steps == length
        assert seen[flight.start + flight.steps - 1] > 0


@pytest.mark.parametrize(
    ("part", "options", "message"),
    [
        ("train", {"length": 5}, "there is no part 'train'; choose from training, validation"),
        ("training", {"length": 0}, "of at least 1"),
        ("training", {"length": 99}, "no window of 99 fits"),
    ],
)
def test_windows_that_cannot_be(
    packed: PackedFlights, part: str, options: dict[str, Any], message: str
) -> None:
    with pytest.raises(InputError, match=message):
        WindowDataset(packed, part, **options)


# --- what they hold -------------------------------------------------------------------------------


def test_labels_that_are_missing(tmp_path: Path) -> None:
    logs = copy_flights(tmp_path)
    packed = pack_flights(logs)
    name = packed.part("training")[0].name
    data = xr.load_dataset(logs / name, engine="h5netcdf")
    data["mpc_force"][4:6] = np.nan
    data.to_netcdf(logs / name, engine="h5netcdf")
    window = WindowDataset(pack_flights(logs), "training", 15)[0]
    assert np.nonzero(~window["labelled"].numpy())[0].tolist() == [4, 5]
    assert not window["mpc_force"][4:6].any()
    assert all(torch.isfinite(values).all() for values in window.values())


def test_dense_frames(packed: PackedFlights) -> None:
    windows = WindowDataset(packed, "training", 5, 4, frames=True)
    rows = windows.starts[7] + np.arange(5)
    frames = windows[7]["frames"]
    assert frames.shape == (5, 12, 360)
    assert frames.dtype == torch.float32
    wanted = np.stack([dense(packed, row) for row in rows])
    np.testing.assert_array_equal(frames.reshape(5, -1), wanted)


def everything(packed: PackedFlights) -> WindowDataset:
    return WindowDataset(packed, "training", 5, 2, frames=True)


def test_a_batch_is_its_windows(packed: PackedFlights) -> None:
    windows = everything(packed)
    batch = windows[[5, 0, 5]]
    for name, values in batch.items():
        single = torch.stack([windows[5][name], windows[0][name], windows[5][name]])
        assert torch.equal(values, single), name


# --- batches --------------------------------------------------------------------------------------


def test_shuffled_epochs(packed: PackedFlights) -> None:
    windows = WindowDataset(packed, "training", 3)

    def order(epoch: int, seed: int = 0) -> list[int]:
        batches = WindowBatches(windows, 4, shuffle=True, seed=seed)
        batches.epoch = epoch
        return [row_of(packed, state) for batch in batches for state in batch["state"][:, 0]]

    first = order(0)
    assert sorted(first) == sorted(windows.starts.tolist())
    assert first != sorted(first)
    assert order(1) != first
    assert order(0, seed=1) != first
    assert order(0) == first
