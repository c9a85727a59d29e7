"""Every benchmark runs, at its smallest size: nobody learns years later that its command is broken.

What a benchmark computes is tested elsewhere, or is a figure and no test. `make bench` runs others.
"""

import re
import subprocess
import sys
from pathlib import Path

import pytest
from pages import ROOT

BENCHMARKS = ROOT / "benchmarks"

ONE_FLIGHT = ["--transits", "1", "--workers", "1"]
POLICY = ["--controllers", "policy"]

# The smallest size that goes through all of a benchmark.
RUNS = {
    "ablation": ONE_FLIGHT,
    "any_body": [*ONE_FLIGHT, "--bodies", "kleopatra", "--only", "policy"],
    "any_body_ablation": [*ONE_FLIGHT, "--bodies", "kleopatra"],
    "any_body_map": [*ONE_FLIGHT, "--members", "1", "--map", "map.png"],
    "assurance": ["--flights", "4", "--steps", "30", "--bare", "1"],
    "assurance_end": ["--states", "50"],
    "assured_transits": [*ONE_FLIGHT, *POLICY, "--twice"],
    "costs": [*POLICY, "--flights", "1", "--workers", "1"],
    "dataset": ["--flights", "1", "--rounds", "1"],
    "environment": ["--transits", "4", "--steps", "3"],
    "error_scale": [*ONE_FLIGHT, "--scales", "1", "2"],
    "expert": [*ONE_FLIGHT, "--only", "weighted"],
    "gravity_kinds": ["--bounds", "1e-3", "--degrees", "5"],
    "gravity_limits": [],
    "gravity_of_flights": [*ONE_FLIGHT, *POLICY],
    "hybrid": [*ONE_FLIGHT, "--only", "strict, 10"],
    "hybrid_safety": [*ONE_FLIGHT, "--duration", "100"],
    "minimum_fuel": [*ONE_FLIGHT, "--intervals", "20"],
    "modelling_limits": [],
    "navigation": ["--only", "accuracy", "--bodies", "kleopatra", *ONE_FLIGHT],
    "other_forms": [*ONE_FLIGHT, "--only", "boulders and craters"],
    "robustness": [*ONE_FLIGHT, "--only", "truth.density_contrast"],
}

# They compare with programs that the tests do not install.
WITH_PEERS = {"agreement", "agreement_of_parts", "flight", "gravity", "lidar", "mpc_step"}

# Its two actions belong together.
SAME_FLIGHTS = "same_flights"


def test_every_benchmark_is_run() -> None:
    found = {path.stem for path in BENCHMARKS.glob("[a-z]*.py")}
    assert found == RUNS.keys() | WITH_PEERS | {SAME_FLIGHTS}


@pytest.mark.slow
@pytest.mark.parametrize("name", RUNS)
def test_a_benchmark_runs(name: str, tmp_path: Path) -> None:
    assert re.search(r"\d", run(name, RUNS[name], tmp_path)), "it prints no figure"


@pytest.mark.slow
def test_flights_are_the_same_again(tmp_path: Path) -> None:
    run(SAME_FLIGHTS, ["record", "flights.json"], tmp_path)
    run(SAME_FLIGHTS, ["compare", "flights.json"], tmp_path)


def run(name: str, options: list[str], folder: Path) -> str:
    """What a benchmark prints, run in a folder."""
    command = [sys.executable, BENCHMARKS / f"{name}.py", *options]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout
