"""The picture of a plan shows the plan, and the limits that it keeps."""

import numpy as np
import pytest
from short_flights import kleopatra

from proxops.diagrams.flight.scenario_systems import make_mpc
from proxops.diagrams.plots.plan_plot import plot_plan
from proxops.diagrams.scenario import load_scenario, scenario_transit
from proxops.systems.shapes.ellipsoid import clearances


@pytest.fixture(scope="module")
def shown():
    scenario, body = load_scenario(None, ["transit.index=1"]), kleopatra()
    transit = scenario_transit(scenario, body)
    ends = np.concatenate([transit.start, np.zeros(3)]), np.concatenate([transit.goal, np.zeros(3)])
    plan = make_mpc(scenario, body).program.solve(*ends, iterations=10)
    return plan, plot_plan(plan, body, scenario).axes


def test_curves_are_the_plan(shown) -> None:
    plan, (way, force, velocity, clearance) = shown
    for axis in range(3):
        values, edges, _ = force.patches[axis].get_data()
        np.testing.assert_allclose(values, plan.forces[:, axis])
        np.testing.assert_allclose(edges, plan.times / 60.0)
        np.testing.assert_allclose(velocity.lines[axis].get_ydata(), plan.states[:, 3 + axis])
    np.testing.assert_allclose(way.lines[0].get_xydata(), plan.states[:, :2] / 1e3)
    axes = kleopatra().keep_out_semi_axes
    expected = clearances(axes, plan.states[:, :3]) / 1e3
    np.testing.assert_allclose(clearance.lines[0].get_ydata(), expected)
