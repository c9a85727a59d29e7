"""`ProportionalDerivative`: a simple controller, to compare others with."""

from __future__ import annotations

import numpy as np
from pydrake.systems.framework import LeafSystem

from proxops.systems.common import check_positive

# Share of the thrust limit that braking towards the goal may take. The rest is left for gravity
# and Coriolis.
_BRAKING_SHARE = 0.5
# Share of a velocity error that one control period removes.
_CORRECTION = 0.5


class ProportionalDerivative(LeafSystem):
    """A PD law: proportional in position and derivative in velocity.

    ```
    state (6) ──►┌────────────────────────┐
    target (6) ─►│ ProportionalDerivative ├─► force (3), N
                 └────────────────────────┘
    ```

    All vectors are in K, in m, m/s and N. With the errors e = goal - position, per axis::

        force = clip(m k (clip(λ e, ±v) + goal velocity - velocity), ±F)
        λ = F / (2 m v)   k = 1 / (2 T)

    m is the mass, F the thrust limit, v the speed limit, T the control period. It is a PD law with
    gains m k λ and m k whose proportional part asks for no more than the speed limit. Where
    velocity = λ e, braking takes at most half of the thrust limit. The law knows neither gravity
    nor the body. It hovers beside the goal, at the distance where the proportional part balances
    the weight, and it flies into whatever is in its way. It commands no force where the state is
    not finite, for instance where there is no estimate.
    """

    def __init__(self, mass: float, thrust_limit: float, speed_limit: float, period: float = 10.0):
        """Takes the mass in kg, the limits per axis in N and m/s and the control period in s."""
        super().__init__()
        check_positive(
            "ProportionalDerivative",
            mass=mass,
            thrust_limit=thrust_limit,
            speed_limit=speed_limit,
            period=period,
        )
        self.thrust_limit, self.speed_limit = thrust_limit, speed_limit
        self.rate = _BRAKING_SHARE * thrust_limit / (mass * speed_limit)
        """λ in 1/s."""
        self.gain = mass * _CORRECTION / period
        """Gain of velocity, m k, in kg/s."""
        self._state_port = self.DeclareVectorInputPort("state", 6)
        self._target_port = self.DeclareVectorInputPort("target", 6)
        self.DeclareVectorOutputPort("force", 3, self._calc_force, {self.all_input_ports_ticket()})

    def _calc_force(self, context, output):
        error = self._target_port.Eval(context) - self._state_port.Eval(context)
        if not np.isfinite(error).all():
            output.SetFromVector(np.zeros(3))
            return
        approach = np.clip(self.rate * error[:3], -self.speed_limit, self.speed_limit)
        wanted = self.gain * (approach + error[3:])
        output.SetFromVector(np.clip(wanted, -self.thrust_limit, self.thrust_limit))
