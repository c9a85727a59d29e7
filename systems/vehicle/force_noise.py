"""`ForceNoise`: noise on the force that does not depend on the command."""

from __future__ import annotations

import math

import numpy as np

from proxops.systems.common import LONG, Vector3, check_not_negative, config, generator, number
from proxops.systems.vehicle.force_disturbance import ForceDisturbance


@config
class ForceNoiseConfig:
    """Normal noise that is added to the commanded force.

    Its size does not depend on the command, so it also acts while the spacecraft coasts.
    """

    # Standard deviation per axis, and the time over which the correlation of the noise decays;
    # 0 gives white noise.
    std_n: float = number(0.7, at_least=0.0, at_most=1e7, unit="N")
    correlation_time_s: float = number(100.0, at_least=0.0, at_most=LONG, unit="s")


class ForceNoise(ForceDisturbance):
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
    is 0.
    """

    def __init__(
        self,
        thrust_limit: float,
        std: float = 0.7,
        correlation_time: float = 100.0,
        period: float = 10.0,
        seed: int = 0,
    ):
        """Takes forces in N and times in s; `period` is the control period."""
        super().__init__(thrust_limit, period, seed)
        check_not_negative("ForceNoise", std=std, correlation_time=correlation_time)
        self.std = std
        self.kept = math.exp(-period / correlation_time) if correlation_time > 0 else 0.0

    def next_added(self, command: np.ndarray, last: np.ndarray, seed: int, step: int) -> Vector3:
        """Returns the next value (3,) of the sequence, in N."""
        drawn = self.std * generator(seed, step).standard_normal(3)
        if step == 0:
            return drawn
        return self.kept * last + math.sqrt(1.0 - self.kept**2) * drawn
