"""The plot of the navigation shows its errors, what it knew of them, and what it did."""

import dataclasses
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from known_navigation import ACQUIRING, AXES, DEVIATIONS, ERROR, TURN, navigated_log
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from synthetic_log import synthetic_log

from proxops.diagrams.logs import FlightLog
from proxops.diagrams.plots import plot_frame, plot_navigation
from proxops.diagrams.scenario import LidarNavigationConfig, dump_scenario
from proxops.systems import InputError
from proxops.systems.navigation import ReturnUse
from proxops.systems.shapes.shape_files import mesh_bytes


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


def with_frames(log: FlightLog, delay: int = 0, map_path: Path | None = None) -> FlightLog:
    """A log whose navigation knew the truth; its noiseless frames arrive some rows late."""
    data, rows = log.dataset, log.dataset.sizes["time"]
    ranges = np.full_like(data["ranges"].values, np.inf)
    ranges[delay:] = data["ranges"].values[: rows - delay]
    use = np.where(np.isfinite(ranges), ReturnUse.USED, ReturnUse.NOT_USED).astype(np.int8)
    given = LidarNavigationConfig(
        frame_delay_steps=delay, map=None if map_path is None else str(map_path), map_unit="m"
    )
    scenario = dataclasses.replace(log.scenario, navigation=given)
    columns = {
        "navigation_state": data["state"].copy(),
        "navigation_attitude": (("time", "quaternion"), np.tile([1.0, 0.0, 0.0, 0.0], (rows, 1))),
        "navigation_return_use": (("time", "plane", "ray"), use),
        "ranges": (("time", "plane", "ray"), ranges),
    }
    data = data.assign(columns).assign_attrs(scenario=dump_scenario(scenario))
    return FlightLog(data, log.body)


@pytest.mark.parametrize("row", [2, 3, -1])
def test_a_late_frame_beside_what_was_believed_when_it_was_measured(row: int) -> None:
    log = with_frames(synthetic_log(3), delay=2)
    shown = plot_frame(log, row)
    residuals = values(shown.axes[1], 0)
    assert residuals.size > 100
    np.testing.assert_allclose(residuals, 0.0, atol=1.0)
    taken = row % 4 - 2
    title = f"frame at {10 * taken} s, received at {10 * (row % 4)} s"
    assert shown.axes[0].get_title() == title


def test_the_prediction_is_that_of_the_navigation_s_map(tmp_path: Path) -> None:
    plain, path = synthetic_log(3), tmp_path / "map.obj"
    shape = plain.body.shape
    path.write_bytes(mesh_bytes(0.99 * shape.vertices, shape.facets, ".obj"))
    log = with_frames(plain, map_path=path)
    residuals = values(plot_frame(log, 2).axes[1], 0)
    # The map is smaller by 1 %, so that the true surface is nearer.
    assert -1500.0 < np.median(residuals) < -50.0
    path.unlink()
    with pytest.raises(InputError, match=r"navigation\.map of the log: .*map\.obj does not exist"):
        plot_frame(log, 2)


def test_a_frame_beside_what_the_map_predicts() -> None:
    """At the true pose, of a noiseless frame in which two returns are false."""
    log = with_frames(synthetic_log(3))
    ranges, use = (log.dataset[name].values for name in ("ranges", "navigation_return_use"))
    false = np.flatnonzero(np.isfinite(ranges[2]))[[5, 9]]
    ranges[2].reshape(-1)[false] += 20e3
    use[2].reshape(-1)[false] = ReturnUse.REJECTED
    shown = plot_frame(log, 2)
    count = np.isfinite(ranges[2]).sum()
    texts = [text.get_text() for text in shown.legends[0].get_texts()]
    assert texts == ["predicted", f"used: {count - 2}", "rejected: 2", "left alone: 0"]
    used, rejected = (shown.axes[1].lines[k] for k in (0, 1))
    np.testing.assert_allclose(values(shown.axes[1], 0), 0.0, atol=1.0)
    np.testing.assert_allclose(np.asarray(rejected.get_xdata()), [5, 9])
    np.testing.assert_allclose(values(shown.axes[1], 1), 20e3, atol=1.0)
    assert len(np.asarray(used.get_xdata())) == count - 2
    log.dataset["navigation_state"][:] = np.nan
    with pytest.raises(InputError, match="has no state"):
        plot_frame(log, 2)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda log: plot_navigation(log), "has no navigation"),
        (lambda log: plot_frame(log, 2), "does not say what became"),
        (lambda log: plot_frame(with_frames(log, delay=2), 4), "there is no row 4"),
        (lambda log: plot_frame(with_frames(log, delay=2), 1), r"it was measured before the log"),
        (lambda log: plot_frame(with_frames(log, delay=2), -3), r"it was measured before the log"),
    ],
)
def test_refusals(call: Callable[[FlightLog], object], words: str) -> None:
    with pytest.raises(InputError, match=words):
        call(synthetic_log(3))
