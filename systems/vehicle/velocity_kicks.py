"""`VelocityKicks`: random accelerations that no thruster causes."""

from __future__ import annotations

import numpy as np

from proxops.systems.common import (
    LONG,
    InputError,
    SeededSystem,
    check_not_negative,
    check_positive,
    config,
    generator,
    number,
)


@config
class KicksConfig:
    """Pushes from outside at random times; each acts over one control period."""

    # Standard deviation, per axis, of the change of velocity by one push.
    velocity_std_m_s: float = number(2.0, at_least=0.0, at_most=1e5, unit="m/s")
    # Mean time from one push to the next.
    mean_interval_s: float = number(900.0, at_least=1e-2, at_most=LONG, unit="s")


class VelocityKicks(SeededSystem):
    """Accelerates the spacecraft at random times, for one control period each time.

    ```
    ┌───────────────┐
    │               ├─► acceleration (3), m/s^2, K: acts now
    │ VelocityKicks │
    │               ├─► next_acceleration (3), m/s^2, K: acts from this control step on
    └───────────────┘
    ```

    In each control period, with the probability `period / mean_interval`, the velocity changes by a
    normal amount per axis. The change is spread evenly over the period. A sudden change would
    escape the witness functions of events, and interpolation between a log's rows would be wrong.

    The acceleration is discrete state, updated at each control step, so that it is constant between
    steps, as a held force is. At a control step, before the update, `next_acceleration` is the
    acceleration that is about to act.
    """

    def __init__(
        self,
        velocity_std: float = 2.0,
        mean_interval: float = 900.0,
        period: float = 10.0,
        seed: int = 0,
    ):
        """Takes the standard deviation per axis in m/s, the mean interval and the period in s."""
        super().__init__(period, seed)
        check_positive("VelocityKicks", mean_interval=mean_interval)
        check_not_negative("VelocityKicks", velocity_std=velocity_std)
        if mean_interval < period:
            raise InputError(
                f"VelocityKicks needs a mean_interval of at least its period, {period} s, "
                f"got {mean_interval} s"
            )
        self.velocity_std, self.mean_interval = velocity_std, mean_interval
        acting = self.DeclareDiscreteState(3)
        self.DeclareStateOutputPort("acceleration", acting)
        self.DeclareVectorOutputPort(
            "next_acceleration",
            3,
            lambda context, output: output.SetFromVector(self._next(context)),
            self.seed_tickets(),
        )
        self.DeclarePeriodicDiscreteUpdateEvent(
            period, 0.0, lambda context, state: state.set_value(acting, self._next(context))
        )

    def _next(self, context) -> np.ndarray:
        draws = generator(self.seed_of(context), self.step_of(context))
        if draws.random() >= self.period / self.mean_interval:
            return np.zeros(3)
        return self.velocity_std / self.period * draws.standard_normal(3)
