"""The picture of hovering: its red line is where the thrusters are just strong enough."""

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.contour import QuadContourSet
from matplotlib.figure import Figure
from short_flights import kleopatra

from proxops.diagrams.plots.hover_plot import draw_hover
from proxops.diagrams.scenario.scenario import load_scenario


def contours(ax: Axes) -> list[QuadContourSet]:
    return [item for item in ax.collections if isinstance(item, QuadContourSet)]


@pytest.mark.parametrize("plane", ["xy", "xz", "yz"])
def test_limit_is_where_the_force_is(plane: str) -> None:
    """Gravity and centrifugal force along the line, put together here, take 7 N at 1,000 kg."""
    scenario, body = load_scenario(None, ["spacecraft.mass_kg=1000"]), kleopatra()
    ax = Figure().subplots()
    draw_hover(ax, body, scenario, plane, count=81)
    filled, limit = contours(ax)
    line = np.concatenate([path.vertices for path in limit.get_paths()])
    points = np.zeros((len(line), 3))
    points[:, ["xyz".index(letter) for letter in plane]] = 1e3 * line
    pull = body.gravity_field.evaluate(points).acceleration
    pull += body.spin_rate**2 * points * [1.0, 1.0, 0.0]
    force = 1000.0 * np.abs(pull).max(axis=1)
    assert np.median(np.abs(force - 7.0)) < 0.05
    assert np.abs(line).max() <= 170.0
    assert max(filled.levels) == 7.0
    assert not body.gravity_field.evaluate(points).inside.any()
