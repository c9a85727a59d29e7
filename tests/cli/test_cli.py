"""The command line: what it writes, what it says, and how it refuses bad input."""

import json
import logging
import subprocess
import sys
import warnings
from collections.abc import Callable
from importlib import metadata
from pathlib import Path

import numpy as np
import pytest
import short_flights
from commands import proxops, settings
from short_flights import kleopatra, short_scenario, write_blob
from summary_names import NAVIGATION_SUMMARY, SUMMARY
from synthetic_log import synthetic_log

from proxops.cli import common
from proxops.cli.common import console, work_bar
from proxops.cli.fly import _table
from proxops.diagrams.logs.flight_log import FlightLog, differences
from proxops.diagrams.logs.lengths import length_text
from proxops.diagrams.scenario.body import load_body
from proxops.diagrams.scenario.scenario import change_scenario, load_scenario
from proxops.diagrams.scenario.transits import scenario_transit
from proxops.systems.gravity import tabulated_field

BRIEF = settings(
    {"arrival.deadline_s": 100, "arrival.dwell_s": 50, "mpc.intervals": 10},
)
SHORT = settings(short_flights.SHORT)


class Ran:
    """Exit code and output of one run."""

    def __init__(self, code: int, out: str, err: str):
        self.code, self.out, self.err = code, out, err


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str], tmp_path: Path):
    """`proxops ARGUMENTS` in this process, working in a folder of its own."""
    kleopatra().gravity_field.evaluate(np.ones((1, 3)))  # Compiled by now, which would be told.
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(console, "width", 200)

    def ran(*arguments: object) -> Ran:
        capfd.readouterr()
        code = proxops(*arguments)
        caught = capfd.readouterr()
        return Ran(code, str(caught.out), str(caught.err))

    return ran


def entries(folder: Path) -> set[str]:
    return {path.relative_to(folder).as_posix() for path in folder.rglob("*")}


def refused(ran: Ran, *words: str) -> None:
    """Exit code 2 and one line on standard error that says all of this."""
    assert ran.code == 2, ran.err
    assert ran.out == ""
    [line] = ran.err.splitlines()
    assert line.startswith("proxops: error: ")
    assert "Traceback" not in line
    for word in words:
        assert word in line


# --- fly ------------------------------------------------------------------------------------------


def test_table_tells_of_steps_without_a_fresh_plan() -> None:
    log = synthetic_log(30, ranges=False)
    data = log.dataset.copy(deep=True)
    data["solve_status"][[2, 3, 5]], data["solve_reason"][[2, 3, 5]] = [1, 1, 2], [7, 7, 5]
    table = dict(_table(FlightLog(data, log.body), log.summary))
    assert table["steps last plan continued: solver iteration limit"] == "2"
    assert table["steps braking: input not finite"] == "1"
    assert not [name for name in dict(_table(log, log.summary)) if name.startswith("steps")]


def test_the_table_says_whether_the_navigation_knew_where_it_is(run) -> None:
    wrong = ["--set", "truth.gravity=0.9", "--set", "arrival.deadline_s=200"]
    ran = run("fly", "--controller", "zero", *wrong, "--set", "log_ranges=false", "--out", "out")
    assert ran.code == 0, ran.err
    assert "Note: truth.gravity is set, but the navigation" in " ".join(ran.err.split())
    ran = run("fly", *BRIEF, *wrong, "--set", "log_ranges=false", "--out", "out")
    assert "steps at which the navigation knew where it is" in ran.out
    assert "why it never did" not in ran.out
    assert "Note: the navigation was overconfident" in " ".join(ran.err.split())


def test_the_table_says_why_the_navigation_never_knew_where_it_is(run) -> None:
    short = ["--set", "lidar.max_range_m=50000", "--set", "arrival.deadline_s=50"]
    ran = run("fly", *short, "--out", "out")
    assert ran.code == 0, ran.err
    told = " ".join(ran.out.replace("│", " ").split())
    assert "why it never did no frame of the lidar had a return" in told
    start = scenario_transit(load_scenario(), load_body("kleopatra")).start
    away = np.linalg.norm(load_body("kleopatra").shape.vertices - start, axis=1).min()
    assert f"50.0 km, {away / 1e3:.0f} km" in told


def test_one_flight_does_not_wait_for_a_gravity_table(
    run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It says so and flies in exact gravity. Where there is a table, it flies with it."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    asked = ("fly", "--controller", "zero", *BRIEF, "--set", f"body={write_blob(tmp_path)}")
    ran = run(*asked, "--set", "gravity=table", "--out", "without")
    assert ran.code == 0, ran.err
    assert "has no gravity table of Blob yet" in " ".join(ran.err.split())
    assert not list((tmp_path / "cache").rglob("*.npz"))
    log = FlightLog.load(tmp_path / "without" / "flight.nc")
    assert log.scenario.gravity == "exact"
    assert run(*asked, "--out", "exact").code == 0
    assert differences(log, FlightLog.load(tmp_path / "exact" / "flight.nc")) == []

    assert not log.body.gravity_table_is_kept
    tabulated_field._boxes.cache_clear()  # Another test may have made it, for its own folder.
    _ = log.body.with_gravity("table").gravity_field
    assert log.body.gravity_table_is_kept
    ran = run(*asked, "--set", "gravity=table", "--out", "with")
    assert "no gravity table" not in ran.err
    assert FlightLog.load(tmp_path / "with" / "flight.nc").scenario.gravity == "table"


@pytest.mark.parametrize(("options", "shown"), [((), 1), (("-v",), 2), (("--verbose",), 2)])
def test_the_log_is_shown(
    run, options: tuple[str, ...], shown: int, capfd: pytest.CaptureFixture[str]
) -> None:
    """Warnings always: to make a gravity table is one, because a user waits for it."""
    assert run(*options, "replay", "none.nc").code == 2
    log = logging.getLogger("proxops.systems.gravity")
    log.warning("making the gravity table of %s", "[a] body")
    log.info("the gravity table is kept")
    lines = [
        "proxops: making the gravity table of [a] body\n",
        "proxops: the gravity table is kept\n",
    ]
    assert capfd.readouterr().err == "".join(lines[:shown])


def test_fly(run, tmp_path: Path) -> None:
    (tmp_path / "short.yaml").write_text(
        "mpc: {intervals: 10}  # coarse\narrival: {dwell_s: 100}\n"
    )
    ran = run("fly", "short.yaml", *SHORT[:4], "--out", "a/b")
    assert ran.code == 0, ran.err
    out = tmp_path / "a" / "b"
    assert entries(out) == {"flight.nc", "summary.json", "replay.html"}
    summary = json.loads((out / "summary.json").read_text())
    assert list(summary) == [*SUMMARY, *NAVIGATION_SUMMARY]
    assert summary["success"]
    assert summary["navigation_following"] > 0.95
    log = FlightLog.load(out / "flight.nc")
    assert log.summary == summary
    assert log.scenario == change_scenario(short_scenario(), {"navigation": {}})
    assert (out / "replay.html").stat().st_size > 1e6
    # The table: what the issue lists.
    for words in ("Kleopatra, mpc", "success", "yes", "position error", "delta-v", "clearance",
                  "MPC solves", "MPC step", "real time"):  # fmt: skip
        assert words in ran.out
    assert "Wrote flight.nc, summary.json and replay.html" in ran.err
    assert entries(tmp_path) >= {"a/b/flight.nc", "short.yaml"}

    again = run("fly", "--from", "a/b/flight.nc", "--out", "again")
    assert again.code == 0, again.err
    assert "repeats a/b/flight.nc bit for bit" in " ".join(again.err.split())
    repeated = FlightLog.load(tmp_path / "again" / "flight.nc")
    assert differences(log, repeated) == []

    # A log that was altered is not repeated, and that is said.
    assert run("fly", "--controller", "zero", *BRIEF, "--out", "brief").code == 0
    log = FlightLog.load(tmp_path / "brief" / "flight.nc")
    log.dataset["force"][3, 0] += 1e-9
    log.to_netcdf(tmp_path / "altered.nc")
    other = run("fly", "--from", "altered.nc", "--out", "other")
    assert other.code == 1
    assert "differs from its log in: force" in " ".join(other.err.split())

    page = run("replay", "a/b/flight.nc", "--out", "page/flight.html")
    assert page.code == 0, page.err
    assert (tmp_path / "page" / "flight.html").stat().st_size > 1e6


def test_seed_and_transit(run, tmp_path: Path) -> None:
    ran = run("fly", "--controller", "zero", *BRIEF, "--seed", 12, "--transit", 3, "--out", "out")
    assert ran.code == 0, ran.err
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert (summary["seed"], summary["transit"]) == (12, 3)
    assert summary["controller"] == "zero"
    assert not summary["success"]


@pytest.mark.slow
def test_mended_map_is_written_and_flown_with(run: Callable[..., Ran], tmp_path: Path) -> None:
    wrong = settings({"navigation.expected.surface_rms_m": 50.0})
    mended = ["--mended-map", "maps/mended.obj"]
    ran = run("fly", *SHORT, *BRIEF, *wrong, *mended, "--out", "out")
    assert ran.code == 0
    assert "Wrote maps/mended.obj" in ran.err
    assert entries(tmp_path) >= {"out/flight.nc", "maps/mended.obj", "maps/mended.npz"}
    again = run("fly", *SHORT, *BRIEF, "--set", "navigation.map=maps/mended.obj", "--out", "again")
    assert again.code == 0
    log = FlightLog.load(tmp_path / "again" / "flight.nc")
    assert getattr(log.scenario.navigation, "map", None) == str(tmp_path / "maps" / "mended.obj")
    # Without a navigation the flight is kept, and what is wrong is said.
    told = ["--set", "navigation=!TrueState {}"]
    ran = run("fly", *SHORT, *BRIEF, *told, "--mended-map", "none.obj", "--out", "other")
    assert ran.code != 0
    assert "told its true state" in ran.err
    assert "other/flight.nc" in entries(tmp_path)
    assert run("fly", "--mended-map", "mended.stl").code != 0


def test_a_mended_map_does_not_replace_a_mesh(run: Callable[..., Ran], tmp_path: Path) -> None:
    (tmp_path / "rock.obj").write_text("a mesh of the user's")
    refused(run("fly", "--mended-map", "rock.obj"), "this file is no mended map")
    assert (tmp_path / "rock.obj").read_text() == "a mesh of the user's"


@pytest.mark.slow
def test_own_controller_from_the_working_directory(run, tmp_path: Path) -> None:
    (tmp_path / "mine_for_the_cli.py").write_text(
        "from short_flights import PdController\n"
        "def make(scenario, body):\n"
        "    return PdController(scenario.spacecraft.mass_kg, scenario.spacecraft.thrust_limit_n)\n"
    )
    ran = run("fly", "--controller", "mine_for_the_cli:make", *SHORT, *BRIEF, "--out", "out")
    assert ran.code == 0, ran.err
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["delta_v_m_s"] > 1.0
    assert summary["controller"] == "mine_for_the_cli:make"
    # A log imports no code by itself: who trusts it names the controller again.
    refused(run("fly", "--from", "out/flight.nc", "--out", "again"), "mine_for_the_cli:make")
    named = ("--controller", "mine_for_the_cli:make")
    again = run("fly", "--from", "out/flight.nc", *named, "--out", "again")
    assert again.code == 0, again.err


def test_own_body(run, tmp_path: Path) -> None:
    """From a scenario file that names it relative to itself; repeated when the body is gone."""
    (tmp_path / "bodies").mkdir()
    write_blob(tmp_path / "bodies")
    (tmp_path / "bodies" / "scenario.yaml").write_text("body: blob.yaml\n")
    ran = run("fly", "bodies/scenario.yaml", *SHORT, *BRIEF[:4], "--out", "out")
    assert ran.code == 0, ran.err
    assert "Blob, mpc" in ran.out
    for path in (tmp_path / "bodies").iterdir():
        path.unlink()
    again = run("fly", "--from", "out/flight.nc", "--out", "again")
    assert again.code == 0, again.err


# --- evaluate -------------------------------------------------------------------------------------


def test_evaluate(run, tmp_path: Path) -> None:
    command = ["evaluate", "--controllers", "mpc,zero", "--transits", 2, "--seed", 31, *BRIEF]
    ran = run(*command, "--workers", 1, "--out", "out")
    assert ran.code == 0, ran.err
    results = json.loads((tmp_path / "out" / "results.json").read_text())
    assert list(results) == ["mpc", "zero"]
    for name, result in results.items():
        for key in ("success_rate", "success_rate_2km", "collisions", "keep_out_violations",
                    "policy_share", "flights"):  # fmt: skip
            assert key in result
        assert result["success_rate"] == 0.0
        # Zero reads no state, so it flies without navigation; a flight is over before it settles.
        keys = [*SUMMARY, *NAVIGATION_SUMMARY[: name == "mpc"], "small_command_share"]
        assert [list(row) for row in result["flights"]] == [keys] * 2
        assert [row["transit"] for row in result["flights"]] == [0, 1]
        assert {row["controller"] for row in result["flights"]} == {name}
        assert {row["seed"] for row in result["flights"]} == {31}
        assert length_text(result["min_clearance_m"]) in ran.out
        report = (tmp_path / "out" / "report.md").read_text()
        for k in (0, 1):  # Nobody arrived, so each flight is among the five worst.
            assert f"(worst/{name}-0000{k}.html)" in report
            page = tmp_path / "out" / "worst" / f"{name}-0000{k}.html"
            assert page.stat().st_size > 1e6
    assert "0 of 2" in ran.out

    # Again: nothing is flown twice.
    flights = tmp_path / "out" / "flights"
    times = {path: path.stat().st_mtime_ns for path in flights.glob("*.json")}
    assert len(times) == 4
    assert run(*command, "--workers", 1, "--out", "out").code == 0
    assert {path: path.stat().st_mtime_ns for path in flights.glob("*.json")} == times
    assert json.loads((tmp_path / "out" / "results.json").read_text()) == results

    # Another scenario in the same folder would mix them up.
    mixed = run(*command, "--workers", 1, "--out", "out", "--set", "noise_seed=1")
    refused(mixed, "another scenario", "output folder")


@pytest.mark.parametrize("controllers", ["", "mpc,mpc", "mpc,nope"])
def test_evaluate_controllers_refused(run, tmp_path: Path, controllers: str) -> None:
    refused(run("evaluate", "--controllers", controllers, "--out", "out"), "controller")
    assert entries(tmp_path) == set()


def test_a_warning_is_a_line(run, tmp_path: Path) -> None:
    setting = ["--set", "assurance={bounds: {}}", "--set", "truth.gravity=1.01"]
    with pytest.warns(UserWarning, match="the scenario may exceed assurance") as caught:
        ran = run("fly", "--controller", "zero", *BRIEF, *setting, "--out", "out")
    assert ran.code == 0
    line = warnings.formatwarning(caught[0].message, UserWarning, "code.py", 1)
    assert line.startswith("proxops: warning: the scenario may exceed")
    assert line.count("\n") == 1
    assert line.endswith("gravity 0 (up to 0.01)\n")


# --- bad input ------------------------------------------------------------------------------------


@pytest.mark.parametrize("option", ["--seed", "--transit"])
def test_a_transit_of_a_seed_and_ends_of_its_own(run, option: str) -> None:
    ends = ["--set", "transit.start_m=[160e3, 0, 0]", "--set", "transit.goal_m=[160e3, 8e3, 0]"]
    refused(run("fly", *ends, option, "3"), "gives a start and a goal", "--seed and --transit")


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        (["spacecraft.mas_kg=3"], ["no key 'mas_kg'", "nearest is 'mass_kg'"]),
        (["assurance={}", "truth.thrusters.failed_axis=x"], ["failed_axis has no end"]),
    ],
)
@pytest.mark.parametrize("command", ["fly", "evaluate"])
def test_bad_setting_of_a_command(
    run, tmp_path: Path, command: str, settings: list[str], words: list[str]
) -> None:
    options = [part for setting in settings for part in ("--set", setting)]
    refused(run(command, *options, "--out", "out"), *words)
    assert entries(tmp_path) == set()


@pytest.mark.parametrize("command", ["fly", "evaluate"])
def test_out_under_a_file(run, tmp_path: Path, command: str) -> None:
    (tmp_path / "file").write_text("mine")
    for out in ("file", "file/deeper"):
        refused(run(command, *BRIEF, "--out", out), "file", "not a folder")
    assert entries(tmp_path) == {"file"}
    assert (tmp_path / "file").read_text() == "mine"


def test_from_what_is_no_log(run, tmp_path: Path) -> None:
    (tmp_path / "notes.nc").write_text("not a log")
    refused(run("fly", "--from", "notes.nc", "--out", "out"), "notes.nc is not a flight log")
    refused(run("fly", "--from", "absent.nc", "--out", "out"), "there is no file absent.nc")
    refused(run("fly", "--from", ".", "--out", "out"), "is not a flight log")
    refused(run("replay", "notes.nc"), "notes.nc is not a flight log")
    ran = run("replay", "absent.nc")
    assert (ran.code, ran.err) == (2, "proxops: error: there is no file absent.nc\n")
    assert entries(tmp_path) == {"notes.nc"}


def test_a_repeated_flight_does_not_replace_its_log(run, tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "flight.nc").write_text("the only record of a flight")
    ran = run("fly", "--from", "out/flight.nc", "--out", "out")
    refused(ran, "--out out holds the log that is repeated")
    assert (tmp_path / "out" / "flight.nc").read_text() == "the only record of a flight"


def test_from_the_log_of_a_system_made_in_python(run, tmp_path: Path) -> None:
    log = synthetic_log(30, ranges=False)
    log.dataset.attrs["controller"] = "Proportional"
    log.to_netcdf(tmp_path / "flight.nc")
    ran = run("fly", "--from", "flight.nc", "--out", "again")
    refused(ran, "Proportional, is a System that was made in Python", "body=log.body")


@pytest.mark.parametrize(
    "files", [["--out", "a.nc"], ["--mcap", "./a.nc"], ["--oem", "x", "--mcap", "x"]]
)
def test_replay_does_not_replace_its_log(run, tmp_path: Path, files: list[str]) -> None:
    (tmp_path / "a.nc").write_text("a log")
    refused(run("replay", "a.nc", *files), "must name files of their own, and not the log")
    assert (tmp_path / "a.nc").read_text() == "a log"


# --- options that would count for nothing ---------------------------------------------------------


def test_the_papers_recipe_can_be_flown_once_it_is_trained(run, tmp_path: Path) -> None:
    """In one command it is trained first; here that stops at what training refuses."""
    stops = ["--set", "policy.bundle=policy.zip", "--out", "out"]
    refused(run("reproduce", "paper-recipe", *stops), "train it first")
    refused(run("reproduce", "paper", "paper-recipe", "--quick", *stops), "train it first")
    refused(run("reproduce", "paper", "paper-recipe", *stops), "the policy that is trained")
    assert entries(tmp_path) == set()


# --- what is printed ------------------------------------------------------------------------------


def test_long_work_without_a_terminal_tells_of_its_progress(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    with work_bar("flying") as progress:
        progress(0.2, "2 of 10 flights")
        assert capfd.readouterr().err == ""  # Ten minutes have not passed.
        monkeypatch.setattr(common, "_SECONDS_PER_LINE", 0.0)
        progress(0.5, "5 of 10 flights")
        assert capfd.readouterr().err == "50 % 5 of 10 flights\n"


# --- help -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("command", ["fly", "evaluate", "replay"])
def test_help(run, command: str) -> None:
    ran = run(command, "-h")
    assert ran.code == 0
    assert f"proxops {command}" in ran.out
    assert "Example" in ran.out
    assert "--out" in ran.out


def test_as_a_process(tmp_path: Path) -> None:
    """The streams get only what the command prints, and no traceback."""
    command = [sys.executable, "-m", "proxops.cli.main", "fly"]
    ran = subprocess.run(
        [*command, "--set", "spacecraft.mass_kg=-1", "--out", "out"],
        cwd=tmp_path, capture_output=True, text=True, timeout=60, check=False,
    )  # fmt: skip
    assert ran.returncode == 2
    assert ran.stdout == ""
    assert ran.stderr == (
        "proxops: error: scenario: spacecraft.mass_kg must be positive, got -1.0\n"
    )
    assert entries(tmp_path) == set()


# --- version, missing files, strangers' logs ------------------------------------------------------


def test_version(run) -> None:
    ran = run("--version")
    assert ran.code == 0
    assert ran.out == f"proxops {metadata.version('proxops')}\n"


def test_a_log_runs_no_code_of_its_own(run, tmp_path: Path) -> None:
    """A stranger's log may name any module; it flies only if the user names it too."""
    (tmp_path / "stranger.py").write_text("open('ran', 'w').close()\n")
    assert run("fly", "--controller", "zero", *BRIEF, "--out", "out").code == 0
    log = FlightLog.load(tmp_path / "out" / "flight.nc")
    log.dataset.attrs["controller"] = "stranger:make"
    log.to_netcdf(tmp_path / "theirs.nc")
    refused = run("fly", "--from", "theirs.nc", "--out", "again")
    assert refused.code == 2
    assert "add --controller stranger:make" in refused.err
    other = run("fly", "--from", "theirs.nc", "--controller", "zero", "--out", "again")
    assert other.code == 2
    assert "give no other --controller" in other.err
    assert not (tmp_path / "ran").exists()
    named = run("fly", "--from", "theirs.nc", "--controller", "stranger:make", "--out", "again")
    assert named.code == 2  # The module has no such factory, but it was imported.
    assert (tmp_path / "ran").exists()
