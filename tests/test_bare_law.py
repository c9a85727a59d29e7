"""The bare guidance law of benchmarks/ablation.py: made from a scenario, and what it commands."""

import numpy as np
from pydrake.systems.framework import Diagram
from scripts import load_script

from proxops.diagrams.scenario import load_body, load_scenario

LAW = load_script("benchmarks/_bare_law.py")


def test_at_rest_at_the_goal_it_hovers() -> None:
    """Nothing is to be flown there, so the force is the one that gravity and spin ask for."""
    scenario, body = load_scenario(), load_body("kleopatra")
    law = LAW.on_true_state(scenario, body)
    context = law.CreateDefaultContext()
    position = np.array([150e3, 20e3, 30e3])
    state = np.concatenate([position, np.zeros(3)])
    for name in ("state", "target"):
        law.GetInputPort(name).FixValue(context, state)
    apparent = body.gravity_field.evaluate(position[None]).acceleration[0]
    apparent[:2] += body.spin_rate**2 * position[:2]
    expected = -scenario.spacecraft.mass_kg * apparent
    np.testing.assert_allclose(law.GetOutputPort("force").Eval(context), expected, rtol=1e-12)


def test_on_the_estimate_it_is_wired() -> None:
    controller = LAW.on_estimate(load_scenario(), load_body("kleopatra"))
    assert isinstance(controller, Diagram)
    inputs = {controller.get_input_port(i).get_name() for i in range(controller.num_input_ports())}
    assert inputs == {"ranges", "target", "commanded_force"}
