"""Direct collocation on the plant, and its linearisation: Drake's own tools on the same systems.

    python examples/9_collocation.py

Plant and gravity support AutoDiffXd, so that a diagram of them is a system that Drake's
optimisers take as it is. The path is open: no keep-out, as a first guess of a transit is.
"""

import numpy as np
from pydrake.planning import DirectCollocation
from pydrake.solvers import Solve
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import Linearize

from proxops.diagrams.scenario import load_body
from proxops.systems import PolyhedralGravity, Spacecraft

START = np.array([150e3, 40e3, 20e3, 0.0, 0.0, 0.0])  # m and m/s in K
GOAL = np.array([120e3, 100e3, 0.0, 0.0, 0.0, 0.0])

body, builder = load_body("kleopatra"), DiagramBuilder()
craft = builder.AddSystem(Spacecraft(100.0, body.spin_rate, START))
gravity = builder.AddSystem(PolyhedralGravity(body.gravity_field))
builder.Connect(craft.GetOutputPort("position"), gravity.GetInputPort("position"))
builder.Connect(gravity.GetOutputPort("acceleration"), craft.GetInputPort("gravity"))
builder.ExportInput(craft.GetInputPort("force"), "force")
plant = builder.Build()

context = plant.CreateDefaultContext()
plant.get_input_port().FixValue(context, np.zeros(3))
linear = Linearize(plant, context, equilibrium_check_tolerance=1.0)
print("eigenvalues (1/s):", np.round(np.linalg.eigvals(linear.A()), 6))

steps = 21
program = DirectCollocation(plant, context, steps, 100.0, 300.0)
program.AddEqualTimeIntervalsConstraints()
program.prog().AddBoundingBoxConstraint(START, START, program.initial_state())
program.prog().AddBoundingBoxConstraint(GOAL, GOAL, program.final_state())
program.AddRunningCost(sum(force**2 for force in program.input()))
for k in range(steps):
    program.prog().AddBoundingBoxConstraint(-7.0, 7.0, program.input(k))
    guess = START + k / (steps - 1) * (GOAL - START)
    program.prog().SetInitialGuess(program.state(k), guess)
result = Solve(program.prog())
times, forces = program.GetSampleTimes(result), program.GetInputSamples(result)
print("solved:", result.is_success(), "in", times[-1], "s of flight")
print("Δv:", np.abs(forces).sum(axis=0).mean() / 100.0 * times[-1], "m/s")
