"""Flights at a body with moons: they pull, nobody on board is told where they are."""

import dataclasses as dc

import numpy as np
import pytest
from short_flights import BRIEF, kleopatra, short_scenario, write_blob

from proxops.diagrams.flight import fly
from proxops.diagrams.logs import FlightLog
from proxops.diagrams.scenario import World, load_body, load_scenario, scenario_remarks
from proxops.diagrams.scenario.body import Body
from proxops.systems import InputError
from proxops.systems.gravity import MoonConfig, moon_position, tide_of

# Heavier than they are, so that a brief flight shows it.
MOONS = [
    MoonConfig(2e18, 4e3, 655e3, 2.3e5, 0.1, 20.0, 30.0, 40.0, 50.0),
    MoonConfig(1e18, 3e3, 454e3, 1.1e5),
]


def with_moons(moons=MOONS) -> Body:
    return Body(dc.replace(kleopatra().config, moons=[*moons]), kleopatra().shape)


def test_a_flight_feels_their_tide():
    """The difference of two flights is twice the integral of the tide along the way."""
    scenario = short_scenario(**BRIEF)
    states, others = (
        fly(scenario, "zero", body=body).dataset["state"].values
        for body in (with_moons(), kleopatra())
    )
    tides = np.array(
        [
            sum(
                np.array(
                    tide_of(moon.mass_kg, moon_position(moon, time, kleopatra().spin), state[:3])
                )
                for moon in MOONS
            )
            for time, state in zip(10.0 * np.arange(len(states)), states, strict=True)
        ]
    )
    end = 10.0 * (len(states) - 1)
    assert np.linalg.norm(states[-1, :3] - others[-1, :3]) > 0.5
    moved = 0.5 * tides.mean(axis=0) * end**2
    # K turns by 3 degrees meanwhile.
    off = np.linalg.norm(states[-1, :3] - others[-1, :3] - moved)
    assert off < 0.03 * np.linalg.norm(moved)


def test_navigation_and_assurance_count_them():
    settings = {"assurance": {}}
    told, plain = (
        World.of(load_scenario(None, settings), body) for body in (with_moons(), kleopatra())
    )
    worst = 0.0
    for direction in np.eye(3):
        for time in np.linspace(0.0, 2e5, 20):
            tides = [
                tide_of(each.mass_kg, moon_position(each, time, told.body.spin), 280e3 * direction)
                for each in MOONS
            ]
            worst = max(worst, float(np.abs(np.sum(tides, axis=0)).max()))
    more = told.uncertainty_set.acceleration_m_s2 - plain.uncertainty_set.acceleration_m_s2
    assert 0.1 * more < worst < more
    assert told.filter_tuning.acceleration_varying_m_s2 > 0.05 * worst


def test_moons_of_a_file(tmp_path):
    moons = "[{mass_kg: 1e15, semi_major_axis_m: 655e3, period_s: 2e5, eccentricity: 0.1}]"
    body = load_body(write_blob(tmp_path, moons=moons))
    assert body.config.moons[0].eccentricity == 0.1
    for wrong, words in (
        ("[{mass_kg: 1e15, eccentricity: 2}]", r"moons\[0\].*eccentricity"),
        ("[{mass: 1e15}]", r"moons\[0\].*no key 'mass'"),
        ("[5]", "moons needs a list"),
    ):
        with pytest.raises(InputError, match=words):
            load_body(write_blob(tmp_path, moons=wrong))


def test_what_a_moon_meets_is_refused():
    """A goal where the moon will be, and assurance whose ellipsoid does not hold its orbit."""
    moon = MoonConfig(1e15, 5e3, 160e3, 1e5)
    body = with_moons([moon])
    place = moon_position(moon, 1e3, kleopatra().spin)
    settings = {"transit.start_m": [0.0, 0.0, 160e3], "transit.goal_m": place.tolist()}
    with pytest.raises(InputError, match=r"the goal is .* m from the centre of a moon"):
        World.of(load_scenario(None, settings), body)
    assert any("a moon of" in each for each in scenario_remarks(load_scenario(None), body))
    with pytest.raises(InputError, match="not always inside the keep-out ellipsoid"):
        _ = World.of(load_scenario(None, {"assurance": {}}), body).uncertainty_set


def test_a_log_keeps_the_mesh_of_a_moon(tmp_path):
    """And the lidar of the flight sees the moon."""
    body = load_body("didymos")
    limits = {"arrival.deadline_s": 30.0, "arrival.dwell_s": 10.0, "transit.seed": 100}
    log = fly(load_scenario("didymos", limits), "zero", body=body)
    log.to_netcdf(tmp_path / "flight.nc")
    again = FlightLog.load(tmp_path / "flight.nc")
    np.testing.assert_array_equal(again.body.moons[0].shape.vertices, body.moons[0].shape.vertices)
    assert again.body.moons[0].shape.sha256 == body.moons[0].shape.sha256
