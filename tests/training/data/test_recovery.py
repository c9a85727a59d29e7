"""The kinds of flights in a training set: how many of each, and where they start."""

import collections

import numpy as np
import pytest
from scipy import stats
from scipy.optimize import minimize
from short_flights import kleopatra
from transit_sets import transit_set

from proxops.diagrams.scenario import Scenario, check_scenario, load_scenario, scenario_transit
from proxops.systems import InputError
from proxops.training.data.recovery import KINDS, MIXES, flight_scenario, kind_of, parse_mix

AXES = np.array([140e3, 70e3, 65e3])
COUNT = 80


def flown(kind: str, index: int, wanted: Scenario | None = None, seed: int = 3) -> Scenario:
    return flight_scenario(kind, wanted or Scenario(), kleopatra(), seed, index)


def starts(kind: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Start, start velocity and goal, (COUNT, 3) each."""
    transits = [scenario_transit(flown(kind, index), kleopatra()) for index in range(COUNT)]
    return (
        np.array([transit.start for transit in transits]),
        np.array([transit.start_velocity for transit in transits]),
        np.array([transit.goal for transit in transits]),
    )


# --- mixes ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("text", [*MIXES, "holding", "noise=5,kicks=2", "nominal=1,noise=0"])
def test_shares_are_kept_all_along(text: str) -> None:
    mix = parse_mix(text) if "=" in text or text in MIXES else parse_mix(f"{text}=1")
    total = sum(mix.values())
    kinds = [kind_of(mix, index) for index in range(40 * total)]
    assert collections.Counter(kinds) == {k: 40 * weight for k, weight in mix.items() if weight}
    for end in range(1, len(kinds)):
        for kind, weight in mix.items():
            # A shift of the cycle repeats or leaves out one place.
            behind = abs(kinds[:end].count(kind) - end * weight / total)
            assert behind <= 2.0 + end / (total * 10)


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("papers", "'papers' is none; name one of paper, full"),
        ("kick=1", "no kind 'kick'; there are nominal"),
        ("kicks", "the weight of kicks must be a whole number"),
        ("kicks=0.5", "the weight of kicks must be a whole number"),
        ("kicks=1,kicks=2", "names kicks twice"),
        ("kicks=0", "must come to between 1 and 10,000"),
        ("kicks=1,,noise=1", "name one of paper"),
    ],
)
def test_senseless_mixes_are_refused(text: str, complaint: str) -> None:
    with pytest.raises(InputError, match=complaint):
        parse_mix(text)


# --- kinds ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", KINDS)
def test_goals_are_the_set_s_and_scenarios_are_sound(kind: str) -> None:
    transits = transit_set(3, 12)
    for index, transit in enumerate(transits):
        scenario = flown(kind, index)
        check_scenario(scenario)
        assert (scenario.transit.seed, scenario.transit.index) == (3, index)
        assert np.array_equal(scenario_transit(scenario, kleopatra()).goal, transit.goal)
        assert flown(kind, index) == scenario
    assert flown(kind, 0, seed=4) != flown(kind, 0)


def test_overshoot_starts_beyond_the_goal_and_moves_away() -> None:
    start, velocity, goal = starts("overshoot")
    origin = np.array([transit.start for transit in transit_set(3, COUNT)])
    line = (goal - origin) / np.linalg.norm(goal - origin, axis=1, keepdims=True)
    beyond, distance = np.sum((start - goal) * line, axis=1), np.linalg.norm(start - goal, axis=1)
    away, speed = np.sum(velocity * line, axis=1), np.linalg.norm(velocity, axis=1)
    assert (beyond > 0.0).all()
    assert (away > 0.0).all()
    # Mostly along the line.
    assert np.median(beyond / distance) > 0.95
    assert np.median(away / speed) > 0.95
    assert distance.max() <= 8e3
    assert speed.max() <= 8.0
    assert stats.kstest(distance / 8e3, "uniform").pvalue > 1e-3
    assert stats.kstest(speed / 8.0, "uniform").pvalue > 1e-3


def clearance(point: np.ndarray) -> float:
    """Clearance from the keep-out, by a general minimiser over the two angles of its surface."""

    def surface(angles: np.ndarray) -> np.ndarray:
        cos = np.cos(angles[0])
        return AXES * [cos * np.cos(angles[1]), cos * np.sin(angles[1]), np.sin(angles[0])]

    unit = point / AXES / np.linalg.norm(point / AXES)
    guess = [np.arcsin(unit[2]), np.arctan2(unit[1], unit[0])]
    found = minimize(lambda angles: np.sum(((point - surface(angles)) / 1e3) ** 2), guess)
    return float(1e3 * np.sqrt(found.fun))


def test_keep_out_starts_near_the_ellipsoid_and_can_stop() -> None:
    start, velocity, goal = starts("keep_out")
    outside = np.sum((start / AXES) ** 2, axis=1)
    assert (outside > 1.0).all()
    clear = np.array([clearance(point) for point in start])
    assert clear.max() < 8e3 + 1.0
    # All over the range; velocities that cannot stop make the lowest rarer.
    assert np.histogram(clear, [0, 2e3, 4e3, 6e3, 8e3])[0].min() > COUNT / 8
    normal = start / AXES**2
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    inward = np.maximum(0.0, -np.sum(velocity * normal, axis=1))
    assert (inward**2 / (2.0 * 0.07) < clear + 1.0).all()
    assert 3.0 < np.std(velocity) < 6.0
    assert np.abs(velocity).max() <= 40.0
    distance = np.linalg.norm(start - goal, axis=1)
    assert distance.min() >= 40e3
    # Some goals are that far from the ellipsoid itself.
    assert np.mean(distance <= 160e3) > 0.9
    assert distance.max() < 240e3
    # On every side of the body.
    assert (np.abs(np.sign(start).mean(axis=0)) < 0.4).all()


def test_holding_starts_within_the_goal_region() -> None:
    start, velocity, goal = starts("holding")
    distance, speed = np.linalg.norm(start - goal, axis=1), np.linalg.norm(velocity, axis=1)
    # Uniform in a ball: the share within r goes as its cube.
    assert stats.kstest((distance / 1e3) ** 3, "uniform").pvalue > 1e-3
    assert stats.kstest(speed**3, "uniform").pvalue > 1e-3


def test_where_no_start_is_to_be_found() -> None:
    """All starts that are drawn are faster than the spacecraft may be."""
    slow_craft = ["arrival.speed_m_s=1e5", "spacecraft.speed_limit_m_s=0.01"]
    wanted = load_scenario(None, slow_craft)
    with pytest.raises(InputError, match="no start was found for flight 0 of seed 3, kind oversh"):
        flown("overshoot", 0, wanted)
