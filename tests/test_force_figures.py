"""Figures, histograms and report of a policy's forces."""

import numpy as np
import pytest
from matplotlib.collections import QuadMesh

from proxops.training.reports.force_errors import force_figures, plot_forces

WANTED = np.array([[0.0, 0.0, 0.0], [3.0, 0.0, -7.0], [0.1, 0.0, 0.1], [7.0, 0.0, 1.0]])
SAID = np.array([[0.0, 0.5, 0.0], [3.0, 0.5, -3.0], [0.1, 0.5, 0.1], [5.0, 0.5, 1.0]])


def test_figures():
    figures = force_figures(WANTED, SAID, 7.0)
    assert figures["steps"] == 4
    assert figures["rmse_axes_n"] == pytest.approx([1.0, 0.5, 2.0])
    assert figures["rmse_n"] == pytest.approx(np.sqrt((1.0 + 0.25 + 4.0) / 3.0))
    assert figures["zero_rmse_axes_n"] == pytest.approx(
        [np.sqrt(58.01 / 4), 0.0, np.sqrt(50.01 / 4)]
    )
    assert figures["zero_rmse_n"] == pytest.approx(np.sqrt((58.01 + 50.01) / 12))
    assert figures["small_mpc"] == 0.5
    assert figures["small_policy"] == 0.0
    assert figures["correlation"][1] is None
    assert 0.9 < figures["correlation"][0] < 1.0


def test_small_is_for_the_thrust_limit():
    """At a small body all forces are below 0.2 N."""
    figures = force_figures(0.001 * WANTED, 0.001 * SAID, 0.007)
    assert (figures["small_mpc"], figures["small_policy"]) == (0.5, 0.0)


def test_figures_of_nothing_are_none():
    figures = force_figures(np.zeros((0, 3)), np.zeros((0, 3)), 7.0)
    assert figures.pop("steps") == 0
    assert set(figures.values()) == {None}
    assert figures.keys() == force_figures(WANTED, SAID, 7.0).keys() - {"steps"}


def test_histograms_show_actual_across_and_predicted_up():
    wanted = np.tile([6.0, 0.0, -6.0], (1500, 1))
    said = np.tile([-3.0, 9.0, 0.0], (1500, 1))  # 9 N would be flown as 7.
    panels = [axis for axis in plot_forces(wanted, said, 7.0).axes if axis.get_xlabel()]
    assert [axis.get_title() for axis in panels] == ["x", "y", "z"]
    for axis, actual, predicted in zip(panels, (6.0, 0.0, -6.0), (-3.0, 7.0, 0.0), strict=True):
        (mesh,) = (each for each in axis.collections if isinstance(each, QuadMesh))
        assert mesh.get_clim() == (0, 1000)
        counts = np.ma.filled(np.ma.asarray(mesh.get_array()), 0.0)
        (up,), (across,) = np.nonzero(counts)
        assert counts[up, across] == 1500
        corners = np.asarray(mesh.get_coordinates())
        low, high = corners[up, across], corners[up + 1, across + 1]
        assert low[0] <= actual <= high[0]
        assert low[1] <= predicted <= high[1]
