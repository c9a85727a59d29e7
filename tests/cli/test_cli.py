"""The command line: what it writes, what it says, and how it refuses bad input."""

import json
import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import short_flights
from commands import Ran, settings
from short_flights import short_scenario, write_blob
from summary_names import NAVIGATION_SUMMARY, SUMMARY
from synthetic_log import synthetic_log

from proxops.cli import common
from proxops.cli.common import work_bar
from proxops.diagrams.logs import FlightLog, differences, length_text
from proxops.diagrams.scenario import change_scenario, load_body, load_scenario, scenario_transit
from proxops.systems.gravity import tabulated_field

BRIEF = settings(
    {"arrival.deadline_s": 100, "arrival.dwell_s": 50, "mpc.intervals": 10},
)
NEAR = settings(short_flights.NEAR)


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
    asked += ("--set", "log_ranges=false")
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


def test_fly(run, tmp_path: Path) -> None:
    (tmp_path / "short.yaml").write_text(
        "mpc: {intervals: 10}  # coarse\narrival: {dwell_s: 100}\n"
    )
    ran = run("fly", "short.yaml", *NEAR[:4], "--out", "a/b")
    assert ran.code == 0, ran.err
    out = tmp_path / "a" / "b"
    assert entries(out) == {"flight.nc", "summary.json", "replay.html"}
    summary = json.loads((out / "summary.json").read_text())
    assert list(summary) == [*SUMMARY, *NAVIGATION_SUMMARY]
    assert summary["success"]
    assert summary["navigation_following"] > 0.95
    log = FlightLog.load(out / "flight.nc")
    assert log.summary == summary
    assert log.scenario == change_scenario(
        short_scenario(), {"navigation": {}, "transit.goal_m": [160e3, 1.2e3, 0.0]}
    )
    assert (out / "replay.html").stat().st_size > 1e6
    # The table: what the issue lists.
    for words in ("Kleopatra, mpc", "success", "yes", "distance from the goal", "Δv", "clearance",
                  "MPC was solved", "MPC step", "real time"):  # fmt: skip
        assert words in ran.out
    assert "Wrote flight.nc, summary.json and replay.html" in ran.err
    assert ran.out.count("position error of the navigation") == 1
    assert entries(tmp_path) >= {"a/b/flight.nc", "short.yaml"}

    again = run("fly", "--from", "a/b/flight.nc", "--out", "again")
    assert again.code == 0, again.err
    assert "repeats a/b/flight.nc bit for bit" in " ".join(again.err.split())
    repeated = FlightLog.load(tmp_path / "again" / "flight.nc")
    assert differences(log, repeated) == []

    # A log that was altered is not repeated, and that is said.
    brief = run("fly", "--controller", "zero", *BRIEF, "--json", "--out", "brief")
    assert json.loads(brief.out)["controller"] == "zero"
    log = FlightLog.load(tmp_path / "brief" / "flight.nc")
    log.dataset["force"][3, 0] += 1e-9
    log.to_netcdf(tmp_path / "altered.nc")
    other = run("fly", "--from", "altered.nc", "--out", "other")
    assert other.code == 1
    assert "differs from its log in: force" in " ".join(other.err.split())

    page = run("replay", "a/b/flight.nc", "--out", "page/flight.html")
    assert page.code == 0, page.err
    assert (tmp_path / "page" / "flight.html").stat().st_size > 1e6


def test_a_touch_is_told_by_its_task(run) -> None:
    """The MPC has no part in it."""
    ran = run("fly", "bennu_touch_and_go", *BRIEF, "--out", "touch")
    assert ran.code == 0, ran.err
    assert "Bennu, touch-and-go" in ran.out
    assert "MPC" not in ran.out


@pytest.mark.slow
def test_mended_map_is_written_and_flown_with(run: Callable[..., Ran], tmp_path: Path) -> None:
    wrong = settings({"navigation.expected.surface_rms_m": 50.0})
    mended = ["--mended-map", "maps/mended.obj"]
    ran = run("fly", *NEAR, *BRIEF, *wrong, *mended, "--out", "out")
    assert ran.code == 0
    assert "Wrote maps/mended.obj" in ran.err
    assert entries(tmp_path) >= {"out/flight.nc", "maps/mended.obj", "maps/mended.npz"}
    again = run("fly", *NEAR, *BRIEF, "--set", "navigation.map=maps/mended.obj", "--out", "again")
    assert again.code == 0
    log = FlightLog.load(tmp_path / "again" / "flight.nc")
    assert getattr(log.scenario.navigation, "map", None) == str(tmp_path / "maps" / "mended.obj")
    # Without a navigation the flight is kept, and what is wrong is said.
    told = ["--set", "navigation=!TrueState {}"]
    ran = run("fly", *NEAR, *BRIEF, *told, "--mended-map", "none.obj", "--out", "other")
    assert ran.code != 0
    assert "told its true state" in ran.err
    assert "other/flight.nc" in entries(tmp_path)
    assert run("fly", "--mended-map", "mended.stl").code != 0


# --- evaluate -------------------------------------------------------------------------------------


def test_evaluate(run, tmp_path: Path) -> None:
    command = ["evaluate", "--controllers", "mpc,zero", "--transits", 1, "--seed", 31, *BRIEF]
    ran = run(*command, "--workers", 1, "--out", "out")
    assert ran.code == 0, ran.err
    written = json.loads((tmp_path / "out" / "results.json").read_text())
    assert {"command", "version", "machine"} <= written["provenance"].keys()
    results = written["controllers"]
    assert list(results) == ["mpc", "zero"]
    for name, result in results.items():
        for key in ("success_rate", "success_rate_2km", "collisions", "keep_out_violations",
                    "policy_share", "flights"):  # fmt: skip
            assert key in result
        assert result["success_rate"] == 0.0
        # Zero reads no state, so it flies without navigation; a flight is over before it settles.
        keys = [*SUMMARY, *NAVIGATION_SUMMARY[: name == "mpc"], "small_command_share"]
        assert [list(row) for row in result["flights"]] == [keys]
        assert [row["transit"] for row in result["flights"]] == [0]
        assert {row["controller"] for row in result["flights"]} == {name}
        assert {row["seed"] for row in result["flights"]} == {31}
        report = (tmp_path / "out" / "report.md").read_text()
        assert length_text(result["min_clearance_m"]) in report
        # It did not arrive, so it is among the five worst.
        assert f"(worst/{name}-00000.html)" in report
        assert (tmp_path / "out" / "worst" / f"{name}-00000.html").stat().st_size > 1e6
    assert "0 of 1" in ran.out

    # Again: nothing is flown twice.
    flights = tmp_path / "out" / "flights"
    times = {path: path.stat().st_mtime_ns for path in flights.glob("*.json")}
    assert len(times) == 2
    assert run(*command, "--workers", 1, "--out", "out").code == 0
    assert {path: path.stat().st_mtime_ns for path in flights.glob("*.json")} == times
    again = json.loads((tmp_path / "out" / "results.json").read_text())
    assert again["controllers"] == results

    # Another scenario in the same folder would mix them up.
    mixed = run(*command, "--workers", 1, "--out", "out", "--set", "noise_seed=1")
    refused(mixed, "another scenario", "output folder")


def test_a_warning_is_a_line(run, tmp_path: Path) -> None:
    setting = ["--set", "assurance={bounds: {}}", "--set", "truth.gravity=1.01"]
    with pytest.warns(UserWarning, match="the scenario may exceed assurance") as caught:
        ran = run("fly", "--controller", "hybrid", *BRIEF, *setting, "--out", "out")
    assert ran.code == 0
    line = warnings.formatwarning(caught[0].message, UserWarning, "code.py", 1)
    assert line.startswith("proxops: warning: the scenario may exceed")
    assert line.count("\n") == 1
    assert line.endswith("gravity: declared up to 0.01, assurance.bounds say 0\n")
    # Commands that draw a world twice warn once.
    assert warnings.formatwarning(caught[0].message, UserWarning, "code.py", 1) == ""


# --- what is refused ------------------------------------------------------------------------------

UNTRAINED = settings({"policy.bundle": "policy.zip"})
FAILING = settings({"assurance": "{}", "truth.thrusters.failed_axis": "x"})
ENDS = settings({"transit.start_m": "[160e3, 0, 0]", "transit.goal_m": "[160e3, 8e3, 0]"})


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["fly", "--set", "spacecraft.mas_kg=3"], ["no key 'mas_kg'", "nearest is 'mass_kg'"]),
        (["evaluate", "--set", "spacecraft.mas_kg=3"], ["no key 'mas_kg'"]),
        (["fly", *FAILING], ["failed_axis has no end"]),
        (["evaluate", "--controllers", ""], ["controller"]),
        (["evaluate", "--controllers", "mpc,mpc"], ["controller"]),
        (["fly", *ENDS, "--seed", "3"], ["gives a start and a goal", "--seed and --transit"]),
        (["fly", *BRIEF, "--out", "mine.nc/deeper"], ["mine.nc", "not a folder"]),
        (["fly", "--from", "mine.nc"], ["mine.nc is not a flight log"]),
        (["fly", "--from", "."], [". is not a flight log: it is a folder"]),
        (["fly", "--from", "absent.nc"], ["there is no file absent.nc"]),
        (["replay", "mine.nc"], ["mine.nc is not a flight log"]),
        (["fly", "--from", "flight.nc", "--out", "."], ["holds the log that is repeated"]),
        (["replay", "mine.nc", "--mcap", "./mine.nc"], ["files of their own, and not the log"]),
        (["fly", "--mended-map", "mine.obj"], ["this file is no mended map"]),
        (["reproduce", "paper-recipe", *UNTRAINED], ["train it first"]),
        (["reproduce", "paper", "paper-recipe", "--quick", *UNTRAINED], ["train it first"]),
        (["reproduce", "paper", "paper-recipe", *UNTRAINED], ["the policy that is trained"]),
        (["fly", "--from", "made.nc"], ["Proportional, is a System that was made in Python"]),
    ],
)
def test_refusals(run, tmp_path: Path, arguments: list[str], words: list[str]) -> None:
    """In one line, and nothing is written or replaced."""
    for name in ("mine.nc", "flight.nc", "mine.obj"):
        (tmp_path / name).write_text("the only copy")
    if "made.nc" in arguments:
        log = synthetic_log(3, ranges=False)
        made = FlightLog(log.dataset.assign_attrs(controller="Proportional"), log.body)
        made.to_netcdf(tmp_path / "made.nc")
    before = {path: path.read_bytes() for path in tmp_path.iterdir()}
    refused(run(*arguments), *words)
    assert {path: path.read_bytes() for path in tmp_path.iterdir()} == before


def test_long_work_without_a_terminal_tells_of_its_progress(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    with work_bar("flying") as progress:
        progress(0.2, "2 of 10 flights")
        assert capfd.readouterr().err == ""  # Ten minutes have not passed.
        monkeypatch.setattr(common, "_SECONDS_PER_LINE", 0.0)
        progress(0.5, "5 of 10 flights")
        assert capfd.readouterr().err == "50 % 5 of 10 flights\n"


# --- strangers' logs ------------------------------------------------------------------------------


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
