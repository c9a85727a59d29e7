"""`GivenForce`: the force that thrusters gave over the last control period, as is known."""

from __future__ import annotations

import numpy as np
from pydrake.systems.framework import LeafSystem


class GivenForce(LeafSystem):
    """What the attitude periods of the last control period gave together.

    ```
    force (3), N ────►┌────────────┐─► mean_force (3), N
    thrust (1), N ───►│ GivenForce │─► mean_thrust (1), N
    apart (3), N ────►│            │─► mean_apart (3), N
                      └────────────┘─► force_lead (3), N s^2
    ```

    The inputs are the force of all thrusters together, the sum of their sizes, and the root of the
    sum of their squares along each axis, in the attitude period that begins at each attitude step;
    the means are those of the periods before a control step. If each thruster's force is off by a
    share of its own, all together are off by such a share of `mean_apart`, or less. `force_lead` is
    the integral of the force times how long before the middle of the control period it acts: over
    the mass, how much farther it moves the spacecraft than its mean would. The sums are discrete
    state, so the outputs do not depend on the inputs directly.
    """

    def __init__(self, period: float, steps: int):
        """Takes the attitude period in s, and how many there are in a control period."""
        super().__init__()
        self.period, self.steps = period, steps
        self._force_port = self.DeclareVectorInputPort("force", 3)
        self._thrust_port = self.DeclareVectorInputPort("thrust", 1)
        self._apart_port = self.DeclareVectorInputPort("apart", 3)
        self.DeclareDiscreteState(10)  # In the order of the outputs.
        depends = {self.xd_ticket()}
        for name, part, periods in (
            ("mean_force", slice(0, 3), steps),
            ("mean_thrust", slice(3, 4), steps),
            ("mean_apart", slice(4, 7), steps),
            ("force_lead", slice(7, 10), 1),
        ):
            self.DeclareVectorOutputPort(
                name,
                part.stop - part.start,
                lambda context, output, part=part, periods=periods: output.SetFromVector(
                    context.get_discrete_state_vector().value()[part] / periods
                ),
                depends,
            )
        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._add)

    def _add(self, context, discrete_state):
        force = self._force_port.Eval(context)
        sizes = [self._thrust_port.Eval(context), self._apart_port.Eval(context)]
        step = round(context.get_time() / self.period) % self.steps
        early = self.period**2 * (0.5 * (self.steps - 1) - step)
        before = context.get_discrete_state_vector().value() if step else 0.0
        discrete_state.set_value(np.concatenate([force, *sizes, early * force]) + before)
