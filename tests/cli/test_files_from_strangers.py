"""A file from somebody else is used or refused with a message; it runs, reads and fills nothing."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import onnx
import pytest
import torch
import xarray as xr
from onnx import TensorProto, helper
from synthetic_log import synthetic_log

from proxops.assets import ASSETS
from proxops.diagrams.logs import FlightLog
from proxops.diagrams.meshcat import write_replay
from proxops.diagrams.scenario import load_body, load_scenario, parse_scenario
from proxops.systems.common import InputError, open_session
from proxops.systems.lidar import LidarBundle
from proxops.systems.policy import PolicyBundle
from proxops.training.data.flight_columns import read_columns
from proxops.training.data.packed_flights import PackedFlights
from proxops.training.loop.checkpoints import load_checkpoint

# Nine lines that stand for 9^9 values.
BOMB = "".join(
    f"{name}: &{name} [{', '.join(9 * [f'*{before}' if before else '1.0'])}]\n"
    for before, name in zip(["", *"abcdefgh"], "abcdefghi", strict=True)
)
MERGES = "a: &a {x: 1}\n" + "".join(
    f"{name}: &{name} {{<<: [{', '.join(9 * [f'*{before}'])}]}}\n"
    for before, name in zip("abcdefgh", "bcdefghi", strict=True)
)
INNER = "".join("  " + line + "\n" for line in BOMB.splitlines())
DEEP = 100_000
LONGEST = 2500


def slowly(value: object) -> Any:
    """A value of a parameter that is tried with the slow tests alone."""
    return pytest.param(value, marks=pytest.mark.slow)


def refused(read: Callable[[], object], *words: str) -> None:
    with pytest.raises(InputError) as caught:
        read()
    message = str(caught.value)
    assert len(message) < LONGEST
    assert all(word in message for word in words), message


# --- YAML -----------------------------------------------------------------------------------------

YAML = {
    "alias bomb": (f"transit:\n{INNER}  start_m: *i\n", "alias"),
    "bomb of merged keys": (f"{MERGES}mpc: *i\n", "alias"),
    "Python function": ("body: !!python/object/apply:os.system ['touch ran']\n", "is not YAML"),
    "Python object": ("mpc: !!python/object:os.Popen {intervals: 3}\n", "cannot be"),
    "key twice": (
        "mpc: {intervals: 3}\nbody: kleopatra\nmpc: {}\n",
        "line 3: it has the key 'mpc' twice",
    ),
    "depth": ("transit: {start_m: " + 600 * "[" + 600 * "]" + "}\n", "too deeply"),
    "long text": (f"control_period_s: {10_000 * 'x'}\n", "control_period_s needs a number"),
    "very deep": ("transit: {start_m: " + 200_000 * "[" + "\n", "too deeply"),
    "number of 5000 digits": (f"control_period_s: {5000 * '1'}\n", "is not YAML"),
    "null byte in a path": ('body: "\\0.yaml"\n', "body must be a path"),
}


@pytest.mark.parametrize("what", YAML)
def test_hostile_scenario(what: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    text, word = YAML[what]
    refused(lambda: parse_scenario(text, "theirs"), "theirs", word)
    Path("theirs.yaml").write_text(text)
    refused(lambda: load_scenario("theirs.yaml"), "theirs.yaml", word)
    refused(lambda: load_body("theirs.yaml"), "theirs.yaml")
    assert [path.name for path in tmp_path.iterdir()] == ["theirs.yaml"]


# --- bundles --------------------------------------------------------------------------------------


def network(operator: str, domain: str = "", **attributes: Any) -> onnx.ModelProto:
    node = helper.make_node(operator, ["x"], ["y"], domain=domain, **attributes)
    x, y = (helper.make_tensor_value_info(name, TensorProto.FLOAT, [1, 3]) for name in "xy")
    graph = helper.make_graph([node], "theirs", [x], [y])
    domains = [helper.make_opsetid("", 18)]
    domains += [helper.make_opsetid(domain, 1)] if domain else []
    return helper.make_model(graph, opset_imports=domains, ir_version=9)


def network_with_weights_at(location: str) -> bytes:
    """Adds to its input three numbers that are in another file."""
    model = network("Identity")
    weights = TensorProto(name="w", data_type=TensorProto.FLOAT, dims=[1, 3])
    weights.data_location = TensorProto.EXTERNAL
    for key, value in {"location": location, "offset": "0", "length": "12"}.items():
        entry = weights.external_data.add()
        entry.key, entry.value = key, value
    model.graph.initializer.append(weights)
    model.graph.node[0].CopyFrom(helper.make_node("Add", ["x", "w"], ["y"]))
    return model.SerializeToString()


@pytest.mark.parametrize(
    "location", ["secret", "/secret", "../secret", "inner/../secret", "*/_ORT_MEM_ADDR_/*"]
)
def test_a_network_reads_no_other_file(
    location: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "inner").mkdir()
    (tmp_path / "secret").write_bytes(np.ones(3, dtype=np.float32).tobytes())
    monkeypatch.chdir(tmp_path)
    named = str(tmp_path / "secret") if location == "/secret" else location
    refused(lambda: open_session(network_with_weights_at(named)), "weights from other files")


@pytest.mark.parametrize(
    ("operator", "domain"), [("Run", "theirs"), ("PyOp", "ai.onnx.contrib"), ("Nothing", "")]
)
def test_a_network_has_built_in_operators_only(
    operator: str, domain: str, capfd: pytest.CaptureFixture[str]
) -> None:
    model = network(operator, domain).SerializeToString()
    refused(lambda: open_session(model), "not one that ONNX Runtime takes")
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize(
    "text",
    [DEEP * "[" + DEEP * "]", DEEP * '{"a":' + "1" + DEEP * "}", '{"planes": ' + 5000 * "1" + "}",
     b"\xff\xfe{}".decode("latin-1"), "[]", "null", "{}"],
    ids=["lists", "mappings", "digits", "bytes", "list", "null", "empty"],
)  # fmt: skip
def test_hostile_json(text: str, tmp_path: Path) -> None:
    folder = Path(shutil.copytree(ASSETS / "end_to_end", tmp_path / "bundle"))
    for name in ("policy.json", "bundle.json", "packed_flights.json"):
        (folder / name).write_text(text, encoding="latin-1")
    refused(lambda: PolicyBundle.load(folder), "policy.json is")
    refused(lambda: LidarBundle.load(folder), "bundle.json is")
    with pytest.raises(InputError):
        PackedFlights(folder)


# --- flight logs ----------------------------------------------------------------------------------


@cache
def unchanged() -> bytes:
    """The content of a log as it should be."""
    return bytes(synthetic_log(5, ranges=False).dataset.to_netcdf(engine="h5netcdf"))


def written(folder: Path, change: Callable[[xr.Dataset], xr.Dataset | None]) -> Path:
    """A log that was changed and written without a check."""
    dataset = synthetic_log(5, ranges=False).dataset.copy(deep=True)
    changed = change(dataset)
    path = folder / "flight.nc"
    (dataset if changed is None else changed).to_netcdf(path, engine="h5netcdf")
    return path


@pytest.mark.parametrize(
    "value",
    ["word", *map(slowly, (7, float("nan"), ["a", "b"]))],
)
@pytest.mark.parametrize(
    "name",
    ["scenario", "body", "controller", "shape_sha256", "arrival_time_s", "collided",
     "keep_out_violations", "wall_s", "scenario_sha256", "force_delay_s", "legend"],
)  # fmt: skip
def test_attributes_of_wrong_types(name: str, value: object, tmp_path: Path) -> None:
    """The log is refused, or its summary and its replay can be made."""
    path = tmp_path / "flight.nc"
    path.write_bytes(unchanged())
    with h5py.File(path, "a") as file:
        file.attrs[name] = value
    use_or_refuse(path)


@pytest.mark.parametrize(
    "value",
    [np.nan, slowly(77.0), slowly(1e300)],
    ids=["nan", "code", "huge"],
)
@pytest.mark.parametrize(
    "name",
    ["time", "state", "decision", "solve_status", "mesh_vertices", "mesh_facets"]
    + [
        *map(slowly, ("target", "force", "mpc_force", "policy_force", "solve_time", "solve_reason"))
    ],
)
def test_values_that_cannot_be(name: str, value: float, tmp_path: Path) -> None:
    def change(data: xr.Dataset) -> None:
        data[name] = xr.full_like(data[name], value, dtype=float)

    use_or_refuse(written(tmp_path, change))


@pytest.mark.parametrize("name", ["time", "state", "mesh_facets"])
@pytest.mark.parametrize("other", [("word", ["a", "b"]), (("a", "b", "c"), [[[1.0]]])])
def test_dimensions_that_cannot_be(name: str, other: tuple, tmp_path: Path) -> None:
    path = written(tmp_path, lambda data: data.drop_vars(name).assign({name: other}))
    with pytest.raises(InputError, match=r"flight\.nc"):
        FlightLog.load(path)


def use_or_refuse(path: Path) -> None:
    try:
        log = FlightLog.load(path)
        assert isinstance(log.summary, dict)
        write_replay(log, path.with_name("replay.html"))
    except InputError as error:
        assert len(str(error)) < LONGEST  # noqa: PT017 (either outcome is right)


def test_a_log_brings_its_body_and_reads_none(tmp_path: Path) -> None:
    """Its scenario may name any path as the body."""
    (tmp_path / "theirs.yaml").write_text("no body")

    def change(data: xr.Dataset) -> None:
        text = data.attrs["scenario"]
        assert "body: kleopatra" in text
        data.attrs["scenario"] = text.replace("kleopatra", str(tmp_path / "theirs.yaml"))

    log = FlightLog.load(written(tmp_path, change))
    assert log.scenario.body == str(tmp_path / "theirs.yaml")
    assert log.summary["steps"] == 5
    write_replay(log, tmp_path / "replay.html")


def in_a_link(file: h5py.File, other: Path) -> None:
    del file["wall"]
    file["wall"] = h5py.ExternalLink(str(other), "secret")


def in_raw_bytes(file: h5py.File, other: Path) -> None:
    del file["wall"]
    file.create_dataset("wall", (8,), "u1", external=[(str(other), 0, 8)])


def in_a_virtual_array(file: h5py.File, other: Path) -> None:
    del file["wall"]
    layout = h5py.VirtualLayout((8,), "u1")
    layout[:] = h5py.VirtualSource(str(other), "secret", (8,))
    file.create_virtual_dataset("wall", layout)


def opaque() -> h5py.h5t.TypeID:
    """A type that h5py reads as addresses of Python's objects: reading it would end the process."""
    kind = h5py.h5t.create(h5py.h5t.OPAQUE, 8)
    kind.set_tag(b"NUMPY:|O")
    return kind


def of_opaque_bytes(file: h5py.File, other: Path) -> None:
    del file["wall"]
    h5py.h5d.create(file.id, b"wall", opaque(), h5py.h5s.create_simple((3,)))


def with_an_opaque_attribute(file: h5py.File, other: Path) -> None:
    h5py.h5a.create(file.id, b"wall", opaque(), h5py.h5s.create_simple((3,)))


@pytest.mark.parametrize(
    ("change", "why"),
    [
        (in_a_link, "wall is a link"),
        (in_raw_bytes, "wall is in another file"),
        (in_a_virtual_array, "wall is in another file"),
        (of_opaque_bytes, "wall has opaque bytes"),
        (with_an_opaque_attribute, "an attribute of opaque bytes"),
    ],
)
def test_a_log_holds_its_data_itself(change: Callable, why: str, tmp_path: Path) -> None:
    path = written(tmp_path, lambda data: data.assign(wall=("wall_row", np.zeros(8))))
    with h5py.File(tmp_path / "secret.nc", "w") as file:
        file["secret"] = np.ones(8, dtype="u1")
    with h5py.File(path, "r+") as file:
        change(file, tmp_path / "secret.nc")
    refused(lambda: FlightLog.load(path), "is not a flight log", why)
    refused(lambda: read_columns(path), "is not a flight log", why)


# --- training -------------------------------------------------------------------------------------


class Runs:
    """Pickles to a call that makes a file."""

    def __init__(self, path: Path):
        self.path = path

    def __reduce__(self) -> tuple:
        return Path.touch, (self.path,)


def test_a_checkpoint_runs_nothing(tmp_path: Path) -> None:
    torch.save({"identity": "mine", "network": Runs(tmp_path / "ran")}, tmp_path / "a.ckpt")
    refused(lambda: load_checkpoint(tmp_path / "a.ckpt", "mine"), "is not a checkpoint")
    assert not (tmp_path / "ran").exists()
    torch.load(tmp_path / "a.ckpt", weights_only=False)
    assert (tmp_path / "ran").exists()  # So the test would have seen it.
