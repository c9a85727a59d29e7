"""The plot of the navigation shows its errors, what it knew of them, and what it did."""

import numpy as np
import pytest
from known_navigation import ACQUIRING, AXES, DEVIATIONS, ERROR, LOST, TURN, navigated_log
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from synthetic_log import synthetic_log

from proxops.diagrams.logs import FlightLog
from proxops.diagrams.plots import plot_frame, plot_navigation
from proxops.systems import InputError
from proxops.systems.navigation import ReturnUse


@pytest.fixture(scope="module")
def figure() -> Figure:
    return plot_navigation(navigated_log())


def values(ax: Axes, number: int) -> np.ndarray:
    return np.asarray(ax.lines[number].get_ydata())


def test_errors_and_what_it_knew_of_them(figure: Figure) -> None:
    panels = figure.axes[1:4]
    assert [ax.get_ylabel() for ax in panels] == [
        "position (m)", "velocity (m/s)", "attitude (degrees)",
    ]  # fmt: skip
    along = np.sqrt((AXES**2) @ DEVIATIONS**2)
    known = (
        (ERROR[:3], along), (ERROR[3:], np.full(3, 0.02)),
        (np.degrees(TURN), np.full(3, np.degrees(1e-3))),
    )  # fmt: skip
    for ax, (errors, deviations) in zip(panels, known, strict=True):
        for axis in range(3):
            drawn, limit = values(ax, 2 * axis), values(ax, 2 * axis + 1)
            assert np.isnan(drawn[ACQUIRING]).all()
            after = slice(ACQUIRING.stop, None)
            np.testing.assert_allclose(drawn[after], abs(errors[axis]), rtol=1e-5, atol=1e-9)
            np.testing.assert_allclose(limit[after], 3.0 * deviations[axis], rtol=1e-9)


def test_returns_and_phases(figure: Figure) -> None:
    phase, returns = figure.axes[0], figure.axes[4]
    np.testing.assert_array_equal(values(returns, 0), np.arange(101))
    np.testing.assert_array_equal(values(returns, 1), np.arange(101) % 3)
    lost = phase.collections[2]
    corners = np.concatenate([path.vertices for path in lost.get_paths()])
    assert corners[:, 0].min() == pytest.approx(LOST.start / 6.0)
    assert corners[:, 0].max() == pytest.approx(LOST.stop / 6.0)
    named = {text.get_text() for text in figure.legends[0].get_texts()}
    assert {"acquiring", "following", "lost", "three standard deviations"} < named


def test_it_can_be_drawn(figure: Figure, tmp_path) -> None:
    figure.savefig(tmp_path / "navigation.png")
    assert (tmp_path / "navigation.png").stat().st_size > 20_000


@pytest.mark.slow
@pytest.mark.parametrize("steps", [0, 1])
def test_flights_that_end_at_once(steps: int, tmp_path) -> None:
    plot_navigation(navigated_log(steps)).savefig(tmp_path / "navigation.png")


def test_a_flight_without_a_navigation_is_refused() -> None:
    with pytest.raises(InputError, match="has no navigation"):
        plot_navigation(synthetic_log(3, ranges=False))


def test_a_frame_beside_what_the_map_predicts() -> None:
    """At the true pose, of a noiseless frame in which two returns are false."""
    plain = synthetic_log(3)
    state = plain.dataset["state"].copy()
    ranges = plain.dataset["ranges"].values.copy()
    use = np.where(np.isfinite(ranges), ReturnUse.USED, ReturnUse.NOT_USED).astype(np.int8)
    false = np.flatnonzero(np.isfinite(ranges[2]))[[5, 9]]
    ranges[2].reshape(-1)[false] += 20e3
    use[2].reshape(-1)[false] = ReturnUse.REJECTED
    columns = {
        "navigation_state": state,
        "navigation_attitude": (("time", "quaternion"), np.tile([1.0, 0.0, 0.0, 0.0], (4, 1))),
        "navigation_return_use": (("time", "plane", "ray"), use),
        "ranges": (("time", "plane", "ray"), ranges),
    }
    log = FlightLog(plain.dataset.assign(columns), plain.body)
    shown = plot_frame(log, 2)
    count = np.isfinite(ranges[2]).sum()
    texts = [text.get_text() for text in shown.legends[0].get_texts()]
    assert texts == ["predicted", f"used: {count - 2}", "rejected: 2", "left alone: 0"]
    used, rejected = (shown.axes[1].lines[k] for k in (0, 1))
    np.testing.assert_allclose(values(shown.axes[1], 0), 0.0, atol=1.0)
    np.testing.assert_allclose(np.asarray(rejected.get_xdata()), [5, 9])
    np.testing.assert_allclose(values(shown.axes[1], 1), 20e3, atol=1.0)
    assert len(np.asarray(used.get_xdata())) == count - 2
    with pytest.raises(InputError, match="there is no row 4"):
        plot_frame(log, 4)
    with pytest.raises(InputError, match="does not say what became"):
        plot_frame(plain, 2)
    columns["navigation_state"] = (("time", "component"), np.full((4, 6), np.nan))
    with pytest.raises(InputError, match="has no state"):
        plot_frame(FlightLog(plain.dataset.assign(columns), plain.body), 2)
