"""Plants that are not what the expert believes, and the estimator that makes up for it."""

import numpy as np
import pytest

from proxops.diagrams.flight import fly, make_simulator, make_transit_diagram
from proxops.diagrams.scenario import load_body, load_scenario
from proxops.systems import InputError, ModelPredictiveController, PointMassField

PLACE = [20e3, 95e3, 40e3]


def holding(gain: float, *overrides: str):
    """A scenario that holds at its goal for 1,500 s, where gravity is strong."""
    return load_scenario(
        None,
        [
            f"transit.start_m={PLACE}",
            f"transit.goal_m={PLACE}",
            "arrival.dwell_s=1500",
            "arrival.deadline_s=10",
            f"mpc.estimator_gain={gain}",
            *overrides,
        ],
        on_true_state=True,
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    "mismatch", ["truth.gravity=0.8", "truth.gravity=1.2", "mpc.point_mass=true"]
)
def test_estimator_removes_the_offset(mismatch):
    without = fly(holding(0.0, mismatch)).summary["terminal_position_error_m"]
    with_it = fly(holding(0.3, mismatch)).summary["terminal_position_error_m"]
    assert without > 5.0
    assert with_it < 1.0


@pytest.mark.parametrize(("quantity", "scale"), [("mass", 1.1), ("thrust", 0.9)])
def test_plant_has_the_mass_and_thrust_it_is_given(quantity, scale):
    key = {"mass": f"truth.mass={scale}", "thrust": f"truth.thrusters.scale={[scale] * 3}"}
    scenario = holding(0.0, key[quantity], "arrival.dwell_s=20")
    state = fly(scenario).dataset
    # From the first two rows: the acceleration that the logged force made.
    field, spin = load_body("kleopatra").gravity_field, load_body("kleopatra").spin_rate
    gravity = field.evaluate(np.array([PLACE])).acceleration[0]
    centrifugal = spin**2 * np.array([PLACE[0], PLACE[1], 0.0])
    measured = state["state"].values[1, 3:] / 10.0 - gravity - centrifugal
    expected = state["force"].values[0] / 100.0
    expected = expected / scale if quantity == "mass" else expected * scale
    assert measured == pytest.approx(expected, rel=2e-3, abs=2e-6)


@pytest.mark.slow
@pytest.mark.parametrize("mismatch", ["truth.mass=1.1", "truth.thrusters.scale=[0.9, 0.9, 0.9]"])
def test_delta_v_of_holding_is_that_of_any_plant(mismatch):
    """Holding costs what gravity pulls, whatever the mass and however strong the thrusters."""

    def of(*overrides: str) -> float:
        summary = fly(holding(0.3, *overrides)).summary
        return summary["delta_v_m_s"] + summary["hold_delta_v_m_s"]

    assert of(mismatch) == pytest.approx(of(), rel=5e-3)


def test_estimate_is_what_gravity_lacks():
    scenario = holding(0.3, "truth.gravity=0.8")
    diagram = make_transit_diagram(scenario)
    simulator = make_simulator(diagram, scenario)
    simulator.AdvanceTo(600.0)
    controller = diagram.GetSubsystemByName("controller")
    assert isinstance(controller, ModelPredictiveController)
    context = controller.GetMyContextFromRoot(simulator.get_context())
    estimate = context.get_discrete_state_vector().value()[-3:]
    gravity = load_body("kleopatra").gravity_field.evaluate(np.array([PLACE])).acceleration[0]
    assert estimate == pytest.approx(-0.2 * gravity, rel=0.02, abs=2e-5)


def test_point_mass_is_the_far_field_of_any_body():
    field = load_body("kleopatra").gravity_field
    far = np.array([[6e9, -5e9, 4e9], [1e9, 1e9, -7e9]])
    point, body = PointMassField(field.mass).evaluate(far), field.evaluate(far)
    assert point.potential == pytest.approx(body.potential, rel=1e-8)
    assert point.acceleration == pytest.approx(body.acceleration, rel=1e-8, abs=1e-20)
    scale = np.abs(body.gradient).max()
    assert point.gradient == pytest.approx(body.gradient, rel=1e-7, abs=1e-8 * scale)
    with pytest.raises(InputError, match="mass must be positive"):
        PointMassField(-1.0)
