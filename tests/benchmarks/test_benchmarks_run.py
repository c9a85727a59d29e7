"""Every benchmark runs, at its smallest size: nobody learns years later that its command is broken.

What a benchmark computes is tested elsewhere, or is a figure and no test. `make bench` runs others.
"""

import json
import re
import subprocess
import sys
from pathlib import Path

import pytest
from pages import ROOT
from scripts import run_script

from proxops.diagrams.flight import fly
from proxops.diagrams.scenario import load_scenario

BENCHMARKS = ROOT / "benchmarks"

ONE_FLIGHT = ["--transits", "1", "--workers", "1"]
# Half as long as it would be.
SHORT = ["transit.min_distance_m=1e4", "transit.max_distance_m=3e4", "arrival.dwell_s=100"]
ONE_SHORT = [*ONE_FLIGHT, *(word for each in SHORT for word in ("--set", each))]

# The smallest size that goes through all of a benchmark; the studies of closed_loop.py by name.
RUNS = {
    "assurance": ["--flights", "4", "--steps", "30", "--bare", "1"],
    "assurance: end": ["--end", "50"],
    "closed_loop: any_body": [*ONE_SHORT, "--bodies", "kleopatra", "--only", "policy"],
    "closed_loop: assured": [*ONE_SHORT, "--controllers", "policy"],
    "closed_loop: error_scale": [*ONE_SHORT, "--scales", "2"],
    "closed_loop: expert": [*ONE_SHORT, "--only", "weighted"],
    "closed_loop: hybrid": [*ONE_SHORT, "--only", "strict, 10"],
    "closed_loop: one_at_a_time": [*ONE_SHORT, "--only", "truth.density_contrast x 1"],
    "closed_loop: other_forms": [*ONE_SHORT, "--only", "boulders and craters"],
    "closed_loop: schedule": [*ONE_FLIGHT, "--duration", "100"],
    "minimum_fuel": [*ONE_FLIGHT, "--intervals", "20"],
    "minimum_fuel: touch": [*ONE_FLIGHT, "--touch"],
    "navigation": ["--only", "accuracy", "--bodies", "kleopatra", *ONE_FLIGHT],
}

# They compare with programs that the tests do not install.
WITH_PEERS = {"agreement", "flight", "gravity", "lidar", "mpc_step"}

# Its two actions belong together; and of one that makes a map, the map is tested.
SAME_FLIGHTS, MAPPING = "same_flights", "mapping"


def test_every_benchmark_is_run() -> None:
    found = {path.stem for path in BENCHMARKS.glob("[a-z]*.py")}
    assert found == {name.partition(":")[0] for name in RUNS} | WITH_PEERS | {SAME_FLIGHTS, MAPPING}
    assert len(found) <= 12


@pytest.mark.slow
@pytest.mark.filterwarnings("default")
@pytest.mark.parametrize("name", RUNS)
def test_a_benchmark_runs(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    script, _, study = name.partition(": ")
    own = [study] if script == "closed_loop" else []
    monkeypatch.chdir(tmp_path)
    run_script(BENCHMARKS / f"{script}.py", *own, *RUNS[name])
    assert re.search(r"\d", capfd.readouterr().out), "it prints no figure"


@pytest.mark.slow
def test_a_flight_is_the_same_again(tmp_path: Path) -> None:
    one = ["flights.json", "--only", "on navigation, drawn world, assured"]
    run(SAME_FLIGHTS, ["record", *one], tmp_path)
    run(SAME_FLIGHTS, ["compare", *one], tmp_path)


@pytest.mark.slow
def test_a_survey_and_a_visit(tmp_path: Path) -> None:
    run(MAPPING, ["kleopatra", "--seeds", "1:2", "--hours", "15"], tmp_path)
    folder = tmp_path / "out" / "mapping" / "kleopatra-1"
    figures = json.loads((folder / "survey.json").read_text())
    assert figures["map_rms_of_size"] < 5e-4
    assert figures["within_3_sigma"] > 0.98
    assert figures["keep_out_entries"] == 0
    assert abs(figures["gravity_error"]) < 0.01
    assert figures["pole_error_deg"] < 0.05
    assert not figures["collided"]
    # At a sharp edge the map is farther off than its deviations say.
    with pytest.warns(UserWarning, match=r"assurance\.bounds.*surface_m"):
        log = fly(load_scenario(folder / "visit.yaml"), "mpc")
    assert log.summary["success"]
    assert log.summary["navigation_consistent"] > 0.95


def run(name: str, options: list[str], folder: Path) -> str:
    """What a benchmark prints, run in a folder."""
    command = [sys.executable, BENCHMARKS / f"{name}.py", *options]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout
