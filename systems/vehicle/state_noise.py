"""`StateNoise`: a state that is known with errors."""

from __future__ import annotations

import math

import numpy as np
from pydrake.systems.framework import BasicVector, LeafSystem, NumericParameterIndex

from proxops.systems.common import InputError, generator


class StateNoise(LeafSystem):
    """Adds independent normal errors to a state, new ones each control step.

    ```
                ┌────────────┐
    state ─────►│ StateNoise ├─► state (6), m and m/s
      (6)       └────────────┘
    ```

    The errors are a pure function of the seed (a parameter in the Context) and the step. Without
    deviations the state is passed on as it is.
    """

    def __init__(
        self,
        position_std: float = 0.0,
        velocity_std: float = 0.0,
        period: float = 10.0,
        seed: int = 0,
    ):
        """Takes standard deviations per axis in m and m/s, and the control period in s.

        Raises:
          InputError: a deviation or the seed is negative or not finite, or the period not positive.
        """
        super().__init__()
        finite = 0.0 <= position_std < math.inf and 0.0 <= velocity_std < math.inf
        if not (finite and period > 0.0 and seed >= 0):
            raise InputError(
                "state noise needs deviations and a seed that are finite and not negative, and a "
                f"period above 0, got {position_std}, {velocity_std}, {seed} and {period}"
            )
        self.stds = np.repeat([position_std, velocity_std], 3)
        self.period = period
        self._seed_index = self.DeclareNumericParameter(BasicVector([float(seed)]))
        self._state_port = self.DeclareVectorInputPort(name="state", size=6)
        self.DeclareVectorOutputPort(
            name="state",
            size=6,
            calc=self._calc_state,
            prerequisites_of_calc={
                self._state_port.ticket(),
                self.time_ticket(),
                self.numeric_parameter_ticket(NumericParameterIndex(self._seed_index)),
            },
        )

    def set_seed(self, context, seed: int) -> None:
        """Sets the noise's seed in this system's Context."""
        context.get_mutable_numeric_parameter(self._seed_index).SetAtIndex(0, float(seed))

    def _calc_state(self, context, output):
        state = self._state_port.Eval(context)
        if self.stds.any():
            seed = int(context.get_numeric_parameter(self._seed_index).GetAtIndex(0))
            # Within a step the number does not change, though its last bit of time may.
            step = math.floor(context.get_time() / self.period + 1e-9)
            state = state + self.stds * generator(seed, step).standard_normal(6)
        output.SetFromVector(state)
