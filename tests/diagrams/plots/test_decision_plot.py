"""The figure of decisions shows what is in the log, and no more."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from matplotlib.colors import to_rgb
from synthetic_log import synthetic_log

from proxops.diagrams.logs.flight_log import FlightLog
from proxops.diagrams.plots.decision_plot import plot_decisions
from proxops.diagrams.scenario import AssuranceConfig, TrueStateConfig, dump_scenario
from proxops.systems.assurance import AssuranceBounds, InterventionReason


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
        "intervention_reason": np.where(row % 4 == 0, InterventionReason.KEEP_OUT, 0),
        "assurance_margin": 2e3 - 50.0 * row,
        "assurance_position": np.full(row.size, 80.0),
        "assurance_velocity": np.full(row.size, 0.1),
    }
    columns = {name: ("time", values) for name, values in added.items()}
    bounds = AssuranceBounds(gravity=0.11, surface_m=500.0)
    assurance, known = AssuranceConfig(bounds=bounds), TrueStateConfig()
    scenario = dump_scenario(replace(plain.scenario, assurance=assurance, navigation=known))
    dataset = plain.dataset.assign(columns).assign_attrs(scenario=scenario)
    return FlightLog(dataset, plain.body)


def test_checks_and_their_limits(log: FlightLog) -> None:
    _, difference, angle, *_ = plot_decisions(log).axes
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
