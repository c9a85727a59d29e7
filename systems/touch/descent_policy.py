"""`DescentPolicy`: the force of a descent by a law that a network corrects, without a program.

Of all motions to a leg's end in the time T, the one of the least effort under an acceleration that
changes linearly from a_0 here to a_1 there begins with::

    u = 6 (p_1 - p - T v) / T^2 - 2 (v_1 - v) / T - a_0

(Guo, Hawkins, Wie, Waypoint-optimized zero-effort-miss/zero-effort-velocity feedback guidance,
JGCD 36, 2013, with the integrals of a linear acceleration; a_1 cancels.) The network adds what the
law leaves out: corridor, limits of speed and thrust, gravity along the way, and that a force is
held for a tenth of the plan. All that it is told and gives is over the speed of contact and T, in
axes of the site, so that it serves any place, body and spacecraft.
"""

from __future__ import annotations

import numpy as np

from proxops.systems.common import State, Values, Vector3
from proxops.systems.policy import DescentNetwork
from proxops.systems.touch.descent import DescentGuidance, TouchPhase


class DescentPolicy:
    """The force of a descent from time and state alone, as `DescentGuidance` gives it."""

    def __init__(self, guidance: DescentGuidance, network: DescentNetwork):
        """Takes the guidance, which knows place, body and spacecraft, and the network."""
        self.guidance, self.network = guidance, network

    def force(self, elapsed: float, state: State, begun: float = 0.0) -> Vector3:
        """The force (3,) in N in K: see `DescentGuidance.force`."""
        guidance, leg = self.guidance, self.guidance.leg(elapsed, state)
        if leg is TouchPhase.TERMINAL:
            return guidance.force(elapsed, state, begun)
        target, duration = guidance.aim(leg, elapsed)
        given, law = descent_inputs(guidance, state, target, duration, begun + elapsed)
        wanted = law + self.network.correction(given.astype(np.float32))
        unit = guidance.mass * guidance.descent.speed_m_s / duration
        return np.clip(unit * wanted @ guidance.axes, -guidance.thrust, guidance.thrust)


def descent_inputs(
    guidance: DescentGuidance, state: State, target: State, duration: float, time: float
) -> tuple[Values, Vector3]:
    """What a network is told of a leg, and the law's acceleration.

    Accelerations are over the speed of contact by the duration, in axes of the site.

    Args:
      state, target: (6,) in m and m/s in K. duration: in s, to the target. time: of the state in s.

    Returns:
      (22,): way, velocity, natural acceleration here and at the target, the body's turn, height,
      four of the corridor, the limit of speed and that of thrust; and the law (3,).
    """
    descent, axes = guidance.descent, guidance.axes
    speed, spin = descent.speed_m_s, guidance.spin.angular_velocity(time)
    length = speed * duration

    here, there = (
        guidance.natural_acceleration(at, time) * duration / speed for at in (state, target)
    )
    way, velocity, faster = (
        (target[:3] - state[:3]) / length, state[3:] / speed, (target - state)[3:] / speed
    )  # fmt: skip
    law = axes @ (6.0 * (way - velocity) - 2.0 * faster - here)
    height, steep = guidance.height(state), np.tan(np.radians(descent.cone_deg))
    edge = steep * max(height, 0.0) + descent.room_m
    aside = np.linalg.norm(axes[:2] @ (state[:3] - guidance.site.position))
    fastest = 1.3 * speed + max(height, 0.0) / descent.slowing_s
    numbers = [
        height / length, aside / edge, steep, descent.room_m / length,
        duration / descent.slowing_s, -float(axes[2] @ state[3:]) / fastest,
        np.log(guidance.thrust / guidance.mass * duration / speed),
    ]  # fmt: skip
    vectors = [axes @ way, axes @ velocity, axes @ here, axes @ there, axes @ spin * duration]
    return np.concatenate([*vectors, numbers]), law
