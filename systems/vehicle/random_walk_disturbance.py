"""`RandomWalkDisturbance`: the paper's slow random walk added to the commanded force."""

from __future__ import annotations

import numpy as np
from pydrake.systems.framework import BasicVector, LeafSystem, NumericParameterIndex

from proxops.systems.common import InputError, generator


def shortened(vector: np.ndarray, limit: float) -> np.ndarray:
    """`vector` (n,), scaled down to the length `limit` if it is longer."""
    length = float(np.linalg.norm(vector))
    return vector * (limit / length) if length > limit else vector


class RandomWalkDisturbance(LeafSystem):
    """Adds a random walk to a force, as the paper did to fly its recovery transits.

    ```
                ┌───────────────────────┐
    force ─────►│ RandomWalkDisturbance ├─► force (3), N: clip(force + walk, ± thrust limit)
      (3), N    └───────────────────────┘
    ```

    The walk grows each period by a normal increment per axis. Every `reset_period` it starts
    anew at zero and its bound k is drawn from U(0, max_relative_magnitude); its length is kept
    within k ‖force‖. So it has no effect on a command of zero. The walk is discrete state; the
    random numbers are a pure function of the seed (a parameter in the Context) and the step.
    At time 0 the first increment is already there.
    """

    def __init__(
        self,
        thrust_limit: float,
        reset_period: float = 100.0,
        max_relative_magnitude: float = 2.0,
        increment_std: float = 0.5,
        period: float = 10.0,
        seed: int = 0,
    ):
        """Takes forces in N and periods in s; `period` is the control period.

        Raises:
          InputError: a limit or period is not positive, the reset comes within a period, or another
            property is negative or infinite.
        """
        super().__init__()
        if not (thrust_limit > 0 and 0 < period <= reset_period < np.inf):
            raise InputError(
                "a disturbance needs thrust_limit > 0 and reset_period >= period > 0, "
                f"got {thrust_limit}, {reset_period}, {period}"
            )
        if not (0 <= max_relative_magnitude < np.inf and 0 <= increment_std < np.inf and seed >= 0):
            raise InputError(
                "a disturbance's magnitude, increment and seed must be finite and not negative, "
                f"got {max_relative_magnitude}, {increment_std}, {seed}"
            )
        self.thrust_limit = thrust_limit
        self.max_relative_magnitude, self.increment_std = max_relative_magnitude, increment_std
        self.period, self._steps_per_reset = period, round(reset_period / period)
        self._seed_index = self.DeclareNumericParameter(BasicVector([float(seed)]))
        self._force_in_port = self.DeclareVectorInputPort(name="force", size=3)
        self._walk_index = self.DeclareDiscreteState(3)
        self._force_out_port = self.DeclareVectorOutputPort(
            name="force",
            size=3,
            calc=self._calc_force,
            prerequisites_of_calc={
                self._force_in_port.ticket(),
                self.discrete_state_ticket(self._walk_index),
                self.time_ticket(),
                self.numeric_parameter_ticket(NumericParameterIndex(self._seed_index)),
            },
        )
        self.DeclarePeriodicDiscreteUpdateEvent(
            period_sec=period, offset_sec=0.0, update=self._update_walk
        )

    def set_seed(self, context, seed: int) -> None:
        """Sets the walk's seed in this system's Context."""
        context.get_mutable_numeric_parameter(self._seed_index).SetAtIndex(0, float(seed))

    def _next_walk(self, context) -> np.ndarray:
        seed = int(context.get_numeric_parameter(self._seed_index).GetAtIndex(0))
        step = round(context.get_time() / self.period)
        stretch, since_reset = divmod(step, self._steps_per_reset)
        # Steps count up from 0 and stretches down from the top: their keys never meet.
        drawn = generator(seed, np.iinfo(np.uint64).max - stretch).random()
        walk = context.get_discrete_state(self._walk_index).value()
        start = np.zeros(3) if since_reset == 0 else walk
        increment = self.increment_std * generator(seed, step).standard_normal(3)
        command = self._force_in_port.Eval(context)
        limit = self.max_relative_magnitude * drawn * float(np.linalg.norm(command))
        return shortened(start + increment, limit)

    def _calc_force(self, context, output):
        total = self._force_in_port.Eval(context) + self._next_walk(context)
        output.SetFromVector(np.clip(total, -self.thrust_limit, self.thrust_limit))

    def _update_walk(self, context, discrete_state):
        discrete_state.set_value(self._walk_index, self._next_walk(context))
