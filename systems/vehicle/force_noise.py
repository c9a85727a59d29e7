"""`ForceNoise`: normal noise of its own size added to the commanded force."""

from __future__ import annotations

import math

import numpy as np
from pydrake.systems.framework import BasicVector, LeafSystem, NumericParameterIndex

from proxops.systems.common import InputError, generator


class ForceNoise(LeafSystem):
    """Adds noise to a force whatever its size, so that a coasting spacecraft is disturbed too.

    ```
                ┌────────────┐
    force ─────►│ ForceNoise ├─► force (3), N: clip(force + noise, ± thrust limit)
      (3), N    └────────────┘
    ```

    Noise in the expert's actuators that its labels do not show is how DART (Laskey et al., 2017,
    arXiv:1703.09327) puts recovery into the data. Each axis is a stationary Gauss-Markov sequence,

        n_0 = s w_0,   n_k = r n_(k-1) + s sqrt(1 - r^2) w_k,   r = exp(-period / correlation time)

    with standard deviation s and independent standard normal w: white if the correlation time is
    0. The sequence is discrete state; the random numbers are a pure function of the seed (a
    parameter in the Context) and the step.
    """

    def __init__(
        self,
        thrust_limit: float,
        std: float = 0.7,
        correlation_time: float = 100.0,
        period: float = 10.0,
        seed: int = 0,
    ):
        """Takes forces in N and times in s; `period` is the control period.

        Raises:
          InputError: the limit or the period is not positive, or another property is negative or
            infinite.
        """
        super().__init__()
        if not (thrust_limit > 0 and 0 < period < math.inf):
            raise InputError(
                f"force noise needs thrust_limit > 0 and period > 0, got {thrust_limit}, {period}"
            )
        if not (0 <= std < math.inf and 0 <= correlation_time < math.inf and seed >= 0):
            raise InputError(
                "force noise needs a deviation, correlation time and seed that are finite and not "
                f"negative, got {std}, {correlation_time}, {seed}"
            )
        self.thrust_limit, self.std, self.period = thrust_limit, std, period
        self.kept = math.exp(-period / correlation_time) if correlation_time > 0 else 0.0
        self._seed_index = self.DeclareNumericParameter(BasicVector([float(seed)]))
        self._force_in_port = self.DeclareVectorInputPort(name="force", size=3)
        self._noise_index = self.DeclareDiscreteState(3)
        self._force_out_port = self.DeclareVectorOutputPort(
            name="force",
            size=3,
            calc=self._calc_force,
            prerequisites_of_calc={
                self._force_in_port.ticket(),
                self.discrete_state_ticket(self._noise_index),
                self.time_ticket(),
                self.numeric_parameter_ticket(NumericParameterIndex(self._seed_index)),
            },
        )
        self.DeclarePeriodicDiscreteUpdateEvent(
            period_sec=period, offset_sec=0.0, update=self._update_noise
        )

    def set_seed(self, context, seed: int) -> None:
        """Sets the noise's seed in this system's Context."""
        context.get_mutable_numeric_parameter(self._seed_index).SetAtIndex(0, float(seed))

    def _next_noise(self, context) -> np.ndarray:
        seed = int(context.get_numeric_parameter(self._seed_index).GetAtIndex(0))
        step = round(context.get_time() / self.period)
        drawn = self.std * generator(seed, step).standard_normal(3)
        if step == 0:
            return drawn
        last = context.get_discrete_state(self._noise_index).value()
        return self.kept * last + math.sqrt(1.0 - self.kept**2) * drawn

    def _calc_force(self, context, output):
        total = self._force_in_port.Eval(context) + self._next_noise(context)
        output.SetFromVector(np.clip(total, -self.thrust_limit, self.thrust_limit))

    def _update_noise(self, context, discrete_state):
        discrete_state.set_value(self._noise_index, self._next_noise(context))
