"""Figures, histograms and report of a policy's forces."""

import numpy as np
import pytest

from proxops.training.reports.force_errors import force_figures

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
