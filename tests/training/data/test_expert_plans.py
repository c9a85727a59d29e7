"""Plans as labels: they say what the expert itself commands there, and are computed once."""

from pathlib import Path

import numpy as np
import pytest
from short_flights import kleopatra

from proxops.diagrams.flight import Workers, make_mpc
from proxops.diagrams.scenario.scenario import load_scenario
from proxops.systems import InputError
from proxops.training.data.label_files import labels_of
from proxops.training.data.plans import expert_plans, transit_plans


def test_the_force_at_a_knot_is_what_the_expert_commands_there():
    scenario = load_scenario()
    program = make_mpc(scenario, kleopatra()).program
    differences = []
    for index in range(4):
        plans = transit_plans(program, scenario, kleopatra(), 3, index)
        plan = plans[0]
        for knot in (3, 8, 12):
            fresh = program.solve(plan.states[knot], plan.target, plan, plan.times[knot], 5)
            differences.append(np.abs(fresh.forces[0] - plan.forces[knot]).max())
    # Fresh plans have shorter intervals, so a force is a mean over less of the time to come.
    assert np.median(differences) < 0.15
    assert np.max(differences) < 1.0


def test_labels_are_what_the_expert_commands_there_near_the_goal_too():
    """A fresh plan of those that aim at the label's goal, from the label's state."""
    scenario = load_scenario()
    program = make_mpc(scenario, kleopatra()).program
    differences = []
    for index in range(3):
        plans = transit_plans(program, scenario, kleopatra(), 4, index)
        labels = labels_of(plans, scenario.mpc.min_horizon_s)
        assert len(labels["state"]) > 2 * len(plans)
        left = np.linalg.norm(labels["state"][:, :3] - labels["goal"], axis=1)
        for k in np.argsort(left)[:60:3]:
            state, target = labels["state"][k], np.append(labels["goal"][k], np.zeros(3))
            fresh = program.solve(state, target, iterations=10)
            differences.append(np.linalg.norm(fresh.forces[0] - labels["force"][k]))
    assert np.median(differences) < 0.2
    assert np.quantile(differences, 0.9) < 0.7


def test_is_computed_once_and_alike(tmp_path: Path):
    scenario = load_scenario()
    told: list[tuple[float, str]] = []
    first = expert_plans(scenario, 5, 2, tmp_path / "one", workers=Workers(1))
    path = tmp_path / "one" / "plans-5-000000.npz"
    written = path.stat().st_mtime_ns
    workers = Workers(1, progress=lambda *now: told.append(now))
    again = expert_plans(scenario, 5, 2, tmp_path / "one", workers)
    assert path.stat().st_mtime_ns == written
    assert told == [(1.0, "plans of transits, 2 of 2")]
    other = expert_plans(scenario, 5, 2, tmp_path / "two", workers=Workers(1))
    for key in first:
        np.testing.assert_array_equal(first[key], again[key])
        np.testing.assert_array_equal(first[key], other[key])


def test_files_that_are_not_theirs_are_refused(tmp_path: Path):
    expert_plans(load_scenario(), 5, 1, tmp_path, workers=Workers(1))
    path = tmp_path / "plans-5-000000.npz"
    with pytest.raises(InputError, match="labels of other flights"):
        expert_plans(
            load_scenario(None, ["spacecraft.mass_kg=90"]), 5, 1, tmp_path, workers=Workers(1)
        )
    path.write_bytes(path.read_bytes()[:500])
    with pytest.raises(InputError, match="plans-5-000000"):
        expert_plans(load_scenario(), 5, 1, tmp_path, workers=Workers(1))


def test_a_cube_within_the_ellipsoid_is_refused(tmp_path: Path, monkeypatch):
    """Kleopatra's ellipsoid and its margin reach beyond this cube on all sides."""
    monkeypatch.setattr("proxops.training.data.plans._MOST_DRAWS", 1000)
    scenario = load_scenario(None, {"transit.cube_m": 50e3, "transit.min_distance_m": 1e3})
    with pytest.raises(InputError, match=r"transit.cube_m \(50000 m\) that lie outside"):
        expert_plans(scenario, 3, 1, tmp_path, workers=Workers(1))
    assert not list(tmp_path.glob("*.npz"))
