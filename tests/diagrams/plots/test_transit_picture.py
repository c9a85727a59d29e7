"""Pictures of transits: places are where the axes say, and nothing is drawn beside the picture."""

import numpy as np
from matplotlib.colors import to_rgb
from short_flights import kleopatra

from proxops.diagrams.plots import TransitPicture
from proxops.diagrams.plots.flight_plot import GOAL

REACH = 180e3
START = np.array([[-50e3, -160e3, 0.0]])
# The halves, above the legend.
VIEWS = (slice(0, 480), slice(480, 960))
ABOVE = 450


def place(pixels: np.ndarray, view: int) -> np.ndarray:
    """The middle (2,) of what has the goal's colour in a view: row, column."""
    part = pixels[:ABOVE, VIEWS[view]] / 255.0
    return np.argwhere((np.abs(part - to_rgb(GOAL)) < 0.05).all(axis=-1)).mean(axis=0)


def test_goals_are_where_the_axes_say() -> None:
    """A metre is as many pixels along each axis, x to the right, y and z upwards."""
    picture = TransitPicture(kleopatra(), None, REACH)

    def seen(*goal: float) -> np.ndarray:
        pixels = picture.pixels(START, np.array(goal), 0.0)
        assert (pixels.shape, pixels.dtype) == ((540, 960, 3), np.uint8)
        return np.array([place(pixels, view) for view in (0, 1)])

    middle = seen(0.0, 0.0, 0.0)
    right, up, high = seen(150e3, 0, 0), seen(0, 150e3, 0), seen(0, 0, 150e3)
    pixels = (right - middle)[0, 1]
    assert 140 < pixels < 200
    np.testing.assert_allclose(right - middle, [[0, pixels], [0, pixels]], atol=1.5)
    np.testing.assert_allclose(up - middle, [[-pixels, 0], [0, 0]], atol=1.5)
    np.testing.assert_allclose(high - middle, [[0, 0], [-pixels, 0]], atol=1.5)
    # A path that leaves is followed, and what comes after it is seen as before.
    far = np.vstack([START, [-2.5 * REACH, 0.0, 0.0]])
    picture.pixels(far, np.array([150e3, 0.0, 0.0]), 10.0)
    assert picture._axes["xy"].get_xlim()[0] < -2.5 * 180.0
    np.testing.assert_array_equal(seen(150e3, 0, 0), right)
