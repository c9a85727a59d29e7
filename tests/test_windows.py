"""Windows hold the steps they should, never straddle flights, and choose hits as they say."""

import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
import xarray as xr
from flight_folders import copy_flights
from torch.utils.data import DataLoader

from proxops.systems import InputError
from proxops.training.data import PackedFlights, pack_flights
from proxops.training.data.window_kernels import fill_hits, window_keys
from proxops.training.loop import WindowDataset, window_loader


@pytest.fixture(scope="module")
def packed(tmp_path_factory: pytest.TempPathFactory) -> PackedFlights:
    return pack_flights(copy_flights(tmp_path_factory.mktemp("windows")))


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


@pytest.mark.parametrize(("length", "stride"), [(1, 1), (4, None), (5, 2), (7, 20), (13, 5)])
@pytest.mark.parametrize("part", ["training", "validation", "test"])
def test_windows_cover_each_flight_and_stay_in_it(
    packed: PackedFlights, part: str, length: int, stride: int | None
) -> None:
    windows = WindowDataset(packed, part, length, stride, normalise=False)
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


def test_number_of_windows(packed: PackedFlights) -> None:
    steps = [flight.steps for flight in packed.part("training")]
    assert set(steps) == {15, 19}
    # Flights of 15: from 0, 4, 8 and, to the end, 10; of 19: from 0, 4, 8, 12 and 14.
    wanted = sum({15: 4, 19: 5}[count] for count in steps)
    assert len(WindowDataset(packed, "training", 5, 4)) == wanted
    # Only flights that are long enough have windows.
    assert len(WindowDataset(packed, "training", 17, 1)) == 3 * steps.count(19)


@pytest.mark.parametrize(
    ("part", "options", "message"),
    [
        ("train", {"length": 5}, "there is no part 'train'; choose from training, validation"),
        ("training", {"length": 0}, "of at least 1"),
        ("training", {"length": 5, "stride": 0}, "of at least 1"),
        ("training", {"length": 5, "hits": 0}, "of at least 1"),
        ("training", {"length": 99}, "no window of 99 fits"),
    ],
)
def test_windows_that_cannot_be(
    packed: PackedFlights, part: str, options: dict[str, Any], message: str
) -> None:
    with pytest.raises(InputError, match=message):
        WindowDataset(packed, part, **options)


def test_no_such_window(packed: PackedFlights) -> None:
    windows = WindowDataset(packed, "training", 5)
    for index in (-1, len(windows)):
        with pytest.raises(IndexError, match="numbered from 0"):
            windows[index]


# --- what they hold -------------------------------------------------------------------------------


def test_columns_in_si(packed: PackedFlights) -> None:
    windows = WindowDataset(packed, "training", 6, 3, normalise=False)
    batch = windows.batch([3, 0])
    for k in range(2):
        rows = [row_of(packed, state) for state in batch["state"][k]]
        for name in ("time", "state", "target", "applied_force", "mpc_force"):
            wanted = getattr(packed, name)[rows].astype(np.float32)
            assert batch[name].dtype == torch.float32
            np.testing.assert_array_equal(batch[name][k], wanted)
        assert batch["labelled"][k].all()
        assert not batch["kicked"][k].any()


def test_columns_normalised(packed: PackedFlights) -> None:
    plain = WindowDataset(packed, "test", 6, normalise=False).batch([0, 1])
    batch = WindowDataset(packed, "test", 6).batch([0, 1])
    scales = packed.normalisation
    for name in ("state", "target"):
        position, velocity = batch[name].double().numpy()[..., :3], batch[name].double()[..., 3:]
        np.testing.assert_allclose(
            scales.position.undo(position), plain[name][..., :3], rtol=1e-5, atol=1e-2
        )
        np.testing.assert_allclose(
            scales.velocity.undo(velocity.numpy()), plain[name][..., 3:], rtol=1e-5, atol=1e-5
        )
    for name in ("applied_force", "mpc_force"):
        values = scales.force.undo(batch[name].double().numpy())
        np.testing.assert_allclose(values, plain[name], rtol=1e-5, atol=1e-5)
    np.testing.assert_array_equal(batch["time"], plain["time"])


def test_training_part_is_of_zero_mean_and_unit_spread(packed: PackedFlights) -> None:
    windows = WindowDataset(packed, "training", 1, 1, frames=True)
    batch = windows.batch(range(len(windows)))
    hits = batch["frames"][batch["frames"] != -100.0].double()
    for values in (batch["state"][..., 3:].double().flatten(0, 1), hits[:, None]):
        np.testing.assert_allclose(values.mean(0), 0.0, atol=1e-4)
        np.testing.assert_allclose(values.std(0, correction=0), 1.0, rtol=1e-4)


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
    for normalise in (False, True):
        windows = WindowDataset(packed, "training", 5, 4, frames=True, normalise=normalise)
        rows = windows.starts[7] + np.arange(5)
        frames = windows[7]["frames"]
        assert frames.shape == (5, 12, 360)
        assert frames.dtype == torch.float32
        wanted = np.stack([dense(packed, row) for row in rows]).astype(np.float64)
        if normalise:
            (mean,), (std,) = packed.normalisation.range.mean, packed.normalisation.range.std
            wanted = (wanted - mean) / std
        wanted[np.isinf(wanted)] = -100.0
        np.testing.assert_allclose(frames.reshape(5, -1), wanted, rtol=1e-6, atol=1e-7)


def test_frames_in_si_are_exact(packed: PackedFlights) -> None:
    windows = WindowDataset(packed, "training", 5, frames=True, normalise=False)
    frames = windows[0]["frames"].numpy()
    wanted = packed.frames(windows.starts[0] + np.arange(5))
    np.testing.assert_array_equal(frames, np.where(np.isinf(wanted), np.float32(-100.0), wanted))


# --- hits -----------------------------------------------------------------------------------------


def hits_of(packed: PackedFlights, row: int) -> tuple[np.ndarray, np.ndarray]:
    hits = slice(packed.offset[row], packed.offset[row + 1])
    return packed.ray[hits], packed.range[hits]


def test_all_hits_if_there_is_room(packed: PackedFlights) -> None:
    for random in (False, True):
        windows = WindowDataset(
            packed, "training", 5, hits=2000, random_hits=random, normalise=False
        )
        window = windows[2]
        for step, row in enumerate(windows.starts[2] + np.arange(5)):
            rays, ranges = hits_of(packed, row)
            count = len(rays)
            assert window["hit_mask"][step].sum() == count
            np.testing.assert_array_equal(window["hit_ray"][step, :count], rays)
            np.testing.assert_array_equal(window["hit_range"][step, :count], ranges)
            assert not window["hit_mask"][step, count:].any()
            assert not window["hit_ray"][step, count:].any()
            assert not window["hit_range"][step, count:].any()


@pytest.mark.parametrize("room", [1, 7, 64])
@pytest.mark.parametrize("random", [False, True])
def test_some_of_many_hits(packed: PackedFlights, room: int, random: bool) -> None:
    windows = WindowDataset(packed, "training", 5, hits=room, random_hits=random, normalise=False)
    window = windows[1]
    for step, row in enumerate(windows.starts[1] + np.arange(5)):
        rays, ranges = hits_of(packed, row)
        assert len(rays) > room
        assert window["hit_mask"][step].all()
        chosen = window["hit_ray"][step].numpy()
        assert (np.diff(chosen) > 0).all()
        places = np.searchsorted(rays, chosen)
        np.testing.assert_array_equal(rays[places], chosen)
        np.testing.assert_array_equal(ranges[places], window["hit_range"][step])
        if not random:  # Evenly: one from the middle of each of `room` equal portions.
            portions = (np.arange(room) + 0.5) * len(rays) / room
            np.testing.assert_array_equal(places, np.floor(portions))


def test_random_hits_depend_on_seed_epoch_window_and_step(packed: PackedFlights) -> None:
    def chosen(seed: int = 0, epoch: int = 0, batch: tuple[int, ...] = (1, 4)) -> np.ndarray:
        windows = WindowDataset(packed, "training", 5, hits=8, random_hits=True, seed=seed)
        windows.epoch = epoch
        return windows.batch(batch)["hit_ray"].numpy()

    first = chosen()
    np.testing.assert_array_equal(first, chosen())
    np.testing.assert_array_equal(first[1:], chosen(batch=(4,)))
    assert (first != chosen(seed=1)).any(axis=2).all()
    assert (first != chosen(epoch=1)).any(axis=2).all()
    even = WindowDataset(packed, "training", 5, hits=8)
    even.epoch = 1
    np.testing.assert_array_equal(
        even[1]["hit_ray"], WindowDataset(packed, "training", 5, hits=8)[1]["hit_ray"]
    )


def test_random_hits_are_drawn_alike() -> None:
    """Each of the 10 pairs of 5 hits is as likely: chi-square over 20,000 draws."""
    draws, hits, room = 20_000, 5, 2
    shape = draws, room
    ray, ranges = np.arange(hits, dtype=np.uint16), np.ones(hits, dtype=np.float32)
    offset = np.array([0, hits])
    hit_ray, mask = np.empty(shape, dtype=np.int32), np.empty(shape, dtype=np.bool_)
    keys = window_keys(7, np.arange(draws // 20), 20)
    assert len(np.unique(keys)) == draws
    rows = np.zeros(draws, dtype=np.int64)
    found = hit_ray, np.empty(shape, dtype=np.float32), mask
    fill_hits(rows, keys, offset, ray, ranges, True, 0.0, 1.0, *found)
    assert mask.all()
    counts = np.bincount(hit_ray[:, 0] * hits + hit_ray[:, 1], minlength=hits * hits)
    counts = counts.reshape(hits, hits)[np.triu_indices(hits, 1)]
    assert counts.sum() == draws
    expected = draws / 10
    assert ((counts - expected) ** 2 / expected).sum() < 27.9  # 9 degrees of freedom: 1 in 1,000


# --- batches --------------------------------------------------------------------------------------


def everything(packed: PackedFlights) -> WindowDataset:
    return WindowDataset(packed, "training", 5, 2, frames=True, hits=16, random_hits=True)


def test_a_batch_is_its_windows(packed: PackedFlights) -> None:
    windows = everything(packed)
    batch = windows[[5, 0, 5]]
    for name, values in batch.items():
        single = torch.stack([windows[5][name], windows[0][name], windows[5][name]])
        assert torch.equal(values, single), name


def test_torch_s_own_loader_gives_the_same(packed: PackedFlights) -> None:
    windows = everything(packed)
    plain = list(DataLoader(windows, batch_size=8))
    ours = list(window_loader(windows, 8))
    assert len(plain) == len(ours) == len(window_loader(windows, 8)) > 1
    for one, other in zip(plain, ours, strict=True):
        assert all(torch.equal(one[name], other[name]) for name in one)


def test_shuffled_epochs(packed: PackedFlights) -> None:
    windows = WindowDataset(packed, "training", 3, normalise=False)

    def order(epoch: int, **options: int) -> list[int]:
        windows.epoch = epoch
        batches = list(window_loader(windows, 4, shuffle=True, **options))
        return [row_of(packed, state) for batch in batches for state in batch["state"][:, 0]]

    first = order(0)
    assert sorted(first) == sorted(windows.starts.tolist())
    assert first != sorted(first)
    assert order(1) != first
    assert order(0, seed=1) != first
    assert order(0) == first


def test_pickled(packed: PackedFlights) -> None:
    windows = everything(packed)
    windows.epoch = 3
    text = pickle.dumps(windows)
    assert len(text) < 5000
    again = pickle.loads(text)
    assert again.epoch == 3
    for name, values in windows.batch([0, 3]).items():
        assert torch.equal(again.batch([0, 3])[name], values), name


@pytest.mark.slow
def test_spawned_workers_give_the_same_epoch_after_epoch(packed: PackedFlights) -> None:
    windows = everything(packed)
    alone = window_loader(windows, 8, shuffle=True)
    shared = window_loader(windows, 8, shuffle=True, workers=2)
    for epoch in (0, 1):
        windows.epoch = epoch
        for one, other in zip(alone, shared, strict=True):
            assert all(torch.equal(one[name], other[name]) for name in one)
