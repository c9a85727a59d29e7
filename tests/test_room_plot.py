"""Maps of the clearance that runtime assurance needs."""

from typing import Any

import numpy as np

from proxops.diagrams.plots.room_plot import _mapped, plot_room
from proxops.systems.common import spread_directions

AXES = np.array([140e3, 70e3, 60e3])


def test_map_is_that_of_the_places() -> None:
    """A clearance that is linear in direction is found again on the whole grid, poles included."""
    places = spread_directions(2000) * AXES
    directions = places / np.linalg.norm(places, axis=1)[:, None]
    slope = np.array([300.0, -200.0, 500.0])
    longitude, latitude, values = _mapped(places, 1e3 + directions @ slope)
    east, north = np.radians(np.meshgrid(longitude, latitude))
    x, y, z = np.cos(north) * np.cos(east), np.cos(north) * np.sin(east), np.sin(north)
    expected = 1e3 + slope[0] * x + slope[1] * y + slope[2] * z
    np.testing.assert_allclose(values, expected, atol=60.0)
    np.testing.assert_allclose(values[:, 0], values[:, -1])


def test_figure_tells_median_most_and_where() -> None:
    places = spread_directions(300) * AXES
    needed = np.full(300, 500.0)
    needed[77] = 2500.0
    nowhere = np.where(np.arange(300) < 3, np.inf, 900.0)
    figure = plot_room({"small": (places, needed), "large": (places, nowhere)})
    first, second, bar = figure.axes
    assert first.get_title() == "small\nmedian 0.5, most 2.5 km"
    assert "most inf" in second.get_title()
    cross: Any = first.lines[0]
    ((east,), (north,)) = cross.get_data()
    direction = places[77] / np.linalg.norm(places[77])
    at = np.cos(np.radians(north)) * np.array([np.cos(np.radians(east)), np.sin(np.radians(east))])
    np.testing.assert_allclose(at, direction[:2], atol=1e-12)
    assert bar.get_ylim() == (0.0, 2.5)


def test_a_small_body_has_metres() -> None:
    places = spread_directions(300) * AXES / 500.0
    first, bar = plot_room({"small": (places, np.full(300, 5.0))}).axes
    assert first.get_title() == "small\nmedian 5.0, most 5.0 m"
    assert bar.get_ylabel() == "clearance needed (m)"
