"""`UnexplainedAcceleration`: a disturbance acceleration that is in no model."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from proxops.systems.common import LONG, config, number, vector
from proxops.systems.vehicle.gauss_markov import SlowVector


@config
class TrueAccelerationConfig:
    """Accelerations in K that nothing on board explains."""

    constant_m_s2: list[float] = vector([0.0] * 3, at_least=-1e6, at_most=1e6, unit="m/s^2")
    # Standard deviation, per axis, of an acceleration that varies (first-order Gauss-Markov), and
    # the time over which its correlation falls to 1/e.
    varying_std_m_s2: float = number(0.0, at_least=0.0, at_most=1e6, unit="m/s^2")
    correlation_time_s: float = number(600.0, at_least=1e-2, at_most=LONG, unit="s")


class UnexplainedAcceleration(SlowVector):
    """An acceleration from outside: a constant, and a Gauss-Markov process that varies slowly.

    ```
    ┌─────────────────────────┐
    │ UnexplainedAcceleration ├─► acceleration (3), m/s^2, K
    └─────────────────────────┘
    ```

    The output depends on time and seed alone; see `gauss_markov_at`.
    """

    def __init__(
        self,
        constant: Sequence[float] | np.ndarray = (0.0, 0.0, 0.0),
        std: float = 0.0,
        correlation_time: float = 600.0,
        period: float = 10.0,
        seed: int = 0,
    ):
        """Takes what is constant, and the size and slowness of what varies.

        Args:
          constant: (3,) in m/s^2 in K.
          std: standard deviation per axis in m/s^2 of the part that varies.
          correlation_time: s, of that part.
          period: control period in s.
          seed: the seed of a new Context.
        """
        super().__init__(constant, std, correlation_time, period, seed)
        self.DeclareVectorOutputPort(
            "acceleration",
            3,
            lambda context, output: output.SetFromVector(self.vector_at(context)),
            self.seed_tickets(),
        )
