"""The plots show what is in the log, in the units on their axes."""

from pathlib import Path

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.patches import StepPatch
from synthetic_log import synthetic_log

from proxops.diagrams.logs import FlightLog, legend_of
from proxops.diagrams.plots import flight_plot, plot_flight, plot_ranges


@pytest.fixture(scope="module")
def log() -> FlightLog:
    return synthetic_log()


def only(kind: type, of: list) -> list:
    return [artist for artist in of if isinstance(artist, kind)]


def curve(ax: Axes, number: int) -> tuple[np.ndarray, np.ndarray]:
    """Abscissae and ordinates of a line of the axes."""
    line = ax.lines[number]
    return np.asarray(line.get_xdata()), np.asarray(line.get_ydata())


def test_flight_is_one_page_of_labelled_axes(log: FlightLog, tmp_path: Path) -> None:
    figure = plot_flight(log)
    assert len(figure.axes) == 9
    labels = [ax.get_ylabel() for ax in figure.axes]
    for unit in ("(km)", "(m/s)", "(N)"):
        assert any(label.endswith(unit) for label in labels)
    assert all(ax.get_xlabel().endswith(("(km)", "(min)")) for ax in figure.axes)
    named = {text.get_text() for text in figure.legends[0].get_texts()}
    assert {"flown by MPC", "flown by policy", "goal", "keep-out ellipsoid", "limit"} <= named
    assert "flown by hybrid" not in named
    figure.savefig(tmp_path / "flight.png")
    assert (tmp_path / "flight.png").stat().st_size > 20_000


@pytest.mark.parametrize(("plane", "axes"), [("xy", [0, 1]), ("xz", [0, 2])])
def test_path(log: FlightLog, ax: Axes, plane: str, axes: list[int]) -> None:
    flight_plot.plot_path(ax, log, plane)
    [path] = only(LineCollection, list(ax.collections))
    segments = np.array(path.get_segments())
    expected = log.dataset["state"].values[:, axes] / 1e3
    np.testing.assert_allclose(segments[:, 0], expected[:-1])
    np.testing.assert_allclose(segments[:, 1], expected[1:])
    flies = log.dataset["decision"].values[:-1]
    legend = legend_of(log.dataset)
    colours = [legend[who].colour for who in flies.tolist()]
    np.testing.assert_allclose(path.get_colors()[:, :3], colours)
    goal = np.concatenate(curve(ax, -1))
    np.testing.assert_allclose(goal, log.dataset["target"].values[0, axes] / 1e3)
    assert ax.get_aspect() == 1.0
    x, y = np.array([ax.get_xlim(), ax.get_ylim()])
    assert x[0] < expected[:, 0].min() < expected[:, 0].max() < x[1]
    assert y[0] < expected[:, 1].min() < expected[:, 1].max() < y[1]


@pytest.mark.parametrize(("axis", "index"), [("x", 0), ("y", 1), ("z", 2)])
def test_force(log: FlightLog, ax: Axes, axis: str, index: int) -> None:
    flight_plot.plot_force(ax, log, axis)
    [steps] = only(StepPatch, list(ax.patches))
    values, edges, _ = steps.get_data()
    np.testing.assert_allclose(values, log.dataset["force"].values[:-1, index])
    np.testing.assert_allclose(edges, log.dataset["time"].values / 60.0)
    limits = {float(curve(ax, number)[1][0]) for number in range(len(ax.lines))}
    assert {-7.0, 7.0} <= limits
    assert axis in ax.get_ylabel()


def test_ranges(log: FlightLog, ax: Axes) -> None:
    frame = log.dataset["ranges"].values[100]
    image = plot_ranges(ax, frame)
    shown = np.ma.asarray(image.get_array())
    np.testing.assert_array_equal(np.ma.getmaskarray(shown), np.isinf(frame))
    np.testing.assert_allclose(shown.compressed(), frame[np.isfinite(frame)] / 1e3)
    assert np.isfinite(frame).any()
    # Ray 0 is centred on 0 degrees, plane 0 on 0.
    assert image.get_extent() == pytest.approx([-0.5, 359.5, -0.5, 11.5])
