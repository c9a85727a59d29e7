"""The README's Python on logs and training data runs as it is printed."""

import re
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from flight_folders import copy_flights
from known_policies import DeadReckoning, write_policy
from synthetic_log import synthetic_log

from proxops.cli.main import main

FLAGS = re.DOTALL | re.MULTILINE
README = (Path(__file__).parents[1] / "README.md").read_text()


def snippets(heading: str) -> list[str]:
    """The Python blocks of a section, in order."""
    (section,) = re.findall(rf"^## {heading}\n(.*?)(?=^## )", README, FLAGS)
    return re.findall(r"^```python\n(.*?)^```", section, re.DOTALL | re.MULTILINE)


def run(code: str) -> dict[str, Any]:
    names: dict[str, Any] = {}
    exec(compile(code, "README.md", "exec"), names)
    return names


@pytest.fixture
def working_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "out" / "flight").mkdir(parents=True)
    return tmp_path


def test_xarray(working_folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log = synthetic_log()
    log.to_netcdf(working_folder / "out/flight/flight.nc")
    (code,) = [code for code in snippets("Reading a log") if "import xarray" in code]
    names = run(code)
    data = log.dataset
    speed = np.linalg.norm(data["state"].values[:, 3:], axis=1)
    np.testing.assert_allclose(names["speed"], speed)
    hits = np.isfinite(data["ranges"].values).sum(axis=(1, 2))
    np.testing.assert_array_equal(names["hits"], hits)
    assert capsys.readouterr().out.split() == [
        "hybrid",
        str(speed.max()),
        str(int(np.median(hits))),
    ]


def test_h5py(working_folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log = synthetic_log()
    log.to_netcdf(working_folder / "out/flight/flight.nc")
    (code,) = [code for code in snippets("Reading a log") if "import h5py" in code]
    names = run(code)
    data = log.dataset
    np.testing.assert_array_equal(names["time"], data["time"])
    np.testing.assert_array_equal(names["position"], data["state"][:, :3])
    np.testing.assert_array_equal(names["frame"], data["ranges"][100])
    assert names["scenario"] == data.attrs["scenario"]
    returns = int(np.isfinite(data["ranges"][100]).sum())
    assert capsys.readouterr().out == f"4800 s, {returns} returns at 1000 s\n"


def test_matlab_dimensions_are_reversed(working_folder: Path) -> None:
    """MATLAB is not run: its sizes, as printed, are the file's in reverse."""
    import h5py

    log = synthetic_log()
    log.to_netcdf(working_folder / "out/flight/flight.nc")
    (code,) = re.findall(r"^```matlab\n(.*?)^```", README, re.DOTALL | re.MULTILINE)
    printed = re.findall(r"'/(\w+)'\); +% ([\dN x]+),", code)
    assert [name for name, _ in printed] == ["time", "state", "ranges"]
    with h5py.File("out/flight/flight.nc") as file:
        for name, sizes in printed:
            variable = file[name]
            assert isinstance(variable, h5py.Dataset)
            shape = [str(size) for size in variable.shape[::-1]] + ["1"] * (variable.ndim == 1)
            assert sizes.replace("N", "481").split(" x ") == shape
            assert variable.dtype.kind == "f"


@pytest.mark.slow
def test_evaluating_controllers(working_folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The command runs as it is printed, on one brief transit, and leaves what it says."""
    write_policy(working_folder / "out" / "policy", DeadReckoning())
    (section,) = re.findall(r"^## Evaluating controllers\n(.*?)(?=^## )", README, FLAGS)
    (command,) = re.findall(r"^(proxops evaluate .*)$", section, re.MULTILINE)
    short = command.replace("--transits 50", "--transits 1")
    assert short != command
    brief = "--workers 1 --set arrival.deadline_s=50 --set arrival.dwell_s=50"
    monkeypatch.setattr(sys, "argv", f"{short} {brief}".split())
    with pytest.raises(SystemExit) as end:
        main()
    assert not end.value.code
    for line in re.findall(r"^\| (`.*?) \|", section, re.MULTILINE):
        for name in re.findall("`(.*?)`", line):
            assert (working_folder / "out" / "evaluation" / name).exists()


def test_training_data(working_folder: Path) -> None:
    copy_flights(working_folder / "out").rename(working_folder / "out" / "flights")
    (code,) = snippets("Training data")
    short = code.replace("length=32, stride=16", "length=8, stride=4")
    assert short != code  # The flights of the tests are not that long.
    names = run(short)
    count = min(64, len(names["windows"]))
    assert names["windows"].epoch == 1
    assert names["hits"].shape == (count, 8, 128)
    assert names["force"].shape == (count, 8, 3)
    assert torch.isfinite(names["force"]).all()
