"""A sensor of one's own: a camera that finds the direction of the body's middle, and a filter.

    python examples/6_own_sensor.py

It is wired to the plant as the lidar is, reads the true position, and is part of a diagram beside
the transit. Its noise is a function of the step, so that flights repeat bit for bit.
"""

import numpy as np
from pydrake.systems.framework import DiagramBuilder, LeafSystem
from pydrake.systems.primitives import LogVectorOutput

from proxops.diagrams.flight import add_transit, make_simulator
from proxops.diagrams.scenario import load_scenario

NOISE = np.radians(0.05)
PERIOD = 10.0  # s


class DirectionCamera(LeafSystem):
    """The unit vector (3,) from the spacecraft to the body's middle, in K, with noise."""

    def __init__(self):
        super().__init__()
        self.state = self.DeclareVectorInputPort("state", 6)
        self.DeclareVectorOutputPort("direction", 3, self.calc_direction)

    def calc_direction(self, context, output):
        step = round(context.get_time() / PERIOD)
        to_middle = -self.state.Eval(context)[:3]
        to_middle /= np.linalg.norm(to_middle)
        seen = to_middle + NOISE * np.random.default_rng([7, step]).standard_normal(3)
        output.SetFromVector(seen / np.linalg.norm(seen))


scenario, builder = load_scenario(), DiagramBuilder()
transit = add_transit(builder, scenario)
camera = builder.AddSystem(DirectionCamera())
builder.Connect(transit.GetOutputPort("true_state"), camera.GetInputPort("state"))
ports = (camera.GetOutputPort("direction"), transit.GetOutputPort("true_state"))
sinks = [LogVectorOutput(port, builder, publish_period=PERIOD) for port in ports]
diagram = builder.Build()
simulator = make_simulator(diagram, scenario)
simulator.AdvanceTo(1200.0)

seen, states = (sink.FindLog(simulator.get_context()).data().T for sink in sinks)
true = -states[:, :3] / np.linalg.norm(states[:, :3], axis=1, keepdims=True)
angles = np.degrees(np.arccos(np.clip((seen * true).sum(axis=1), -1.0, 1.0)))
print(f"{len(seen)} pictures, off by {np.median(angles):.3f} degrees in the median")
