"""`ReactionWheels`: how wheels and thrusters share a torque, and how wheels are unloaded."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from pydrake.systems.framework import LeafSystem

from proxops.systems.common import Values, Vector3, Vectors3, kernel

# Wheels are unloaded from this share of their limit on, at this rate in 1/s.
_LOADED, _UNLOADING = 0.1, 0.05
# They stop taking momentum at this share of the limit.
_FULL = 0.95


@dataclass(frozen=True)
class WheelArray:
    """Reaction wheels of one kind."""

    axes: Vectors3
    """(n, 3) unit vectors in S; they span it."""
    torque: float
    """Greatest torque of each in N m."""
    momentum: float
    """Greatest momentum of each in N m s."""
    inertia: float
    """Of each about its axis in kg m^2."""

    @cached_property
    def shares(self) -> Vectors3:
        """(n, 3): the motor torques of least squares for a unit torque on the wheels."""
        return np.ascontiguousarray(np.linalg.pinv(self.axes.T))


def wheel_torques(torque: Vector3, momentum: Values, wheels: WheelArray) -> Values:
    """Motor torques (n,) in N m that give a torque (3,) in N m to the bus, as far as they can.

    The least squares of the torques. A wheel that is full takes no more momentum.

    Args:
      torque: on the bus, in S. momentum: (n,) of the wheels in N m s. wheels: their limits.
    """
    return _motors(torque, momentum, wheels.shares, (wheels.torque, wheels.momentum))


@kernel(error_model="numpy")
def _motors(torque, momentum, shares, limits):
    most, largest = limits
    motors = np.empty(len(momentum))
    for k in range(len(momentum)):
        asked = -(shares[k, 0] * torque[0] + shares[k, 1] * torque[1] + shares[k, 2] * torque[2])
        asked = min(max(asked, -most), most)
        full = abs(momentum[k]) > _FULL * largest and asked * momentum[k] > 0.0
        motors[k] = 0.0 if full else asked
    return motors


def torque_for_thrusters(torque: Vector3, momentum: Values, wheels: WheelArray) -> Vector3:
    """What thrusters should add (3,) in N m in S: what wheels cannot give, and unloads them.

    Args:
      torque: on the bus, in S. momentum: (n,) in N m s. wheels: their limits.
    """
    given = -wheel_torques(torque, momentum, wheels) @ wheels.axes
    limit = _LOADED * wheels.momentum
    excess = momentum - np.minimum(np.maximum(momentum, -limit), limit)
    return torque - given - _UNLOADING * excess @ wheels.axes


class ReactionWheels(LeafSystem):
    """Shares the torque on the bus between wheels and thrusters.

    ```
    torque (3), N m, S ────────►┌────────────────┐─► wheel_torque (n), N m, of the motors
    wheel_momentum (n), N m s ─►│ ReactionWheels │
    given_torque (3), N m, S ──►└────────────────┘─► thruster_torque (3), N m, S
    ```

    `thruster_torque` is what thrusters should give; `given_torque` what they will give, as far as
    is known. The wheels give the rest. The outputs depend on the inputs alone.
    """

    def __init__(self, wheels: WheelArray):
        """Takes the wheels."""
        super().__init__()
        self.wheels = wheels
        n = len(wheels.axes)
        self._torque_port = self.DeclareVectorInputPort("torque", 3)
        self._momentum_port = self.DeclareVectorInputPort("wheel_momentum", n)
        self._given_port = self.DeclareVectorInputPort("given_torque", 3)
        asked = {self._torque_port.ticket(), self._momentum_port.ticket()}
        self.DeclareVectorOutputPort("thruster_torque", 3, self._calc_thruster_torque, asked)
        self.DeclareVectorOutputPort(
            "wheel_torque", n, self._calc_wheel_torque, {*asked, self._given_port.ticket()}
        )

    def _calc_thruster_torque(self, context, output):
        torque, momentum = self._torque_port.Eval(context), self._momentum_port.Eval(context)
        output.SetFromVector(torque_for_thrusters(torque, momentum, self.wheels))

    def _calc_wheel_torque(self, context, output):
        rest = self._torque_port.Eval(context) - self._given_port.Eval(context)
        momentum = self._momentum_port.Eval(context)
        output.SetFromVector(wheel_torques(rest, momentum, self.wheels))


class WheelFriction(LeafSystem):
    """The torque on wheels: that of their motors less friction, and none beyond full speed.

    ```
    wheel_torque (n), N m ─────►┌───────────────┐
    wheel_momentum (n), N m s ─►│ WheelFriction ├─► wheel_torque (n), N m
                                └───────────────┘
    ```
    """

    def __init__(self, wheels: WheelArray, friction: float):
        """Takes the wheels and their friction in 1/s: torque over momentum."""
        super().__init__()
        self.limit, self.friction = wheels.momentum, friction
        n = len(wheels.axes)
        self._torque_port = self.DeclareVectorInputPort("wheel_torque", n)
        self._momentum_port = self.DeclareVectorInputPort("wheel_momentum", n)
        self.DeclareVectorOutputPort("wheel_torque", n, self._calc, {self.all_input_ports_ticket()})

    def _calc(self, context, output):
        limit, friction = self.limit, self.friction
        torques = self._torque_port.Eval(context).tolist()
        momenta = self._momentum_port.Eval(context).tolist()
        # Numbers of Python: it is asked thrice a step, and numpy takes longer for four.
        output.SetFromVector(
            [
                (0.0 if abs(h) >= limit and u * h > 0.0 else u) - friction * h
                for u, h in zip(torques, momenta, strict=True)
            ]
        )
