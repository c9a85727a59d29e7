"""`proxops collect`: what it writes, and that nothing that happens to it leaves a wrong set."""

import hashlib
import json
import os
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from ball_lidar import write_ball_bundle, write_ball_frame_bundle
from commands import proxops, settings
from short_flights import kleopatra

from proxops.diagrams.logs.flight_log import FlightLog
from proxops.diagrams.scenario import load_body, load_scenario, parse_scenario
from proxops.systems import InputError
from proxops.systems.lidar import LearnedLidarConfig
from proxops.training.data.collection import describe_flight
from proxops.training.data.recovery import flight_scenario, kind_of

# Over after 7 steps, wherever it is then.
BRIEF = {"arrival.deadline_s": 50.0, "arrival.dwell_s": 20.0, "mpc.intervals": 10}
SETTINGS = settings(BRIEF)
FULL = {
    "nominal": 3, "random_walk": 3, "noise": 4, "kicks": 2, "overshoot": 3, "keep_out": 2,
    "holding": 3,
}  # fmt: skip

Collect = Callable[..., int]


@pytest.fixture
def collect(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Collect:
    """`proxops collect` in this process, in a folder of its own; returns the exit code."""
    monkeypatch.chdir(tmp_path)

    def collect(*arguments: object) -> int:
        return proxops("collect", *arguments, *SETTINGS, "--workers", 1)

    return collect


def manifest_of(folder: Path) -> dict[str, Any]:
    """The manifest, whose every row is checked against its file."""
    manifest = json.loads((folder / "manifest.json").read_text())
    for index, row in enumerate(manifest["flights"]):
        assert row["index"] == index
        content = (folder / manifest["folder"] / row["file"]).read_bytes()
        assert row["bytes"] == len(content)
        assert row["sha256"] == hashlib.sha256(content).hexdigest()
    return manifest


def logs_of(folder: Path) -> list[FlightLog]:
    rows = manifest_of(folder)["flights"]
    return [FlightLog.load(folder / "flights" / row["file"]) for row in rows]


# --- what it writes -------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def full_set(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Seven flights of the full mix."""
    out = tmp_path_factory.mktemp("collection") / "full"
    options = ("--recovery", "full", "--seed", 5, "--workers", 1, *SETTINGS)
    assert proxops("collect", "--transits", 7, *options, "--out", out) == 0
    return out


@pytest.fixture(scope="module")
def full_logs(full_set: Path) -> list[FlightLog]:
    return logs_of(full_set)


@pytest.fixture(scope="module")
def two_flown(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two flights of the mix that is the default."""
    out = tmp_path_factory.mktemp("collection") / "out"
    assert proxops("collect", "--transits", 2, *SETTINGS, "--workers", 1, "--out", out) == 0
    return out


@pytest.fixture
def two(collect: Collect, two_flown: Path) -> Path:
    """A copy of these, `out` in the folder of `collect`."""
    return Path(shutil.copytree(two_flown, "out"))


@pytest.mark.parametrize(("seed", "warned"), [(9_999, False), (10_000, True)])
def test_seeds_of_evaluation_are_warned_of(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str],
    seed: int, warned: bool,
) -> None:  # fmt: skip
    def stop(*given: object, **options: object) -> None:
        raise InputError("not flown")

    monkeypatch.setattr("proxops.cli.collect.collect", stop)
    assert proxops("collect", "--seed", seed, "--out", tmp_path / "out") == 2
    told = " ".join(capfd.readouterr().err.split())
    assert ("seeds from 10,000 on are for evaluation: train nothing on" in told) == warned


def test_manifest_and_logs(full_set: Path, full_logs: list[FlightLog]) -> None:
    manifest = manifest_of(full_set)
    wanted = load_scenario(None, BRIEF, on_true_state=True)
    assert parse_scenario(manifest["scenario"]) == wanted
    assert (manifest["mix"], manifest["seed"]) == (FULL, 5)
    assert len(manifest["body_sha256"]) == 64
    for index, (row, log) in enumerate(zip(manifest["flights"], full_logs, strict=True)):
        assert row["kind"] == kind_of(FULL, index)
        assert log.dataset.attrs["proxops_version"] == manifest["proxops_version"]
        flown = flight_scenario(row["kind"], wanted, kleopatra(), 5, index)
        assert log.scenario == flown
        summary = log.summary
        assert {name: row[name] for name in summary} == summary
        path = full_set / "flights" / row["file"]
        assert describe_flight(log, path).items() <= row.items()
    assert len({row["kind"] for row in manifest["flights"]}) == 7
    halves = list(full_set.rglob("*.part"))
    assert halves == []


@pytest.mark.slow
@pytest.mark.parametrize(
    ("lidar", "write"), [("learned", write_ball_bundle), ("paper", write_ball_frame_bundle)]
)
def test_learned_lidar_gives_the_frames_of_disturbed_flights(
    collect, tmp_path: Path, lidar: str, write: Callable[..., Path]
) -> None:
    write(tmp_path / "bundle", shape_sha256=load_body("kleopatra").shape.sha256)
    options = ("--lidar", lidar, "--lidar-bundle", "bundle", "--set", "lidar.noise_std_m=7")
    assert collect("--transits", 2, "--out", "set", *options) == 0
    for row, log in zip(
        manifest_of(tmp_path / "set")["flights"], logs_of(tmp_path / "set"), strict=True
    ):
        sensor = log.scenario.lidar
        assert sensor.noise_std_m == 7.0
        assert isinstance(sensor, LearnedLidarConfig) == (row["kind"] == "random_walk")
        assert ("lidar_sha256" in log.dataset.attrs) == (row["kind"] == "random_walk")


def test_report(full_set: Path, full_logs: list[FlightLog]) -> None:
    report = json.loads((full_set / "report.json").read_text())
    logs = full_logs
    commands = np.concatenate([log.dataset["mpc_force"].values for log in logs])
    small = np.abs(commands) < 0.2
    shares = report["all"]["zero_command_share"]
    assert [shares[axis] for axis in "xyz"] == pytest.approx(small.mean(axis=0).tolist())
    assert shares["all"] == pytest.approx(small.all(axis=1).mean())
    distances = np.concatenate(
        [
            np.linalg.norm((log.dataset["state"] - log.dataset["target"]).values[:, :3], axis=1)
            for log in logs
        ]
    )
    edges = [-np.inf, *(1e3 * np.array(report["goal_distance_edges"])), np.inf]
    assert report["all"]["goal_distances"] == np.histogram(distances, edges)[0].tolist()
    assert sum(report["all"]["clearances"]) == len(distances)
    files = list((full_set / "flights").glob("*.nc"))
    assert report["all"]["bytes"] == sum(path.stat().st_size for path in files)
    assert report["all"]["steps"] == sum(log.summary["steps"] for log in logs)
    least = min(log.summary["min_clearance_m"] for log in logs)
    assert report["all"]["min_clearance_m"] == least
    assert sum(kind["flights"] for kind in report["kinds"].values()) == 7
    page = (full_set / "report.md").read_text()
    for kind in FULL:
        assert f"| {kind} |" in page


# --- again ----------------------------------------------------------------------------------------


def test_another_set_in_the_same_folder_is_refused(
    collect: Collect, two: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    manifest = (two / "manifest.json").read_text()
    assert collect("--transits", 2, "--recovery", "holding=1", "--out", two) == 2
    assert "another scenario" in capsys.readouterr().err
    assert (two / "manifest.json").read_text() == manifest


def test_a_log_cut_short_is_told_and_flown_anew(
    collect: Collect, two: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = two / "flights" / "0-00001.nc"
    whole = path.stat().st_size
    os.truncate(path, whole // 2)
    assert collect("--transits", 2, "--out", two) == 2
    assert f"0-00001.nc has {whole // 2} bytes and had {whole}" in capsys.readouterr().err
    path.unlink()
    assert collect("--transits", 2, "--out", two) == 0
    assert len(logs_of(two)) == 2
