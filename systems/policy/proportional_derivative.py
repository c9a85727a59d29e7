"""`ProportionalDerivative`: the plain controller that others are measured against."""

from __future__ import annotations

import numpy as np
from pydrake.systems.framework import LeafSystem

from proxops.systems.common import InputError

# Share of the thrust limit that slowing down along the path asked for may take. The rest is left
# to gravity and Coriolis.
_BRAKING_SHARE = 0.5
# Share of an error of velocity that one control period takes away.
_CORRECTION = 0.5


class ProportionalDerivative(LeafSystem):
    """Proportional in position and derivative in velocity, on the true state.

    ```
    state (6) ──►┌────────────────────────┐
    target (6) ─►│ ProportionalDerivative ├─► force (3), N
                 └────────────────────────┘
    ```

    All vectors are in K, in m, m/s and N. With the errors e = goal - position, per axis::

        force = clip(m k (clip(λ e, ±v) + goal velocity - velocity), ±F)
        λ = F / (2 m v)   k = 1 / (2 T)

    m is the mass, F the thrust limit, v the speed limit, T the control period. That is a PD law of
    gains m k λ and m k whose proportional part asks for no more than the speed limit. Along
    velocity = λ e braking takes at most half of the thrust limit. The law knows neither gravity
    nor the body: it hovers beside the goal, as far off as the proportional part needs to hold the
    weight, and flies straight through what lies in its way. Where the state is not finite, for
    instance an estimate that there is none of, it commands no force.
    """

    def __init__(self, mass: float, thrust_limit: float, speed_limit: float, period: float = 10.0):
        """Takes the mass in kg, the limits per axis in N and m/s and the control period in s.

        Raises:
          InputError: one of them is not positive.
        """
        super().__init__()
        if not min(mass, thrust_limit, speed_limit, period) > 0.0:
            raise InputError(
                "a PD controller needs a positive mass, thrust limit, speed limit and period, "
                f"got {mass}, {thrust_limit}, {speed_limit} and {period}"
            )
        self.thrust_limit, self.speed_limit = thrust_limit, speed_limit
        self.rate = _BRAKING_SHARE * thrust_limit / (mass * speed_limit)
        """λ in 1/s."""
        self.gain = mass * _CORRECTION / period
        """Of velocity, m k, in kg/s."""
        self._state_port = self.DeclareVectorInputPort(name="state", size=6)
        self._target_port = self.DeclareVectorInputPort(name="target", size=6)
        self._force_port = self.DeclareVectorOutputPort(
            name="force",
            size=3,
            calc=self._calc_force,
            prerequisites_of_calc={self._state_port.ticket(), self._target_port.ticket()},
        )

    def _calc_force(self, context, output):
        error = self._target_port.Eval(context) - self._state_port.Eval(context)
        if not np.isfinite(error).all():
            output.SetFromVector(np.zeros(3))
            return
        approach = np.clip(self.rate * error[:3], -self.speed_limit, self.speed_limit)
        wanted = self.gain * (approach + error[3:])
        output.SetFromVector(np.clip(wanted, -self.thrust_limit, self.thrust_limit))
