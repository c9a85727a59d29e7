"""`AttitudeGuidance`: the attitude that a spacecraft should have."""

from __future__ import annotations

import math

import numpy as np
from pydrake.systems.framework import LeafSystem

from proxops.systems.common import (
    LONG,
    Values,
    Vector,
    Vector3,
    config,
    number,
    one_of,
    quaternion_inverse,
    quaternion_of,
    quaternion_product,
    rotated,
    vector,
)
from proxops.systems.rotation import Spin, spin_model

# A force in N below this has no direction worth a turn.
_LEAST_FORCE = 0.1


@config
class AttitudeGuidanceConfig:
    """Where the spacecraft points."""

    # hold: S keeps to the axes of K. body: the boresight points at `place_m`. thrust: it points
    # along the commanded force.
    mode: str = one_of("hold", ("hold", "body", "thrust"))
    # A law of one's own instead, MODULE:FACTORY, called as a controller's. Its System has the
    # output ports of `AttitudeGuidance`, and any of its input ports.
    law: str = ""
    # A place in K: the body's centre, or one on its surface.
    place_m: list[float] = vector([0.0] * 3, at_least=-1e7, at_most=1e7, unit="m")
    # A direction of S.
    boresight: list[float] = vector([0.0, 0.0, 1.0], at_least=-1.0, at_most=1.0)
    # Greatest rate of a slew, and the time in which it is reached.
    slew_deg_s: float = number(0.2, at_least=1e-4, at_most=90.0, unit="degrees/s")
    slew_time_s: float = number(20.0, at_least=0.1, at_most=LONG, unit="s")


def next_turn(way: Vector3, before: Vector3, period: float, rate: float, rise: float) -> Vector3:
    """The rotation vector (3,) in rad of the next period of a slew.

    The rate grows to its limit within the rise time, and falls so that the slew ends at rest.

    Args:
      way: (3,) in rad, what remains to be turned. before: (3,) in rad/s, the rate now.
      period: s. rate: limit in rad/s. rise: s.
    """
    angle = math.hypot(*way.tolist())
    acceleration = rate / rise
    # Braking evenly from here, in steps of a period.
    half = 0.5 * acceleration * period
    braking = math.sqrt(half * half + 2.0 * acceleration * angle) - half
    wanted = way * (min(rate, braking, angle / period) / angle) if angle > 0.0 else way
    change = wanted - before
    size = math.hypot(*change.tolist())
    if size > acceleration * period:
        change = change * (acceleration * period / size)
    return period * (before + change)


class AttitudeGuidance(LeafSystem):
    """The reference attitude, at attitude steps.

    ```
    position (3), m, K; NaN ──►┌──────────────────┐─► reference (4), R_NS as wanted
    body_attitude (4), R_KS ──►│                  │
    force (3), N, K ──────────►│ AttitudeGuidance │
    lost (3), S ──────────────►│                  │
                               └──────────────────┘─► reference_rate (3), rad/s, S as wanted
    ```

    K turns as believed. `hold`: S keeps to K's axes; else the boresight goes the
    shortest way to what it points at and follows it, with limits on rate and acceleration, and S
    does not turn about it more than it must. It begins with the attitude that it has. The position
    is as it is known; where it is not (NaN), or where the force is below 0.1 N, S stays as it is in
    K. `lost` is a direction in which thrusters can push no more, 0 if there is none: from then on
    the opposite one follows the commanded force. Only the ports of the mode need be connected. The
    reference against K and its rate there are discrete state.
    """

    def __init__(self, settings: AttitudeGuidanceConfig, spin: Spin, period: float):
        """Takes where to point, the spin as believed, and the period in s.

        A spin that is a number is in rad/s about z.
        """
        super().__init__()
        self.settings, self.spin, self.period = settings, spin_model(spin), period
        axis = np.array(settings.boresight)
        x, y, z = (axis / np.linalg.norm(axis)).tolist()
        self._boresight = x, y, z
        self._place = np.array(settings.place_m)
        self._limits = math.radians(settings.slew_deg_s), settings.slew_time_s
        self._position_port = self.DeclareVectorInputPort("position", 3)
        self._attitude_port = self.DeclareVectorInputPort("body_attitude", 4)
        self._force_port = self.DeclareVectorInputPort("force", 3)
        self._lost_port = self.DeclareVectorInputPort("lost", 3)
        # R_KS as wanted, 0 before the first step, and the rate at which that changes, in K.
        first = [1.0 if settings.mode == "hold" else 0.0, *np.zeros(6)]
        self._state = self.DeclareDiscreteState(np.array(first))
        depends = {self.xd_ticket(), self.time_ticket(), self._attitude_port.ticket()}
        self.DeclareVectorOutputPort("reference", 4, self._calc_reference, depends)
        self.DeclareVectorOutputPort("reference_rate", 3, self._calc_rate, depends)
        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._turn)

    def _wanted(self, context) -> tuple[Values, Vector3]:
        state = context.get_discrete_state(self._state).value()
        begun = bool(state.any())
        return state[:4] if begun else self._attitude_port.Eval(context), state[4:]

    def _calc_reference(self, context, output):
        a, b, c, d = self._wanted(context)[0].tolist()
        body = self.spin.attitude(context.get_time())
        output.SetFromVector(quaternion_product(body, (a, b, c, d)))

    def _calc_rate(self, context, output):
        attitude, rate = self._wanted(context)
        a, b, c, d = attitude.tolist()
        x, y, z = rate.tolist()
        p, q, r = self.spin.angular_velocity(context.get_time()).tolist()
        whole = (x + p, y + q, z + r)
        output.SetFromVector(rotated(quaternion_inverse((a, b, c, d)), whole))

    def _aim(self, context) -> tuple[Vector, Vector3]:
        """A direction in S, and the vector (3,) in K along which it should lie; 0: none."""
        mode, lost, force = self.settings.mode, np.zeros(3), np.zeros(3)
        if self._lost_port.HasValue(context):
            lost = self._lost_port.Eval(context)
        if mode == "thrust" or lost.any():
            force = self._force_port.Eval(context)
            if math.hypot(*force.tolist()) < _LEAST_FORCE:
                force = np.zeros(3)
        if lost.any():
            x, y, z = (-lost).tolist()
            return (x, y, z), force
        if mode == "body":
            return self._boresight, self._place - self._position_port.Eval(context)
        return self._boresight, force

    def _turn(self, context, discrete_state):
        attitude, rate = self._wanted(context)
        axis, wanted = self._aim(context)
        a, b, c, d = attitude.tolist()
        way, size = np.zeros(3), math.hypot(*wanted.tolist())
        if 0.0 < size < math.inf:
            way = shortest_turn(np.array(rotated((a, b, c, d), axis)), wanted / size)
        elif not rate.any() and self.settings.mode == "hold":
            return
        x, y, z = (turn := next_turn(way, rate, self.period, *self._limits)).tolist()
        after = quaternion_product(quaternion_of((x, y, z)), (a, b, c, d))
        discrete_state.set_value(self._state, np.concatenate([after, turn / self.period]))


def shortest_turn(before: Vector3, after: Vector3) -> Vector3:
    """The rotation vector (3,) that turns one unit vector (3,) into another."""
    across = np.cross(before, after)
    sine, cosine = float(np.linalg.norm(across)), float(before @ after)
    if sine < 1e-12:
        if cosine > 0.0:
            return np.zeros(3)
        across = np.cross(before, np.eye(3)[np.argmin(np.abs(before))])  # Any way round.
        return across * (math.pi / np.linalg.norm(across))
    return across * (math.atan2(sine, cosine) / sine)
