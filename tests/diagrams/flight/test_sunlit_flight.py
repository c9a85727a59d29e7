"""Flights in sunlight, against an integration in N in which the Sun is a place far away."""

from __future__ import annotations

import dataclasses as dc

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from short_flights import BRIEF, kleopatra, short_scenario

from proxops.diagrams.flight import fly, make_transit_diagram
from proxops.diagrams.logs import FlightLog
from proxops.diagrams.scenario import check_scenario, filter_tuning, load_scenario
from proxops.systems.common import InputError
from proxops.systems.navigation import LidarNavigationConfig
from proxops.systems.vehicle.sunlight import in_shadow

AU, SUN = 149_597_870_700.0, 1.3271244e20
# A sail of 10,000 m^2 on 100 kg, so that it moves by metres in two minutes.
SAIL = {"direction": [0.6, 0.0, -0.8], "area_m2": 1e4, "distance_au": 1.0, "reflectivity": 1.5}
PUSH = 1361.0 / 299_792_458.0 * 1.5 * 1e4 / 100.0


def zero_flight(**changes: object) -> FlightLog:
    return fly(short_scenario(**changes), "zero", body=kleopatra())


def in_n(start: np.ndarray, end: float, sun, push: float, shade: bool, step: float = np.inf):
    """Position and velocity (3,) in N at the end (s) of a fall from a state (6,) in K.

    `sun` gives the direction (3,) in N at a time. Light and tide are made anew here: the tide is a
    difference of two pulls, and the shadow is looked for at every evaluation.
    """
    body = kleopatra()
    rate, field = body.spin_rate, body.gravity_field

    def derivative(time, y):
        cos, sin = np.cos(rate * time), np.sin(rate * time)
        turn = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
        place, towards = turn.T @ y[:3], sun(time)
        far = AU * towards
        pull = turn @ field.evaluate(place[None]).acceleration[0]
        tide = SUN * ((far - y[:3]) / np.linalg.norm(far - y[:3]) ** 3 - far / AU**3)
        dark = shade and in_shadow(body.shape, place[None], (turn.T @ towards)[None])[0]
        return np.concatenate([y[3:], pull + tide - (0.0 if dark else push) * towards])

    spun = start[3:] + np.cross([0.0, 0.0, rate], start[:3])
    path = solve_ivp(
        derivative, (0.0, end), np.concatenate([start[:3], spun]), "DOP853",
        rtol=1e-11, atol=1e-9, max_step=step,
    )  # fmt: skip
    return path.y[:3, -1], path.y[3:, -1]


def test_a_coasting_spacecraft_moves_as_in_n() -> None:
    """The Sun goes round, a quarter in the flight."""
    day = 4.0 * 150.0 / 86400.0
    sun = SAIL | {"year_days": day, "orbit_pole": [0.8, 0.0, 0.6]}
    data = zero_flight(**BRIEF, sunlight=sun).dataset
    pole, start = np.array([0.8, 0.0, 0.6]), np.array([0.6, 0.0, -0.8])

    def towards(time: float) -> np.ndarray:
        angle = 2.0 * np.pi * time / (day * 86400.0)
        return np.cos(angle) * start + np.sin(angle) * np.cross(pole, start)

    end = float(data["time"].values[-1])
    position, velocity = in_n(data["state"].values[0], end, towards, PUSH, False)
    np.testing.assert_allclose(data["position_inertial"].values[-1], position, atol=1e-4)
    np.testing.assert_allclose(data["velocity_inertial"].values[-1], velocity, atol=1e-6)


def test_the_shadow_comes_late_by_less_than_a_period() -> None:
    """The Sun sets and rises in flight: the velocity is off by two periods of light at most."""
    # A turn in 1,200 s: the body hides it for about a quarter of that.
    sun = SAIL | {"direction": [1.0, 0.0, 0.0], "year_days": 1200.0 / 86400.0}
    changes = {
        "transit__start_m": [150e3, 0.0, 0.0], "arrival__deadline_s": 1000.0,
        "arrival__dwell_s": 100.0, "sunlight": sun,
    }  # fmt: skip
    data = zero_flight(**changes).dataset
    end, start = float(data["time"].values[-1]), data["state"].values[0]

    def towards(time: float) -> np.ndarray:
        angle = 2.0 * np.pi * time / 1200.0
        return np.array([np.cos(angle), np.sin(angle), 0.0])

    hidden = in_shadow(kleopatra().shape, data["state"].values[:, :3], data["sun_direction"].values)
    assert hidden.any()
    assert not hidden[[0, -1]].any()
    _, velocity = in_n(start, end, towards, PUSH, True, 5.0)
    _, unhidden = in_n(start, end, towards, PUSH, False)
    found = data["velocity_inertial"].values[-1]
    assert np.linalg.norm(found - velocity) < 2.0 * 10.0 * PUSH
    assert np.linalg.norm(found - unhidden) > 100.0 * PUSH


@pytest.mark.slow
def test_the_navigation_counts_it() -> None:
    """Within three sigma in nearly all steps; a navigation that is told of no Sun is not."""
    settings = {"log_ranges": False, "transit.index": 1}
    sun = {"area_m2": 100.0, "distance_au": 1.0, "direction": [0.5, 0.5, 0.7]}
    scenario = load_scenario(None, {**settings, "sunlight": sun})
    log = fly(scenario, "mpc", body=kleopatra())
    untold = filter_tuning(load_scenario(None, settings), kleopatra())
    blind = dc.replace(scenario, navigation=LidarNavigationConfig(expected=untold))
    assert _within_three_sigma(log) > 0.99
    assert _within_three_sigma(fly(blind, "mpc", body=kleopatra())) < 0.6


def _within_three_sigma(log: FlightLog) -> float:
    """The least share of steps of a component of position and velocity."""
    data = log.dataset
    error = (data["navigation_state"] - data["state"]).values
    sigma = np.sqrt(data["navigation_covariance"].values[:, range(6), range(6)])
    known = np.isfinite(error).all(axis=1)
    return float((np.abs(error[known]) < 3.0 * sigma[known]).mean(axis=0).min())


def test_without_sunlight_there_is_nothing_of_it() -> None:
    dark = zero_flight(**BRIEF)
    assert "sun_direction" not in dark.dataset
    assert not make_transit_diagram(short_scenario(), body=kleopatra()).HasSubsystemNamed(
        "sunlight"
    )
    assert load_scenario().sunlight is None


@pytest.mark.parametrize(
    ("sunlight", "words"),
    [
        ({"direction": [0, 0, 0]}, "sunlight.direction has no direction"),
        ({"orbit_pole": [0, 0, 0]}, "sunlight.orbit_pole has no direction"),
        ({"distance_au": 0}, "sunlight.distance_au must be positive"),
        ({"year_days": 0}, "sunlight.year_days must be positive"),
        ({"direction": [1, 0, 1], "year_days": 365}, "right angles to sunlight.orbit_pole"),
    ],
)
def test_a_sun_that_cannot_be_is_refused(sunlight: dict, words: str) -> None:
    with pytest.raises(InputError, match=words):
        load_scenario(None, {"sunlight": sunlight})
    # Where nothing goes round, the pole does not matter.
    check_scenario(load_scenario(None, {"sunlight": {"direction": [1, 0, 1]}}))
