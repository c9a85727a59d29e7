"""A diagram by hand: a spacecraft on a free orbit, as seen from the body that turns below it.

    python examples/2_diagram_by_hand.py

Plant and gravity are systems, connected by the names of their ports; Drake's Simulator flies them.
The Jacobi integral, which a free orbit keeps, says how exact the integration is.
"""

import matplotlib.pyplot as plt
import numpy as np
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource, LogVectorOutput

from proxops.diagrams.scenario import load_body
from proxops.systems import PolyhedralGravity, Spacecraft

START = [0.0, 250e3, 0.0, 53.0, 0.0, 0.0]  # m and m/s in K: nearly a circle in an inertial frame

body, builder = load_body("kleopatra"), DiagramBuilder()
craft = builder.AddSystem(Spacecraft(100.0, body.spin_rate, START))
gravity = builder.AddSystem(PolyhedralGravity(body.gravity_field))
no_force = builder.AddSystem(ConstantVectorSource(np.zeros(3)))
builder.Connect(craft.GetOutputPort("position"), gravity.GetInputPort("position"))
builder.Connect(gravity.GetOutputPort("acceleration"), craft.GetInputPort("gravity"))
builder.Connect(no_force.get_output_port(), craft.GetInputPort("force"))
sink = LogVectorOutput(craft.GetOutputPort("state"), builder, publish_period=60.0)

simulator = Simulator(builder.Build())
integrator = simulator.get_mutable_integrator()
integrator.set_maximum_step_size(60.0)  # s; by default 0.1
integrator.set_target_accuracy(1e-3)
simulator.AdvanceTo(24 * 3600.0)

log = sink.FindLog(simulator.get_context())
positions, velocities = log.data().T[:, :3], log.data().T[:, 3:]
potential = body.gravity_field.evaluate(positions).potential  # J/kg, positive
turning = 0.5 * body.spin_rate**2 * (positions[:, :2] ** 2).sum(axis=1)
jacobi = 0.5 * (velocities**2).sum(axis=1) - potential - turning
print(f"the Jacobi integral changes by {np.ptp(jacobi) / abs(jacobi[0]):.1e} of itself")

plt.scatter(*body.shape.vertices[:, :2].T / 1e3, s=2, color="0.7")
plt.plot(*positions[:, :2].T / 1e3)
plt.axis("equal")
plt.xlabel("x (km)")
plt.ylabel("y (km)")
plt.savefig("diagram_by_hand.png")
