"""`ForceDisturbance`: what all random disturbances of a force share."""

from __future__ import annotations

import numpy as np

from proxops.systems.common import SeededSystem, Vector3, check_positive


class ForceDisturbance(SeededSystem):
    """Adds a random force to a commanded one, and limits the sum.

    ```
                  ┌──────────────────┐
    force (3) ───►│ ForceDisturbance ├─► force (3), N
                  └──────────────────┘
    ```

    A subclass says in `next_added` what is added over the period that begins. The last force that
    was added is discrete state, which is updated at every control step. So read the output
    through a hold, at control steps before the update: after it, the next force would be added.
    """

    def __init__(self, thrust_limit: float, period: float, seed: int):
        """Takes the limit of each axis in N, the control period in s, and the default seed."""
        super().__init__(period, seed)
        check_positive(type(self).__name__, thrust_limit=thrust_limit)
        self.thrust_limit = thrust_limit
        self._force_in_port = self.DeclareVectorInputPort("force", 3)
        self._added_index = self.DeclareDiscreteState(3)
        self.DeclareVectorOutputPort(
            "force",
            3,
            self._calc_force,
            {
                self._force_in_port.ticket(),
                self.discrete_state_ticket(self._added_index),
                *self.seed_tickets(),
            },
        )
        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._update_added)

    def next_added(self, command: Vector3, last: Vector3, seed: int, step: int) -> Vector3:
        """Returns the force (3,) in N that is added over a period.

        Args:
          command: (3,) in N, the force that comes in.
          last: (3,) in N, what was added over the last period; zeros at step 0.
          seed: the seed in the Context.
          step: number of the period, from 0.
        """
        raise NotImplementedError

    def _added(self, context) -> np.ndarray:
        last = context.get_discrete_state(self._added_index).value()
        command = self._force_in_port.Eval(context)
        return self.next_added(command, last, self.seed_of(context), self.step_of(context))

    def _calc_force(self, context, output):
        total = self._force_in_port.Eval(context) + self._added(context)
        output.SetFromVector(np.clip(total, -self.thrust_limit, self.thrust_limit))

    def _update_added(self, context, discrete_state):
        discrete_state.set_value(self._added_index, self._added(context))
