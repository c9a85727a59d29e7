"""What the README prints runs: its Python as it stands, its commands in brief form."""

import re
import shlex
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from contact_binary import contact_binary
from flight_folders import copy_flights
from known_policies import DeadReckoning, write_policy
from synthetic_log import synthetic_log
from typer.main import get_command

from proxops.cli.main import app, main

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


def test_training_data(working_folder: Path) -> None:
    copy_flights(working_folder / "out").rename(working_folder / "out" / "flights")
    (code,) = snippets("Training data")
    short = code.replace("length=32, stride=16", "length=8, stride=4")
    assert short != code  # The flights of the tests are not that long.
    names = run(short)
    count = min(64, len(names["windows"]))
    assert names["batches"].epoch == 1
    assert names["frames"].shape == (count, 8, 12, 360)
    assert names["force"].shape == (count, 8, 3)
    assert torch.isfinite(names["force"]).all()


# --- commands -------------------------------------------------------------------------------------

# Flights of 5 steps, in this process.
BRIEF = ("--set", "arrival.deadline_s=50", "--set", "arrival.dwell_s=50")
# Waits until it is interrupted.
NEVER_ENDS = {"--meshcat"}
# Have tests of their own, and take minutes.
NOT_HERE = {"dagger", "reproduce"}


def commands() -> list[str]:
    """Every `proxops` command in a block without a language, in order."""
    # Closing fences are matched too, or they would be taken for opening ones.
    blocks = re.findall(r"^```(\w*)\n(.*?)^```$", README, FLAGS)
    lines = (
        "".join(text for language, text in blocks if not language).replace("\\\n", " ").splitlines()
    )
    return [line for line in lines if line.startswith("proxops ")]


def words_of(line: str) -> list[str]:
    return shlex.split(line, comments=True)[1:]


@pytest.mark.parametrize("line", commands())
def test_commands_are_understood(line: str) -> None:
    group: Any = get_command(app)
    name, *arguments = words_of(line)
    group.commands[name].make_context(name, arguments)


def in_brief(words: list[str]) -> list[str]:
    """The same on few and short flights, or little data."""
    name, *rest = words
    for number, word in enumerate(rest):
        if word == "--transits" and name != "fly":
            rest[number + 1] = "2" if name == "collect" else "1"
    if name in ("collect", "evaluate") and "--transits" not in rest:
        rest += ["--transits", "2" if name == "collect" else "1"]
    if name in ("collect", "evaluate"):
        rest += [*BRIEF, "--workers", "1"]
    if name == "fly" and "--from" not in rest:
        rest += BRIEF
    if name in ("train", "train-lidar"):
        rest += ["--quick"]
    return [name, *rest]


@pytest.mark.slow
def test_every_command_in_brief(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """In the order in which they stand there, each in the folder that the ones before it leave."""
    monkeypatch.chdir(tmp_path)
    (yaml,) = re.findall(r"^```yaml\n(# heavy.yaml\n.*?)^```", README, FLAGS)
    (tmp_path / "heavy.yaml").write_text(yaml)
    (pilot,) = re.findall(r"^```python\n(# my_pilot.py\n.*?)^```", README, FLAGS)
    (tmp_path / "my_pilot.py").write_text(pilot)
    contact_binary(500.0, 2).export(tmp_path / "scan.stl")
    for bundle in ("policy", "dagger/bundle"):
        write_policy(tmp_path / "out" / bundle, DeadReckoning())
    copy_flights(tmp_path)
    (tmp_path / "out" / "flight").mkdir(parents=True)
    synthetic_log(20).to_netcdf(tmp_path / "out" / "flight" / "flight.nc")  # `make fly` leaves it.
    run_already = set()
    for line in commands():
        words = words_of(line)
        if words[0] in NOT_HERE or NEVER_ENDS & set(words):
            continue
        if words[0] == "train" and "paper" not in words:
            continue  # As what is in NOT_HERE.
        if words[0] == "train":
            words[1] = str(tmp_path)
        brief = in_brief(words)
        monkeypatch.setattr(sys, "argv", ["proxops", *brief])
        with pytest.raises(SystemExit) as end:
            main()
        assert not end.value.code, (line, capfd.readouterr().err)
        run_already.add(words[0])
    assert run_already >= {"fly", "replay", "evaluate", "collect", "shape", "train", "train-lidar"}
    (section,) = re.findall(r"^## Evaluating controllers\n(.*?)(?=^## )", README, FLAGS)
    for row in re.findall(r"^\| (`.*?) \|", section, re.MULTILINE):
        for name in re.findall("`(.*?)`", row):
            assert (tmp_path / "out" / "evaluation" / name).exists()
