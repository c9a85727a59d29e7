"""`VelocityKicks`: pushes at random times that no thruster gives and no command shows."""

from __future__ import annotations

import math

import numpy as np
from pydrake.systems.framework import BasicVector, LeafSystem, NumericParameterIndex

from proxops.systems.common import InputError, generator


class VelocityKicks(LeafSystem):
    """Now and then, for one control period, accelerates the spacecraft by an unknown amount.

    ```
    ┌───────────────┐
    │               ├─► acceleration (3), m/s^2, K: what acts now
    │ VelocityKicks │
    │               ├─► next_acceleration (3), m/s^2, K: what acts from this control step on
    └───────────────┘
    ```

    In each control period, with the chance `period / mean_interval`, the velocity changes by a
    normal amount per axis. The change is spread evenly over the period: a state that jumped would
    pass by the witness functions of events, and by whoever interpolates between two rows of a log.

    Which periods have a kick, and which, is a pure function of the seed (a parameter in the
    Context) and the step. What acts is discrete state, renewed at each control step, so that it is
    constant from one to the next as a held force is. At a control step, before that update,
    `next_acceleration` is what is about to act.
    """

    def __init__(
        self,
        velocity_std: float = 2.0,
        mean_interval: float = 900.0,
        period: float = 10.0,
        seed: int = 0,
    ):
        """Takes the deviation per axis of a kick in m/s, the mean time between kicks in s.

        Raises:
          InputError: a property that no kicks have.
        """
        super().__init__()
        if not (0 < period <= mean_interval < math.inf):
            raise InputError(
                "kicks need mean_interval >= period > 0, both finite, "
                f"got {mean_interval} and {period}"
            )
        if not (0 <= velocity_std < math.inf and seed >= 0):
            raise InputError(
                "kicks need a velocity_std and a seed that are finite and not negative, "
                f"got {velocity_std} and {seed}"
            )
        self.velocity_std, self.mean_interval, self.period = velocity_std, mean_interval, period
        self._seed_index = self.DeclareNumericParameter(BasicVector([float(seed)]))
        acting = self.DeclareDiscreteState(3)
        self.DeclareStateOutputPort(name="acceleration", state_index=acting)
        self.DeclareVectorOutputPort(
            name="next_acceleration",
            size=3,
            calc=lambda context, output: output.SetFromVector(self._next(context)),
            prerequisites_of_calc={
                self.time_ticket(),
                self.numeric_parameter_ticket(NumericParameterIndex(self._seed_index)),
            },
        )
        self.DeclarePeriodicDiscreteUpdateEvent(
            period_sec=period,
            offset_sec=0.0,
            update=lambda context, state: state.set_value(acting, self._next(context)),
        )

    def set_seed(self, context, seed: int) -> None:
        """Sets the kicks' seed in this system's Context."""
        context.get_mutable_numeric_parameter(self._seed_index).SetAtIndex(0, float(seed))

    def _next(self, context) -> np.ndarray:
        seed = int(context.get_numeric_parameter(self._seed_index).GetAtIndex(0))
        draws = generator(seed, round(context.get_time() / self.period))
        if draws.random() >= self.period / self.mean_interval:
            return np.zeros(3)
        return self.velocity_std / self.period * draws.standard_normal(3)
