"""`GivenForce`: the force that thrusters gave over the last control period, as is known."""

from __future__ import annotations

import numpy as np
from pydrake.systems.framework import LeafSystem


class GivenForce(LeafSystem):
    """What the attitude periods of the last control period gave together.

    ```
                      ┌────────────┐─► mean_force (3), N
    force (3), N ────►│            │
                      │ GivenForce │─► mean_thrust (1), N
    thrust (1), N ───►│            │
                      └────────────┘─► force_lead (3), N s^2
    ```

    The inputs are the force of all thrusters together, and the sum of their sizes, in the attitude
    period that begins at each attitude step; the means are those of the periods before a control
    step. `force_lead` is the integral of the force times how long before the middle of the control
    period it acts: over the mass, how much farther it moves the spacecraft than its mean would. The
    sums are discrete state, so the outputs do not depend on the inputs directly.
    """

    def __init__(self, period: float, steps: int):
        """Takes the attitude period in s, and how many there are in a control period."""
        super().__init__()
        self.period, self.steps = period, steps
        self._force_port = self.DeclareVectorInputPort("force", 3)
        self._thrust_port = self.DeclareVectorInputPort("thrust", 1)
        self.DeclareDiscreteState(7)  # In the order of the outputs.
        depends = {self.xd_ticket()}
        self.DeclareVectorOutputPort("mean_force", 3, self._calc_mean_force, depends)
        self.DeclareVectorOutputPort("mean_thrust", 1, self._calc_mean_thrust, depends)
        self.DeclareVectorOutputPort("force_lead", 3, self._calc_force_lead, depends)
        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._add)

    def _calc_mean_force(self, context, output):
        output.SetFromVector(context.get_discrete_state_vector().value()[:3] / self.steps)

    def _calc_mean_thrust(self, context, output):
        output.SetFromVector(context.get_discrete_state_vector().value()[3:4] / self.steps)

    def _calc_force_lead(self, context, output):
        output.SetFromVector(context.get_discrete_state_vector().value()[4:])

    def _add(self, context, discrete_state):
        force, thrust = self._force_port.Eval(context), self._thrust_port.Eval(context)
        step = round(context.get_time() / self.period) % self.steps
        early = self.period**2 * (0.5 * (self.steps - 1) - step)
        before = context.get_discrete_state_vector().value() if step else 0.0
        discrete_state.set_value(np.concatenate([force, thrust, early * force]) + before)
