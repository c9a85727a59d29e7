"""The robustness table: its starts are where they should be, its variants what they are named."""

import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from benchmark_scripts import load_script
from known_policies import DeadReckoning, write_policy
from short_flights import kleopatra
from test_evaluation import row

from proxops.diagrams.flight.campaign import Flight
from proxops.diagrams.scenario.scenario import load_scenario, parse_scenario
from proxops.diagrams.scenario.scenario_config import Scenario
from proxops.diagrams.scenario.transits import draw_transit, hover_force, scenario_transit
from proxops.studies.evaluation.variants import variant_flights
from proxops.systems.shapes.ellipsoid import clearances

AXES = np.array([140e3, 70e3, 65e3])
COUNT = 30


@pytest.fixture(scope="module")
def robustness() -> ModuleType:
    return load_script("robustness")


def flights_of(robustness: ModuleType, name: str, count: int) -> list[Flight]:
    [variant] = [each for each in robustness.variants("zero") if each.name == name]
    plain = load_scenario(None, {"log_ranges": False})
    return variant_flights(variant, plain, 10001, range(count))


def names_of(robustness: ModuleType) -> list[str]:
    return [each.name for each in robustness.variants("zero")]


def flown(robustness: ModuleType, variant: str, count: int = COUNT) -> list[Scenario]:
    return [parse_scenario(each.scenario) for each in flights_of(robustness, variant, count)]


def test_every_variant_differs_from_the_first_by_what_it_says(robustness: ModuleType) -> None:
    [nominal] = flown(robustness, "nominal", 1)
    assert nominal == load_scenario(None, {"log_ranges": False, "transit.seed": 10001})
    found = {name: flown(robustness, name, 1)[0] for name in names_of(robustness)}
    assert len(found) == 15
    assert found["lidar noise x 4"].lidar.noise_std_m == 4.0 * nominal.lidar.noise_std_m
    assert found["20 % dropout"].lidar.dropout == 0.2
    assert found["1 % false returns"].lidar.false_returns == 0.01
    assert found["attitude error 0.1°"].lidar.attitude_error_deg == 0.1
    for what in ("gravity", "mass", "thrust"):
        by = "0.2" if what == "gravity" else "0.1"
        for factor in (1.0 - float(by), 1.0 + float(by)):
            assert getattr(found[f"{what} x {factor:g}"].mismatch, what) == factor
    assert found["the paper's disturbance"].disturbance is not None
    assert sum(scenario == nominal for scenario in found.values()) == 1
    names = [flights_of(robustness, name, 1)[0].name for name in names_of(robustness)]
    assert len(set(names)) == 15


def test_starts(robustness: ModuleType) -> None:
    body = kleopatra()
    starts, goals = {}, {}
    for variant in robustness.STARTS:
        scenarios = flown(robustness, variant)
        assert flown(robustness, variant, 5) == scenarios[:5]
        transits = [scenario_transit(scenario, body) for scenario in scenarios]
        starts[variant] = np.array([transit.start for transit in transits])
        goals[variant] = np.array([transit.goal for transit in transits])
        velocities = np.array([transit.start_velocity for transit in transits])
        speed = 20.0 if variant == robustness.MOVING else 0.0
        np.testing.assert_allclose(np.linalg.norm(velocities, axis=1), speed)
        assert (hover_force(starts[variant], scenarios[0], body) <= 0.7 * 7.0).all()

    plain = [draw_transit(10001, k, load_scenario(), body) for k in range(COUNT)]
    for found in goals.values():
        np.testing.assert_array_equal(found, [transit.goal for transit in plain])
    np.testing.assert_array_equal(starts[robustness.MOVING], [transit.start for transit in plain])

    outside = starts[robustness.OUTSIDE]
    assert ((outside != 0.0).sum(axis=1) == 1).all()
    reach = np.linalg.norm(outside, axis=1)
    assert 190e3 <= reach.min() < 195e3
    assert 215e3 < reach.max() <= 220e3
    # No so far from the goal that nobody could arrive in time, at 40 m/s per axis.
    assert np.abs(outside - goals[robustness.OUTSIDE]).max() < 0.7 * 40.0 * 7200.0

    apart = np.linalg.norm(starts[robustness.INSIDE_MARGIN] - goals[robustness.OUTSIDE], axis=1)
    assert 40e3 <= apart.min() < apart.max() < 200e3
    clearance = clearances(AXES, starts[robustness.INSIDE_MARGIN])
    assert 300.0 <= clearance.min() < 800.0
    assert 2.5e3 < clearance.max() <= 3e3


def test_moving_starts_can_stop(robustness: ModuleType) -> None:
    """At half of the thrust, straight against the motion; and they do move in all directions."""
    ways = []
    for scenario in flown(robustness, robustness.MOVING):
        transit = scenario_transit(scenario, kleopatra())
        way = transit.start_velocity / 20.0
        path = transit.start + np.linspace(0.0, 20.0**2 / (2.0 * 0.035), 200)[:, None] * way
        assert clearances(AXES, path).min() > -50.0
        ways.append(way)
    assert (np.abs(np.mean(ways, axis=0)) < 0.5).all()


def test_figures(robustness: ModuleType) -> None:
    rows = [row(delta_v_m_s=100.0), row(terminal_position_error_m=3.0), row(
        success=False, success_2km=True, keep_out_violations=2, delta_v_m_s=1.0,
        terminal_position_error_m=2.0,
    )]  # fmt: skip
    assert robustness.figures(rows) == ["2/3", "3/3", "0", "2", "2.0", "2.9", "125.0"]
    assert robustness.figures([row(success=False)])[-1] == "–"
    assert len(robustness.figures(rows)) == len(robustness.HEADINGS)


@pytest.mark.slow
def test_flies_resumes_and_writes_the_table(
    robustness: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    bundle = write_policy(tmp_path / "policy", DeadReckoning())
    brief = {"arrival.deadline_s": 50.0, "arrival.dwell_s": 50.0}
    monkeypatch.setattr(
        robustness, "load_scenario", lambda path, settings: load_scenario(path, settings | brief)
    )
    words = ["robustness.py", "--controller", f"policy:{bundle}", "--transits", "2",
             "--workers", "1", "--out", str(tmp_path / "out"),
             "--markdown", str(tmp_path / "table.md")]  # fmt: skip
    monkeypatch.setattr(sys, "argv", words)
    robustness.main()
    table = (tmp_path / "table.md").read_text()
    assert [line.split(" | ")[0].strip("| ") for line in table.splitlines()[2:]] == [
        *names_of(robustness)
    ]
    assert table.count("0/2") == 30
    times = {path: path.stat().st_mtime_ns for path in (tmp_path / "out").glob("*.json")}
    assert len(times) == 30
    robustness.main()
    assert {path: path.stat().st_mtime_ns for path in times} == times
    assert "start inside the margin" in capsys.readouterr().out


def test_a_wrong_policy_ends_it_with_a_message(
    robustness: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        sys, "argv",
        ["robustness.py", "--controller", f"policy:{tmp_path}", "--out", str(tmp_path / "out")],
    )  # fmt: skip
    with pytest.raises(SystemExit, match="not the bundle of a policy"):
        robustness.main()
