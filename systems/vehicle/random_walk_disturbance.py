"""`RandomWalkDisturbance`: a random walk on the force, as in the paper."""

from __future__ import annotations

import numpy as np

from proxops.systems.common import (
    LONG,
    InputError,
    Vector3,
    check_not_negative,
    check_positive,
    config,
    generator,
    number,
)
from proxops.systems.vehicle.force_disturbance import ForceDisturbance


@config
class RandomWalkDisturbanceConfig:
    """The paper's disturbance: a slow random walk that is added to the commanded force."""

    # After each such period the walk starts again, with a new limit.
    reset_period_s: float = number(100.0, at_least=1e-2, at_most=LONG, unit="s")
    # At each start the limit is drawn uniformly between 0 and this multiple of the command's size.
    max_relative_magnitude: float = number(2.0, at_least=0.0, at_most=1e3)
    # Standard deviation, per axis, of the walk's increment at each control step.
    increment_std_n: float = number(0.5, at_least=0.0, at_most=1e7, unit="N")


class RandomWalkDisturbance(ForceDisturbance):
    """Adds a random walk to a force, as the paper did for its disturbed transits.

    ```
                ┌───────────────────────┐
    force ─────►│ RandomWalkDisturbance ├─► force (3), N: clip(force + walk, ± thrust limit)
      (3), N    └───────────────────────┘
    ```

    Each period a normal increment per axis is added to the walk. Every `reset_period`,
    rounded to whole control periods, the walk starts again from zero and its bound k is drawn from
    U(0, max_relative_magnitude). The walk's length is limited to k ‖force‖, so it has no effect on
    a command of zero. The first increment acts from time 0 on.
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
        """Takes forces in N and periods in s; `period` is the control period."""
        super().__init__(thrust_limit, period, seed)
        owner = "RandomWalkDisturbance"
        check_positive(owner, reset_period=reset_period)
        check_not_negative(
            owner, max_relative_magnitude=max_relative_magnitude, increment_std=increment_std
        )
        if reset_period < period:
            raise InputError(
                f"{owner} needs a reset_period of at least its period, {period} s, "
                f"got {reset_period} s"
            )
        self.max_relative_magnitude, self.increment_std = max_relative_magnitude, increment_std
        self._steps_per_reset = round(reset_period / period)

    def next_added(self, command: np.ndarray, last: np.ndarray, seed: int, step: int) -> Vector3:
        """Returns the next value (3,) of the walk, in N."""
        stretch, since_reset = divmod(step, self._steps_per_reset)
        # Steps count up from 0 and stretches down from the greatest key, so that no two keys are
        # the same.
        drawn = generator(seed, np.iinfo(np.uint64).max - stretch).random()
        start = np.zeros(3) if since_reset == 0 else last
        walk = start + self.increment_std * generator(seed, step).standard_normal(3)
        limit = self.max_relative_magnitude * drawn * float(np.linalg.norm(command))
        length = float(np.linalg.norm(walk))
        return walk * (limit / length) if length > limit else walk
