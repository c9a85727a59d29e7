"""The guidance law of our policy without anything learned, as a controller of its own."""

from __future__ import annotations

import numpy as np
from pydrake.systems.framework import Diagram, DiagramBuilder, LeafSystem

from proxops.diagrams.flight import named_controller
from proxops.diagrams.scenario import Body, Scenario
from proxops.systems.expert import Horizon

# What the pilot has learned of the time T: the acceleration in m/s^2 that T is planned
# with, and the least time in s. In its ONNX file they are `exp_5` and the root of `exp_6`.
ACCELERATION, LEAST_TIME = 0.024823, 207.0


class LeastEffort(LeafSystem):
    """The law of least quadratic effort from here to rest at the goal in a time T.

    ```
    state (6) ──►┌─────────────┐
    target (6) ─►│ LeastEffort ├─► force (3), N
                 └─────────────┘
    ```

    With the way to go e, the velocity v and the mass m, per axis::

        force = clip(m (6 e / T^2 - 4 v / T - natural acceleration), ±F)

    The natural acceleration is that of the polyhedron's gravity and of the rotating frame. T^2 is
    the sum of the squares of `Horizon.time_to_go` and of the least time. The network that corrects
    T, both gains and the force is left out. Only that network knows the keep-out ellipsoid: this
    law flies straight on.
    """

    def __init__(self, scenario: Scenario, body: Body):
        super().__init__()
        craft = scenario.spacecraft
        self.mass, self.limit = craft.mass_kg, craft.thrust_limit_n
        self.field, self.spin = body.gravity_field, body.spin_rate
        # The least time is added below; a horizon needs a length above 0.
        self.horizon = Horizon(minimum=1e-9, nominal_acceleration=ACCELERATION)
        self._state_port = self.DeclareVectorInputPort("state", 6)
        self._target_port = self.DeclareVectorInputPort("target", 6)
        inputs = {self._state_port.ticket(), self._target_port.ticket()}
        self.DeclareVectorOutputPort("force", 3, self._calc_force, inputs)

    def _calc_force(self, context, output):
        state, target = self._state_port.Eval(context), self._target_port.Eval(context)
        if not np.isfinite(state).all():
            output.SetFromVector(np.zeros(3))
            return
        time = np.hypot(self.horizon.time_to_go(state, target), LEAST_TIME)
        way, velocity = (target - state)[:3], state[3:]
        wanted = 6.0 * way / time**2 - 4.0 * velocity / time - self.natural(state)
        output.SetFromVector(np.clip(self.mass * wanted, -self.limit, self.limit))

    def natural(self, state: np.ndarray) -> np.ndarray:
        """Acceleration (3,) in m/s^2 in K without thrust at a state (6,)."""
        gravity = self.field.evaluate(state[None, :3]).acceleration[0]
        x, y, _, vx, vy, _ = state
        w = self.spin
        apparent = [w**2 * x + 2.0 * w * vy, w**2 * y - 2.0 * w * vx, 0.0]
        return gravity + np.array(apparent)


def on_true_state(scenario: Scenario, body: Body) -> LeastEffort:
    """The law with the true state, to be flown as `_bare_law:on_true_state`."""
    return LeastEffort(scenario, body)


def on_estimate(scenario: Scenario, body: Body) -> Diagram:
    """The law on the state that the pilot estimates: `_bare_law:on_estimate`."""
    policy = named_controller("policy:end-to-end", scenario, body)
    law = LeastEffort(scenario, body)
    builder = DiagramBuilder()
    builder.AddNamedSystem("policy", policy)
    builder.AddNamedSystem("law", law)
    builder.Connect(policy.GetOutputPort("estimate"), law.GetInputPort("state"))
    for name in ("ranges", "target", "commanded_force"):
        builder.ExportInput(policy.GetInputPort(name), name)
    builder.ConnectInput("target", law.GetInputPort("target"))
    builder.ExportOutput(law.GetOutputPort("force"), "force")
    return builder.Build()
