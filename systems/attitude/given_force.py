"""`GivenForce`: the force that thrusters gave over the last control period, as is known."""

from __future__ import annotations

from pydrake.systems.framework import LeafSystem


class GivenForce(LeafSystem):
    """The mean, over the last control period, of what each attitude period gives.

    ```
                      ┌────────────┐─► mean (n), N
    force (n), N ────►│ GivenForce │
                      └────────────┘─► lead (n), N s^2
    ```

    The input is the force of the attitude period that begins at each attitude step; the mean is
    that of the periods before a control step. `lead` is the integral of the force times how long
    before the middle of the control period it acts: over the mass, how much farther it moves the
    spacecraft than its mean would. The sums are discrete state, so the outputs do not depend on the
    input directly.
    """

    def __init__(self, period: float, steps: int, size: int = 3):
        """Takes the attitude period in s, how many there are in a control period, and n."""
        super().__init__()
        self.period, self.steps = period, steps
        self._port = self.DeclareVectorInputPort("force", size)
        self._sum, self._lead = self.DeclareDiscreteState(size), self.DeclareDiscreteState(size)
        self.DeclareVectorOutputPort("mean", size, self._calc_mean, {self.xd_ticket()})
        self.DeclareVectorOutputPort("lead", size, self._calc_lead, {self.xd_ticket()})
        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._add)

    def _calc_mean(self, context, output):
        output.SetFromVector(context.get_discrete_state(self._sum).value() / self.steps)

    def _calc_lead(self, context, output):
        output.SetFromVector(context.get_discrete_state(self._lead).value())

    def _add(self, context, discrete_state):
        force = self._port.Eval(context)
        step = round(context.get_time() / self.period) % self.steps
        early = self.period**2 * (0.5 * (self.steps - 1) - step)
        for index, part in ((self._sum, force), (self._lead, early * force)):
            before = context.get_discrete_state(index).value() if step else 0.0
            discrete_state.set_value(index, part + before)
