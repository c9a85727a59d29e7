"""A transit inside a diagram of one's own: how far is the navigation off?

    python examples/11_nested_transit.py

The diagram holds a transit of the scenario that ships, flown by the MPC, and two of Drake's log
sinks: one for the spacecraft's true state, one for the state that is known on board. They sample
once a control step; between steps the navigation has nothing new to say.
"""

import numpy as np
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import LogVectorOutput

from proxops.diagrams.flight import add_transit, make_simulator
from proxops.diagrams.scenario import load_scenario

MINUTES = 10

scenario = load_scenario()
builder = DiagramBuilder()
transit = add_transit(builder, scenario)
sinks = [
    LogVectorOutput(transit.GetOutputPort(name), builder, publish_period=scenario.control_period_s)
    for name in ("true_state", "state")
]
diagram = builder.Build()
diagram.set_name("mine")

simulator = make_simulator(diagram, scenario)
simulator.AdvanceTo(60.0 * MINUTES)

true, known = (sink.FindLog(simulator.get_context()) for sink in sinks)
positions = true.data()[:3]
flown = np.linalg.norm(positions - positions[:, :1], axis=0)
errors = np.linalg.norm(known.data()[:3] - positions, axis=0)
print("time (s)  flown (m)  navigation off by (m)")
for row in zip(true.sample_times()[::6], flown[::6], errors[::6], strict=True):
    print("{:8.0f}  {:9.0f}  {:21.1f}".format(*row))
