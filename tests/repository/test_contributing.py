"""The worked examples of CONTRIBUTING.md do what they say, in a copy of the product."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from pages import PAGES, ROOT

EXAMPLES = re.findall(r"^```diff\n(.*?)^```", PAGES["CONTRIBUTING.md"], re.MULTILINE | re.DOTALL)
ALTIMETER, CURVATURE = EXAMPLES
FLY = """
import numpy as np
from proxops.diagrams.flight import fly
from proxops.diagrams.scenario import load_scenario
short = {"arrival.deadline_s": 60.0, "arrival.dwell_s": 10.0}
"""


def run_in_copy(folder: Path, difference: str, script: str) -> str:
    """Applies a diff to a copy of the product, and runs a script there; gives what it prints."""
    copy = folder / "proxops"
    for name in ("assets", "systems", "diagrams"):
        shutil.copytree(ROOT / name, copy / name, ignore=shutil.ignore_patterns("__pycache__"))
    subprocess.run(
        ["git", "apply", "--unidiff-zero", "-"], cwd=copy, input=difference, text=True, check=True
    )
    environment = os.environ | {"PYTHONPATH": str(folder)}
    done = subprocess.run(
        [sys.executable, "-c", FLY + script],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.slow
def test_an_altimeter_is_added(tmp_path: Path) -> None:
    script = """
log = fly(load_scenario(altimeter={"bias_m": 5.0}, **short), "zero")
true = np.linalg.norm(log.dataset["state"].values[:, :3], axis=1)
np.testing.assert_allclose(log.dataset["altitude"].values, true + 5.0, rtol=0.0, atol=1e-6)
print(log.dataset["altitude"].attrs["units"], load_scenario().altimeter)
"""
    assert run_in_copy(tmp_path, ALTIMETER, script) == "m None\n"


@pytest.mark.slow
def test_an_uncertain_quantity_is_added(tmp_path: Path) -> None:
    lines = [line for line in CURVATURE.splitlines() if re.match(r"[+-](?![+-])", line)]
    assert len(lines) <= 25
    assert CURVATURE.count("+++") <= 4
    script = """
exact = {"lidar.noise_std_m": 0.0, **short}
plain, curved = (
    fly(load_scenario(**exact, **{"truth.lidar.curvature_per_m": c}), "zero") for c in (0.0, 1e-6)
)
r, found = (log.dataset["ranges"].values.astype(float) for log in (plain, curved))
seen = np.isfinite(r)
np.testing.assert_allclose(found[seen], r[seen] + 1e-6 * r[seen] ** 2, rtol=1e-6)
from proxops.diagrams.scenario import draw_world, load_body, of_transit
scenario = load_scenario(dispersions="after_survey")
draw = lambda k: draw_world(of_transit(scenario, 1, k), load_body("kleopatra")).truth.lidar
values = [draw(k).curvature_per_m for k in range(3)]
assert len(set(values)) == 3 and max(map(abs, values)) <= 1e-9
print(seen.any())
"""
    assert run_in_copy(tmp_path, CURVATURE, script) == "True\n"
