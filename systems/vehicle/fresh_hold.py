"""`FreshHold`: a zero-order hold that already gives the new sample at the sample's time.

`Reckoning` goes on from such a sample of a state.
"""

from __future__ import annotations

import math

from pydrake.systems.framework import LeafSystem

from proxops.systems.common import check_positive

_ROUNDING = 1e-9


class FreshHold(LeafSystem):
    """Samples its input once a period, for what is computed more often.

    ```
                ┌───────────┐
    u (size) ──►│ FreshHold ├─► y (size): u at whole multiples of the period, else the last sample
                └───────────┘
    ```

    Drake's `ZeroOrderHold` gives a sample just after its time. What reads it in the same instant
    would get the sample before, and act a step late. The sample is discrete state.
    """

    def __init__(self, period: float, size: int):
        """Takes the period in s and the size of input and output."""
        super().__init__()
        check_positive("FreshHold", period=period)
        self.period = period
        self._u_port = self.DeclareVectorInputPort("u", size)
        self._sample = self.DeclareDiscreteState(size)
        depends = {self._u_port.ticket(), self.xd_ticket(), self.time_ticket()}
        self.DeclareVectorOutputPort("y", size, self._calc, depends)
        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._keep)

    def _calc(self, context, output):
        periods = context.get_time() / self.period
        if abs(periods - round(periods)) < _ROUNDING:
            output.SetFromVector(self._u_port.Eval(context))
        else:
            output.SetFromVector(context.get_discrete_state(self._sample).value())

    def _keep(self, context, discrete_state):
        discrete_state.set_value(self._sample, self._u_port.Eval(context))


class Reckoning(LeafSystem):
    """The position between samples of a state: it moves on with the velocity of the last.

    ```
    state (6), m and m/s: as `FreshHold` gives it ──► Reckoning ──► position (3), m
    ```
    """

    def __init__(self, period: float):
        """Takes the period of the samples in s; they are of its whole multiples."""
        super().__init__()
        check_positive("Reckoning", period=period)
        self.period = period
        self._port = self.DeclareVectorInputPort("state", 6)
        depends = {self._port.ticket(), self.time_ticket()}
        self.DeclareVectorOutputPort("position", 3, self._calc, depends)

    def _calc(self, context, output):
        state, time = self._port.Eval(context), context.get_time()
        since = time - self.period * math.floor(time / self.period + _ROUNDING)
        output.SetFromVector(state[:3] + since * state[3:])
