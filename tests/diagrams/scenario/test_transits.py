"""The standard transits keep their rules, judged by code that shares nothing with theirs."""

import dataclasses as dc

import numpy as np
import pytest
from plain_polyhedral_gravity import PlainPolyhedralGravity
from short_flights import kleopatra, write_blob
from transit_sets import transit_set

from proxops.diagrams.scenario.scenario import load_scenario
from proxops.diagrams.scenario.scenario_config import Scenario
from proxops.diagrams.scenario.transits import Transit, draw_transit, scenario_transit
from proxops.systems.common.errors import InputError

AXES = np.array([140e3, 70e3, 65e3])


@pytest.fixture(scope="module")
def transits() -> list[Transit]:
    return transit_set(10000, 100)


def ends(transits: list[Transit]) -> np.ndarray:
    return np.array([[transit.start, transit.goal] for transit in transits])


def same(first: Transit, second: Transit) -> bool:
    return np.array_equal(ends([first]), ends([second]))


def test_in_the_cube(transits: list[Transit]) -> None:
    assert np.abs(ends(transits)).max() <= 170e3
    # And all over it, not in a corner.
    assert (ends(transits).reshape(-1, 3).min(axis=0) < -140e3).all()
    assert (ends(transits).reshape(-1, 3).max(axis=0) > 140e3).all()


def test_distances(transits: list[Transit]) -> None:
    lengths = np.linalg.norm(np.diff(ends(transits), axis=1)[:, 0], axis=1)
    assert lengths.min() >= 40e3
    assert lengths.max() <= 160e3


def test_ends_clear_of_the_keep_out(transits: list[Transit]) -> None:
    assert np.sum((ends(transits) / (AXES + 8e3)) ** 2, axis=-1).min() >= 1.0


def test_blocked_three_in_ten(transits: list[Transit]) -> None:
    """By 20,001 points on each line: 8 m apart at most."""
    share = np.linspace(0.0, 1.0, 20_001)[:, None]
    for number, transit in enumerate(transits):
        line = transit.start + share * (transit.goal - transit.start)
        blocked = bool((np.sum((line / AXES) ** 2, axis=1) < 1.0).any())
        assert blocked == (number % 10 in {1, 4, 7}), number


def test_hover_share() -> None:
    """A spacecraft so heavy that the rule binds; gravity by the plain reference."""
    scenario = load_scenario(None, {"spacecraft.mass_kg": 220.0})
    points = ends(transit_set(7, 30, scenario)).reshape(-1, 3)
    shape = kleopatra().shape
    plain = PlainPolyhedralGravity(shape.vertices, shape.facets, 2.97e18 / shape.volume)
    gravity = np.array([plain.at(point).acceleration for point in points])
    spin = 2.0 * np.pi / (5.38528 * 3600.0)
    apparent = gravity + spin**2 * points * [1.0, 1.0, 0.0]
    force = 220.0 * np.abs(apparent).max(axis=1)
    assert force.max() <= 0.7 * 7.0 * (1.0 + 1e-9)
    assert force.max() > 0.6 * 7.0  # It does bind.


def test_function_of_seed_number_and_scenario_alone(transits: list[Transit]) -> None:
    np.random.seed(5)  # noqa: NPY002 (the global generator must have no say)
    alone = draw_transit(10000, 57, Scenario(), kleopatra())
    assert same(alone, transits[57])
    # What the rules don't speak of changes nothing.
    other = load_scenario(None, {"noise_seed": 9, "mpc.intervals": 8, "transit.index": 3})
    assert same(draw_transit(10000, 57, other, kleopatra()), transits[57])


def test_rules_of_a_scenario(tmp_path) -> None:
    rules = {
        "body": write_blob(tmp_path),
        "transit.cube_m": 400e3,
        "transit.min_distance_m": 10e3,
        "transit.max_distance_m": 20e3,
        "transit.end_clearance_m": 100.0,
    }
    scenario = load_scenario(None, rules)
    drawn = ends([draw_transit(3, k, scenario, kleopatra()) for k in (0, 2, 3)])
    lengths = np.linalg.norm(np.diff(drawn, axis=1)[:, 0], axis=1)
    assert ((lengths >= 10e3) & (lengths <= 20e3)).all()


@pytest.mark.parametrize(
    "changes",
    [
        {"transit.cube_m": 100e3},  # All of it is keep-out.
        {"transit.min_distance_m": 590e3, "transit.max_distance_m": 600e3},
        {"spacecraft.mass_kg": 3000.0},  # 7 N hold it nowhere.
    ],
)
def test_impossible_rules_refused(
    changes: dict[str, float], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("proxops.diagrams.scenario.transits._ATTEMPTS", 1000)
    with pytest.raises(InputError, match=r"no transit was found .* check transit\.cube_m"):
        transit_set(1, 1, load_scenario(None, changes))


@pytest.mark.parametrize(
    ("start", "goal", "complaint"),
    [
        ([0.0, 0.0, 0.0], [160e3, 0.0, 0.0], r"start_m .* is inside Kleopatra"),
        ([160e3, 0.0, 0.0], [0.0, 0.0, 5e3], r"goal_m .* is inside Kleopatra"),
        ([0.0, 0.0, 60e3], [160e3, 0.0, 0.0], r"start_m .* is 5 km inside the keep-out"),
        ([160e3, 0.0, 0.0], [0.0, -69e3, 0.0], r"goal_m .* is 1 km inside the keep-out"),
        ([160e3, 0.0, 0.0], [900e3, 0.0, 0.0], r"goal_m .* cannot be held: .* 9\.\d* N"),
    ],
)
def test_senseless_ends_refused(start: list[float], goal: list[float], complaint: str) -> None:
    scenario = Scenario()
    scenario.transit = dc.replace(scenario.transit, start_m=start, goal_m=goal)
    with pytest.raises(InputError, match=complaint):
        scenario_transit(scenario, kleopatra())
