"""`FrameDelay`: a lidar whose frames arrive some control steps late."""

from __future__ import annotations

import numpy as np
from pydrake.systems.framework import LeafSystem

from proxops.systems.common import InputError, check_positive

_MOST_STEPS = 1000


class FrameDelay(LeafSystem):
    """Puts out the frame that was measured some control steps before.

    ```
                      ┌────────────┐
    ranges (size) ───►│ FrameDelay ├─► ranges (size), m; +inf: no return
                      └────────────┘
    ```

    With the period T and n steps, the frame f(k T) measured at k T is put out at (k + n) T::

        y(t) = f((k - n) T)   for   (k - 1) T < t <= k T,   and +inf before there is one

    An update takes effect just after its time, so what is evaluated at a control step is the frame
    of n steps before. The frames that wait are one discrete state of the Context. There is no
    direct feedthrough.
    """

    def __init__(self, size: int, steps: int, period: float):
        """Takes the number of rays, the delay in control steps, and the control period in s.

        Raises:
          InputError: there is no ray, the period is not positive, or the steps are not a whole
            number from 1 to 1000. Leave the system out where there is no delay.
        """
        super().__init__()
        check_positive("a frame delay", size=size, period=period)
        if not (1 <= steps <= _MOST_STEPS and steps == int(steps)):
            raise InputError(
                f"a frame delay needs a whole number of steps from 1 to {_MOST_STEPS}, got "
                f"{steps}: without a delay leave it out"
            )
        self.size, self.steps, self.period = size, int(steps), period
        self._ranges_port = self.DeclareVectorInputPort("ranges", size)
        # The newest frame is first.
        self._waiting = self.DeclareDiscreteState(np.full(self.steps * size, np.inf))
        self.DeclareVectorOutputPort(
            "ranges", size, self._calc_ranges, {self.discrete_state_ticket(self._waiting)}
        )
        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._take_frame)

    def _calc_ranges(self, context, output):
        output.SetFromVector(context.get_discrete_state(self._waiting).value()[-self.size :])

    def _take_frame(self, context, discrete_state):
        older = context.get_discrete_state(self._waiting).value()[: -self.size]
        frames = np.concatenate([self._ranges_port.Eval(context), older])
        discrete_state.set_value(self._waiting, frames)
