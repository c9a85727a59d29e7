"""`ForceNoise`: noise on the force that does not depend on the command."""

from __future__ import annotations

import math

import numpy as np

from proxops.systems.common import SeededSystem, check_not_negative, check_positive, generator


class ForceNoise(SeededSystem):
    """Adds normal noise to a force. Its size does not depend on the force.

    ```
                ┌────────────┐
    force ─────►│ ForceNoise ├─► force (3), N: clip(force + noise, ± thrust limit)
      (3), N    └────────────┘
    ```

    A coasting spacecraft is disturbed, too. DART (Laskey et al., 2017, arXiv:1703.09327) adds such
    noise to an expert's actions, and not to its labels, so that the data hold recoveries. Each axis
    is a stationary Gauss-Markov sequence,

        n_0 = s w_0,   n_k = r n_(k-1) + s sqrt(1 - r^2) w_k,   r = exp(-period / correlation time)

    with standard deviation s and independent standard normal w. It is white if the correlation time
    is 0. The last value of the sequence is discrete state.
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
            not finite.
        """
        super().__init__(period, seed)
        check_positive("ForceNoise", thrust_limit=thrust_limit)
        check_not_negative("ForceNoise", std=std, correlation_time=correlation_time)
        self.thrust_limit, self.std = thrust_limit, std
        self.kept = math.exp(-period / correlation_time) if correlation_time > 0 else 0.0
        self._force_in_port = self.DeclareVectorInputPort(name="force", size=3)
        self._noise_index = self.DeclareDiscreteState(3)
        self._force_out_port = self.DeclareVectorOutputPort(
            name="force",
            size=3,
            calc=self._calc_force,
            prerequisites_of_calc={
                self._force_in_port.ticket(),
                self.discrete_state_ticket(self._noise_index),
                *self.seed_tickets(),
            },
        )
        self.DeclarePeriodicDiscreteUpdateEvent(
            period_sec=period, offset_sec=0.0, update=self._update_noise
        )

    def _next_noise(self, context) -> np.ndarray:
        step = self.step_of(context)
        drawn = self.std * generator(self.seed_of(context), step).standard_normal(3)
        if step == 0:
            return drawn
        last = context.get_discrete_state(self._noise_index).value()
        return self.kept * last + math.sqrt(1.0 - self.kept**2) * drawn

    def _calc_force(self, context, output):
        total = self._force_in_port.Eval(context) + self._next_noise(context)
        output.SetFromVector(np.clip(total, -self.thrust_limit, self.thrust_limit))

    def _update_noise(self, context, discrete_state):
        discrete_state.set_value(self._noise_index, self._next_noise(context))
