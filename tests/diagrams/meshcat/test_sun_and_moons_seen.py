"""The Sun lights a replay from where it is, and moons go round in it."""

import dataclasses as dc

import numpy as np
from meshcat_pages import animated
from short_flights import BRIEF, kleopatra, short_scenario

from proxops.diagrams.flight import fly
from proxops.diagrams.meshcat.replay import replay_page
from proxops.diagrams.scenario.body import Body
from proxops.systems.gravity import MoonConfig, moon_position

UNIT = 100e3


def test_a_replay_shows_sun_and_moons_where_they_are() -> None:
    moon = MoonConfig(1e15, 4e3, 655e3, 2.3e5, 0.1)
    body = Body(dc.replace(kleopatra().config, moons=[moon]), kleopatra().shape)
    scenario = short_scenario(**BRIEF, sunlight={"direction": [1.0, 2.0, 2.0]})
    log = fly(scenario, "zero", body=body)
    page, times = replay_page(log), log.dataset["time"].values
    places = animated(page, "/moon/0", "position")
    lights = animated(page, "/Lights/FillLight/<object>", "position")
    assert len(places) == len(lights) == len(times)
    for frame, place, light in zip(
        range(len(times)), places.values(), lights.values(), strict=True
    ):
        seen = moon_position(moon, times[frame], body.spin)
        np.testing.assert_allclose(place, seen / UNIT)
        turn = times[frame] * body.spin_rate
        x, y = (1.0 * np.cos(turn) + 2.0 * np.sin(turn), 2.0 * np.cos(turn) - np.sin(turn))
        np.testing.assert_allclose(light, np.array([x, y, 2.0]) * 10.0 / 3.0, rtol=1e-9)
