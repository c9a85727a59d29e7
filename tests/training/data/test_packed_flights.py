"""Packed flights hold what the logs hold, follow the logs' changes, and say what is damaged."""

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import xarray as xr
from exported_once import change_json
from flight_folders import FLIGHTS, copy_flights, flight

from proxops.diagrams.scenario.scenario import dump_scenario, parse_scenario
from proxops.systems import InputError
from proxops.training.data import PackedFlights, pack_flights
from proxops.training.data.packed_flights import INDEX


@pytest.fixture
def logs(tmp_path: Path) -> Path:
    return copy_flights(tmp_path)


@pytest.fixture
def packed_logs(logs: Path, packed: PackedFlights) -> Path:
    """Logs beside what packing them made."""
    shutil.copytree(packed.folder, logs / "packed")
    return logs


def rows_of(packed: PackedFlights, name: str) -> np.ndarray:
    (entry,) = [each for each in packed.flights if each.name == f"{name}.nc"]
    return np.arange(entry.start, entry.start + entry.steps)


# --- what is in it --------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["a-0", "a-4"])
def test_columns_are_the_logs(packed: PackedFlights, name: str) -> None:
    log, rows = flight(name).dataset, rows_of(packed, name)
    assert len(rows) == flight(name).summary["steps"]
    for column in ("time", "state", "target", "mpc_force"):
        np.testing.assert_array_equal(getattr(packed, column)[rows], log[column][: len(rows)])


@pytest.mark.parametrize("name", ["a-0", "a-4"])
def test_frames_are_the_logs(packed: PackedFlights, name: str) -> None:
    rows = rows_of(packed, name)
    frames = packed.frames(rows)
    assert frames.dtype == np.float32
    np.testing.assert_array_equal(frames, flight(name).dataset["ranges"][: len(rows)])
    np.testing.assert_array_equal(packed.frames(rows[[7, 2]]), frames[[7, 2]])


@pytest.mark.parametrize("name", ["a-0", "a-4"])
def test_commanded_force_is_that_before_the_step(packed: PackedFlights, name: str) -> None:
    rows = rows_of(packed, name)
    data = flight(name).dataset
    force = np.clip(data["force"].values - data["disturbance"].values, -7.0, 7.0)
    np.testing.assert_array_equal(packed.commanded_force[rows[1:]], force[: len(rows) - 1])
    assert not packed.commanded_force[rows[0]].any()


def test_command_and_disturbance_explain_the_motion(packed: PackedFlights) -> None:
    """Velocity changes by them, gravity and the turning frame's forces aside: these vary slowly."""
    rows = rows_of(packed, "a-4")
    change = np.diff(packed.state[rows, 3:], axis=0) / 10.0
    force = packed.commanded_force[rows].copy()
    force[1:] += flight("a-4").dataset["disturbance"].values[: len(rows) - 1]
    rest = change - force[1:] / 100.0
    shifted = change[:-1] - force[2:] / 100.0
    assert np.abs(np.diff(rest, axis=0)).max() < 1e-3
    assert np.abs(np.diff(shifted, axis=0)).max() > 5e-3


def test_normalisation_is_of_the_training_part(packed: PackedFlights) -> None:
    rows = np.concatenate([rows_of(packed, each.name[:-3]) for each in packed.part("training")])
    assert 0 < len(rows) < len(packed)
    label = packed.mpc_force[rows]
    frames = packed.frames(rows).astype(np.float64)
    for scale, values in (
        (packed.normalisation.position, packed.state[rows, :3]),
        (packed.normalisation.velocity, packed.state[rows, 3:]),
        (packed.normalisation.force, label[np.isfinite(label[:, 0])]),
        (packed.normalisation.range, frames[np.isfinite(frames)][:, None]),
    ):
        np.testing.assert_allclose(scale.mean, values.mean(axis=0), rtol=1e-12)
        np.testing.assert_allclose(scale.std, values.std(axis=0), rtol=1e-9)


# --- when it is made ------------------------------------------------------------------------------


def test_follows_a_change_that_keeps_the_size(logs: Path) -> None:
    before = pack_flights(logs)
    path, size = logs / "a-2.nc", (logs / "a-2.nc").stat().st_size
    with h5py.File(path, "a") as file:
        state = file["state"]
        assert isinstance(state, h5py.Dataset)
        state[3, 0] = 1.5e5
    assert path.stat().st_size == size
    after = pack_flights(logs)
    changed = np.argwhere(after.state != before.state)
    assert changed.tolist() == [[rows_of(after, "a-2")[3], 0]]
    assert after.state[changed[0][0], 0] == 1.5e5


def test_until_the_new_set_is_whole_the_old_one_is_there(logs: Path) -> None:
    before, seen = pack_flights(logs).logs_sha256, []
    (logs / "b-5.nc").unlink()

    def told(done: float, text: str) -> None:
        seen.append(PackedFlights(logs / "packed").logs_sha256)

    after = pack_flights(logs, progress=told)
    assert len(seen) > 2
    assert set(seen) == {before}
    assert len(after.flights) == len(FLIGHTS) - 1


def test_leftovers_of_a_killed_process_are_cleared(logs: Path) -> None:
    (logs / ".packed.abcd.folder").mkdir()
    (logs / ".packed.abcd.folder" / "state.bin").write_bytes(b"half")
    pack_flights(logs)
    assert not list(logs.glob(".packed.*.folder"))


def test_the_folder_above_the_logs(logs: Path) -> None:
    """`proxops collect` writes logs into `flights` of its folder."""
    assert logs.name == "flights"
    with pytest.raises(InputError, match=f"give {logs}"):
        pack_flights(logs.parent)


def test_no_training_flights(logs: Path) -> None:
    for each in pack_flights(logs).part("training"):
        (logs / each.name).unlink()
    with pytest.raises(InputError, match="none of its transits is of the training part"):
        pack_flights(logs)


# --- what is refused ------------------------------------------------------------------------------


Change = Callable[[xr.Dataset], xr.Dataset]


def with_values(name: str, place: Any, value: float) -> Change:
    def change(data: xr.Dataset) -> xr.Dataset:
        values = data[name].values.copy()
        values[place] = value
        return data.assign({name: (data[name].dims, values)})

    return change


def with_another_range(data: xr.Dataset) -> xr.Dataset:
    scenario = parse_scenario(data.attrs["scenario"])
    scenario.lidar.max_range_m = 1e5
    return data.assign_attrs(scenario=dump_scenario(scenario))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda data: data.drop_vars(["target", "ranges"]), "it has no target, ranges"),
        (lambda data: data.isel(component=slice(5)), r"state has the shape \(16, 5\)"),
        (lambda data: data.isel(time=slice(0)), r"time has the shape \(0,\)"),
        (with_values("time", 5, 51.0), "time is not a multiple of the control period, 10 s,"),
        (with_values("state", (3, 2), np.nan), "state is not finite at row 3 of 16"),
        (with_values("ranges", (6, 1, 7), -5.0), "ranges is negative or NaN at row 6"),
        (with_values("mpc_force", (3, 1), np.nan), "mpc_force is NaN on some axes only at row 3"),
        (with_another_range, r"differ in max_range_m \(100000.0 and 350000.0\)"),
        (lambda data: data.assign_attrs(shape_sha256="0" * 64), "differ in shape_sha256"),
        (lambda data: data.assign_attrs(scenario="nonsense: 1"), "the scenario in it: .*nonsense"),
    ],
)
def test_a_log_that_does_not_fit(logs: Path, change: Change, message: str) -> None:
    change(flight("a-1").dataset).to_netcdf(logs / "a-1.nc", engine="h5netcdf")
    with pytest.raises(InputError, match=rf"a-1\.nc.*{message}"):
        pack_flights(logs)


def test_damaged_frames(logs: Path) -> None:
    path = logs / "a-1.nc"
    with h5py.File(path) as file:
        frames = file["ranges"]
        assert isinstance(frames, h5py.Dataset)
        place = frames.id.get_chunk_info(0).byte_offset
    content = bytearray(path.read_bytes())
    content[place + 10 : place + 60] = bytes(50)
    path.write_bytes(content)
    with pytest.raises(InputError, match=r"a-1\.nc: ranges cannot be read"):
        pack_flights(logs)


# --- a damaged cache ------------------------------------------------------------------------------


def cut(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:-9])


@pytest.mark.parametrize(("damage", "name"), [(cut, "state.bin"), (Path.unlink, "offset.bin")])
def test_a_damaged_column(packed_logs: Path, damage: Callable[[Path], None], name: str) -> None:
    before = PackedFlights(packed_logs / "packed")
    content = (before.folder / name).read_bytes()
    damage(before.folder / name)
    with pytest.raises(InputError, match="or it is damaged"):
        PackedFlights(before.folder)
    again = pack_flights(packed_logs)
    assert (again.folder / name).read_bytes() == content


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"schema": 1}, "is of version 1, not 4"),
        ({"setting": {"planes": 12}}, "missing 7 required"),
        ({"flights": []}, "do not fit together"),
    ],
)
def test_a_damaged_index(packed_logs: Path, change: dict[str, object], message: str) -> None:
    path = PackedFlights(packed_logs / "packed").folder / INDEX
    change_json(path, **change)
    with pytest.raises(InputError, match=message):
        PackedFlights(path.parent)
