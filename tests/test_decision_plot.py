"""The figure of decisions shows what is in the log, and no more."""

from typing import Any

import numpy as np
import pytest
from matplotlib.colors import to_rgb
from matplotlib.patches import StepPatch
from synthetic_log import synthetic_log

from proxops.diagrams.logs.flight_log import FlightLog
from proxops.diagrams.logs.legend import legend_of
from proxops.diagrams.plots.decision_plot import plot_decisions


@pytest.fixture
def log() -> FlightLog:
    """A hybrid's, compared at every 10th step, where it differs by its row / 100 in N."""
    plain = synthetic_log(ranges=False)
    row = np.arange(len(plain.dataset["time"]), dtype=float)
    check = row % 10 == 0
    added = {
        "agreement": np.where(check, row < 100, np.nan),
        "force_difference": np.where(check, 0.01 * row, np.nan),
        "force_angle": np.where(check, np.radians(row / 10.0), np.nan),
        "intervention": np.where(row % 4 == 0, 0.25, 0.0),
    }
    columns = {name: ("time", values) for name, values in added.items()}
    return FlightLog(plain.dataset.assign(columns), plain.body)


def test_checks_and_their_limits(log: FlightLog) -> None:
    _, difference, angle, _ = plot_decisions(log).axes
    lines: list[Any] = list(difference.lines)
    agree, differ, limit = lines
    minutes = np.arange(0, 481, 10) / 6.0
    np.testing.assert_allclose(np.asarray(agree.get_xdata()), minutes[:10])
    np.testing.assert_allclose(np.asarray(differ.get_xdata()), minutes[10:])
    np.testing.assert_allclose(np.asarray(differ.get_ydata()), np.arange(100, 481, 10) / 100.0)
    assert limit.get_ydata() == [1.0, 1.0]
    assert to_rgb(agree.get_color()) != to_rgb(differ.get_color())
    np.testing.assert_allclose(np.asarray(angle.lines[0].get_ydata()), np.arange(10))
    assert angle.lines[2].get_ydata() == [10.0, 10.0]


def test_flown_by_fills_the_strip(log: FlightLog) -> None:
    """Each step once: every fourth is the filter's, of the others the MPC has 200 s of 600."""
    strip = plot_decisions(log).axes[0]
    lengths = {}
    artists: list[Any] = list(strip.collections)
    for artist in artists:
        spans = [np.ptp(path.vertices[:, 0]) for path in artist.get_paths()]
        lengths[to_rgb(artist.get_facecolor()[0])] = 60.0 * sum(spans)
    colours = {code: entry.colour for code, entry in legend_of(log.dataset).items()}
    assert lengths == pytest.approx({colours[1]: 1200.0, colours[2]: 2400.0, colours[3]: 1200.0})


def test_changes_of_the_command(log: FlightLog) -> None:
    steps: Any
    (steps,) = (each for each in plot_decisions(log).axes[3].patches if isinstance(each, StepPatch))
    np.testing.assert_array_equal(steps.get_data().values, log.dataset["intervention"].values[:-1])


def test_what_is_not_in_the_log_is_left_out(log: FlightLog) -> None:
    plain = synthetic_log(ranges=False)
    assert len(plot_decisions(plain).axes) == 1
    assured = FlightLog(log.dataset.drop_vars("agreement"), log.body)
    figure = plot_decisions(assured)
    assert len(figure.axes) == 2
    assert "forces agree" not in [text.get_text() for text in figure.legends[0].get_texts()]
