"""Paths that meet a moon: by hand, where it stands still and where it comes to the spacecraft."""

import numpy as np

from proxops.systems.gravity import GravityField, Moon, MoonConfig, ball
from proxops.systems.vehicle import COLLIDED, NEVER, VIOLATIONS, FlightEvents
from proxops.systems.vehicle.flight_events import FlownPath

# It goes round in K, which does not turn, at 1 km once in 1e9 s: it stands still at (1 km, 0, 0).
STILL = MoonConfig(0.0, 100.0, 1000.0, 1e9, mesh="ball of 80 m")
GOAL = np.array([5e3, 0.0, 0.0, 0.0, 0.0, 0.0])


def flown(starts, ends, moon: MoonConfig = STILL, span: float = 10.0) -> np.ndarray:
    """The outcome after a straight path (3,) to (3,), in m."""
    field = GravityField(ball(200.0), mass=1e10)
    axes = np.full(3, 250.0)
    events = FlightEvents(field, axes, 5.0, 0.01, 10.0, [Moon(moon, ball(80.0))], 0.0)
    velocity = (np.array(ends) - starts) / span
    states = np.array([[*starts, *velocity], [*ends, *velocity]])
    path = FlownPath(states, np.array([GOAL, GOAL]), 0.0, span)
    return events.after(np.array([NEVER, 0.0, 0.0, 0.0]), path)


def test_a_path_beside_the_ball_is_none_of_its_business() -> None:
    assert not flown([900.0, 105.0, 0.0], [1100.0, 105.0, 0.0])[1:].any()


def test_a_path_through_the_ball_but_not_the_moon_is_a_violation() -> None:
    outcome = flown([850.0, 90.0, 0.0], [1150.0, 90.0, 0.0])
    assert outcome[VIOLATIONS] == 1.0
    assert outcome[COLLIDED] == 0.0


def test_a_path_that_meets_the_moon_is_a_collision() -> None:
    outcome = flown([850.0, 40.0, 0.0], [1150.0, 40.0, 0.0])
    assert outcome[VIOLATIONS] == 1.0
    assert outcome[COLLIDED] == 1.0


def test_who_is_in_the_ball_already_violates_no_more() -> None:
    assert flown([1000.0, 90.0, 0.0], [1000.0, 95.0, 0.0])[VIOLATIONS] == 0.0


def test_a_moon_that_comes_meets_who_stands_still() -> None:
    """In 10 s it goes 400 m along y, past a place 200 m on."""
    period = 2.0 * np.pi * 1000.0 / 40.0
    coming = MoonConfig(0.0, 100.0, 1000.0, period, mesh="ball of 80 m")
    place = 1000.0 * np.array([np.cos(0.2), np.sin(0.2), 0.0])
    assert flown(place, place + 1e-9, coming)[COLLIDED] == 1.0
    above = place + [0.0, 0.0, 90.0]
    outcome = flown(above, above + 1e-9, coming)
    assert (outcome[VIOLATIONS], outcome[COLLIDED]) == (1.0, 0.0)
