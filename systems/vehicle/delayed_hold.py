"""`DelayedHold`: a zero-order hold whose samples take effect late."""

from __future__ import annotations

from pydrake.systems.framework import LeafSystem

from proxops.systems.common import InputError


class DelayedHold(LeafSystem):
    """Samples its input once a period and holds each sample, after a fixed delay, for one period.

    ```
                ┌─────────────┐
    u (size) ──►│ DelayedHold ├─► y (size)
                │             ├─► mean (size)
                └─────────────┘
    ```

    With the period T and the delay τ, 0 < τ <= T::

        y(t) = u(k T)   for   k T + τ < t <= (k + 1) T + τ,   and 0 before t = τ

    This is Drake's `ZeroOrderHold` with a delay; as there, an update takes effect just after its
    time. At the times k T, `mean` is the mean of y over the last period. Discrete states hold the
    sample that waits, the output, and the output before it. There is no direct feedthrough.
    """

    def __init__(self, period: float, delay: float, size: int):
        """Takes the period and the delay in s and the size of input and output."""
        super().__init__()
        if not 0.0 < delay <= period:
            raise InputError(
                "a delayed hold needs a delay above 0 and at most its period, "
                f"got {delay} s and {period} s"
            )
        self.period, self.delay = period, delay
        self._u_port = self.DeclareVectorInputPort("u", size)
        self._pending = self.DeclareDiscreteState(size)
        self._current = self.DeclareDiscreteState(size)
        self._before = self.DeclareDiscreteState(size)
        self.DeclareStateOutputPort("y", self._current)
        self.DeclareVectorOutputPort("mean", size, self._calc_mean, {self.xd_ticket()})
        declare = self.DeclarePeriodicDiscreteUpdateEvent
        # All updates at one time read the state before that time: at kT + T the waiting sample is
        # put out, and the new one waits. With a delay of one period, both events must have the same
        # offset: kT + T and (k + 1)T may differ in the last bit, and then the new sample would be
        # put out at once.
        declare(period, 0.0, self._sample)
        declare(period, delay if delay < period else 0.0, self._put_out)

    def _sample(self, context, discrete_state):
        discrete_state.set_value(self._pending, self._u_port.Eval(context))
        discrete_state.set_value(self._before, context.get_discrete_state(self._current).value())

    def _put_out(self, context, discrete_state):
        discrete_state.set_value(self._current, context.get_discrete_state(self._pending).value())

    def _calc_mean(self, context, output):
        before, current = (
            context.get_discrete_state(index).value() for index in (self._before, self._current)
        )
        # With a delay of a whole period, y changes at the times k T alone.
        share = self.delay / self.period % 1.0
        output.SetFromVector(share * before + (1.0 - share) * current)
