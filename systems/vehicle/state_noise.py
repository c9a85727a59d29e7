"""`StateNoise`: a state that is known with errors."""

from __future__ import annotations

import math

import numpy as np

from proxops.systems.common import SeededSystem, check_not_negative, generator


class StateNoise(SeededSystem):
    """Adds independent normal errors to a state and draws new ones at each control step.

    ```
                ┌────────────┐
    state ─────►│ StateNoise ├─► state (6), m and m/s
      (6)       └────────────┘
    ```

    Where both standard deviations are 0, the output is the input.
    """

    def __init__(
        self,
        position_std: float = 0.0,
        velocity_std: float = 0.0,
        period: float = 10.0,
        seed: int = 0,
    ):
        """Takes standard deviations per axis in m and m/s, and the control period in s."""
        super().__init__(period, seed)
        check_not_negative("StateNoise", position_std=position_std, velocity_std=velocity_std)
        self.stds = np.repeat([position_std, velocity_std], 3)
        self._state_port = self.DeclareVectorInputPort("state", 6)
        self.DeclareVectorOutputPort(
            "state", 6, self._calc_state, {self._state_port.ticket(), *self.seed_tickets()}
        )

    def step_of(self, context) -> int:
        """The number of the control step that began last.

        The state changes between control steps, too, so the noise may be asked for at any time.
        """
        # Rounding may bring the time of a step just below a multiple of the period.
        return math.floor(context.get_time() / self.period + 1e-9)

    def _calc_state(self, context, output):
        state = self._state_port.Eval(context)
        if self.stds.any():
            draws = generator(self.seed_of(context), self.step_of(context))
            state = state + self.stds * draws.standard_normal(6)
        output.SetFromVector(state)
