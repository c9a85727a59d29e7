"""`AttitudeControl`: the torque that holds a spacecraft to a reference attitude."""

from __future__ import annotations

import math

import numpy as np
from pydrake.systems.framework import LeafSystem

from proxops.systems.common import (
    Matrix3,
    Values,
    Vector3,
    cross_matrix,
    quaternion_inverse,
    quaternion_product,
)

# Of the closed loop: the natural frequency in rad/s, and the damping ratio.
_FREQUENCY, _DAMPING = 0.15, 0.9


def attitude_error(attitude: Values, reference: Values) -> Vector3:
    """The rotation vector (3,) in S, for small angles, from the reference to the attitude.

    Args: unit quaternions (4,) of S and of its reference, against the same axes.
    """
    a, b, c, d = reference.tolist()
    p, q, r, s = attitude.tolist()
    w, x, y, z = quaternion_product(quaternion_inverse((a, b, c, d)), (p, q, r, s))
    # The shorter way round.
    return np.array([x, y, z]) * (2.0 if w >= 0.0 else -2.0)


def control_torque(
    error: Vector3, rate_error: Vector3, inertia: Matrix3, frequency: float, damping: float
) -> Vector3:
    """The torque (3,) in N m of a quaternion feedback whose gains follow from the inertia.

    Wie, Space Vehicle Dynamics and Control, 2nd ed., 7.3.1: -J (w0^2 e + 2 z w0 dw).

    Args:
      error: `attitude_error`. rate_error: (3,) in rad/s in S. inertia: (3, 3) in kg m^2.
      frequency: w0 in rad/s. damping: z.
    """
    return -inertia @ (frequency**2 * error + 2.0 * damping * frequency * rate_error)


class AttitudeControl(LeafSystem):
    """The torque on the bus that holds S to a reference.

    ```
    attitude (4), R_NS ──────────────►┌─────────────────┐
    angular_velocity (3), rad/s, S ──►│                 │
    reference (4), R_NS as wanted ───►│ AttitudeControl ├─► torque (3), N m, S
    reference_rate (3), rad/s, S ────►│                 │
    wheel_momentum (n), N m s ───────►│                 │
    disturbance (3), N m, S ─────────►└─────────────────┘
    ```

    `control_torque`, and w x (J w + h), less the disturbance that is estimated. `wheel_momentum`
    and `disturbance` may remain open. The output depends on the inputs alone.
    """

    def __init__(self, inertia: Matrix3, wheel_axes: np.ndarray | None = None):
        """Takes the inertia as believed (3, 3) in kg m^2, and the wheels' axes (n, 3).

        Args:
          inertia: of all of it, about its centre of mass.
          wheel_axes: unit vectors; None: no wheels.
        """
        super().__init__()
        self.inertia = inertia
        self.wheel_axes = np.zeros((0, 3)) if wheel_axes is None else wheel_axes
        declare = self.DeclareVectorInputPort
        self._attitude_port = declare("attitude", 4)
        self._rate_port = declare("angular_velocity", 3)
        self._reference_port = declare("reference", 4)
        self._reference_rate_port = declare("reference_rate", 3)
        self._disturbance_port = declare("disturbance", 3)
        if len(self.wheel_axes):
            self._momentum_port = declare("wheel_momentum", len(self.wheel_axes))
        self.DeclareVectorOutputPort("torque", 3, self._calc, {self.all_input_ports_ticket()})

    def _calc(self, context, output):
        error = attitude_error(
            self._attitude_port.Eval(context), self._reference_port.Eval(context)
        )
        rate = self._rate_port.Eval(context)
        wanted = self._reference_rate_port.Eval(context)
        # The reference rate is along the reference's axes; S is turned against them by the error.
        rate_error = rate - (wanted - cross_matrix(error) @ wanted)
        torque = control_torque(error, rate_error, self.inertia, _FREQUENCY, _DAMPING)
        momentum = self.inertia @ rate
        if len(self.wheel_axes):
            momentum = momentum + self._momentum_port.Eval(context) @ self.wheel_axes
        torque = torque + cross_matrix(rate) @ momentum
        if self._disturbance_port.HasValue(context):
            torque = torque - self._disturbance_port.Eval(context)
        output.SetFromVector(torque)


def pointing_error(attitude: Values, reference: Values) -> float:
    """The angle in rad between an attitude and its reference, unit quaternions (4,)."""
    half_sine = 0.5 * float(np.linalg.norm(attitude_error(attitude, reference)))
    return 2.0 * math.asin(min(1.0, half_sine))
