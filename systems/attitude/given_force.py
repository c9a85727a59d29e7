"""`GivenForce`: the mean force that thrusters gave over the last control period, as is known."""

from __future__ import annotations

from pydrake.systems.framework import LeafSystem


class GivenForce(LeafSystem):
    """The mean, over the last control period, of what each attitude period gives.

    ```
    force (n), N ──► GivenForce ──► mean (n), N
    ```

    The input is the force of the attitude period that begins at each attitude step; the mean is
    that of the periods before a control step. The sum is discrete state, so the output does not
    depend on the input directly.
    """

    def __init__(self, period: float, steps: int, size: int = 3):
        """Takes the attitude period in s, how many there are in a control period, and n."""
        super().__init__()
        self.period, self.steps = period, steps
        self._port = self.DeclareVectorInputPort("force", size)
        self._sum = self.DeclareDiscreteState(size)
        self.DeclareVectorOutputPort("mean", size, self._calc, {self.xd_ticket()})
        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._add)

    def _calc(self, context, output):
        output.SetFromVector(context.get_discrete_state(self._sum).value() / self.steps)

    def _add(self, context, discrete_state):
        total = self._port.Eval(context)
        if round(context.get_time() / self.period) % self.steps:
            total = total + context.get_discrete_state(self._sum).value()
        discrete_state.set_value(self._sum, total)
