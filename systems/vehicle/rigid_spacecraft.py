"""`RigidSpacecraft`: a rigid bus with reaction wheels, in the frame of a spinning body."""

from __future__ import annotations

import sys
import typing
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from pydrake.autodiffutils import AutoDiffXd
from pydrake.systems.framework import BasicVector_, LeafSystem, LeafSystem_
from pydrake.systems.scalar_conversion import TemplateSystem

from proxops.systems.common import (
    Matrix3,
    State,
    Vector3,
    Vectors3,
    check_inertia,
    check_positive,
    finite_vector,
    kernel,
    make_for_floats,
)
from proxops.systems.vehicle.spacecraft import mass_left

_IDENTITY = (1.0, 0.0, 0.0, 0.0)
_NO_MOTORS, _STEADY = np.zeros(0), np.zeros(3)


@dataclass(frozen=True)
class RigidBodyStart:
    """The state of a `RigidSpacecraft` at the start."""

    state: State
    """p_KS and v_KS (6,) in m and m/s in K: of the centre of mass."""
    attitude: tuple[float, ...] = _IDENTITY
    """R_KS: a unit quaternion (w, x, y, z)."""
    angular_velocity: tuple[float, ...] = (0.0, 0.0, 0.0)
    """w_NS (3,) in rad/s, in S."""


class _Constants(NamedTuple):
    """What stays as it is: the body's centre of mass and the spacecraft's mass properties."""

    axis_point: np.ndarray
    """c (3,) in m in K: a point of the spin axis, which is at rest in N."""
    bus: np.ndarray
    """J (3, 3) in kg m^2: the inertia without the wheels' own about their axes."""
    bus_inverse: np.ndarray
    """J^-1."""
    inertia: np.ndarray
    """I (3, 3) in kg m^2: of all of it."""
    wheel_axes: np.ndarray
    """(n, 3) unit vectors in S."""


@kernel(error_model="numpy")
def rigid_rates(state, force, torque, motors, gravity, gradient, spin, spin_rate, constants):
    """The time derivative of the state of a `RigidSpacecraft`, but for the mass.

    With w = w_NS in S, w_K the body's angular velocity, h the momentum of the wheels in S,
    L = J w + h and R = R_KS (Hughes, Spacecraft Attitude Dynamics, 1986, sections 3.3 and 6.1)::

        q'  = 1/2 q (0, w - R^T w_K)
        J w' = torque + t_g - w x L - h'
        r'' = g(r) - 2 w_K x r' - w_K x (w_K x (r - c)) - w_K' x (r - c) + R F / m

    t_g is the torque of the gravity gradient G on the whole inertia I: with A = R^T G R I its
    components are A_yz - A_zy and so on (Hughes, equation 8.1.9, for any field).

    It is plain arithmetic on numbers, so that it also runs uncompiled on Drake's AutoDiffXd.

    Args:
      state: 14 + n numbers: q_KS (w, x, y, z), p_KS (m, K), w_NS (rad/s, S), v_KS (m/s, K), the
        wheels' momenta (N m s), the mass (kg).
      force, torque: (3,) of the thrusters, in N and N m in S. motors: (n,) in N m, of the wheels.
      gravity: (3,) in m/s^2 in K. gradient: (9,) in 1/s^2, row by row.
      spin, spin_rate: (3,) w_K in rad/s and its derivative in rad/s^2, in K.
      constants: `_Constants`.

    Returns:
      14 + n numbers, in the order of `state`; the last is 0.
    """
    axis_point, bus, inverse, inertia, wheel_axes = constants
    wheels = len(wheel_axes)
    qw, qx, qy, qz = state[0], state[1], state[2], state[3]
    x, y, z = state[4] - axis_point[0], state[5] - axis_point[1], state[6] - axis_point[2]
    wx, wy, wz = state[7], state[8], state[9]
    vx, vy, vz = state[10], state[11], state[12]
    mass = state[13 + wheels]
    hx, hy, hz = 0.0 * wx, 0.0 * wx, 0.0 * wx
    nx, ny, nz = torque[0], torque[1], torque[2]
    for k in range(wheels):
        i, j, m = wheel_axes[k, 0], wheel_axes[k, 1], wheel_axes[k, 2]
        hx, hy, hz = hx + i * state[13 + k], hy + j * state[13 + k], hz + m * state[13 + k]
        nx, ny, nz = nx - i * motors[k], ny - j * motors[k], nz - m * motors[k]
    # R_KS, of a quaternion whose length may have drifted by rounding.
    s = 2.0 / (qw * qw + qx * qx + qy * qy + qz * qz)
    r00, r01, r02 = (
        1.0 - s * (qy * qy + qz * qz),
        s * (qx * qy - qw * qz),
        s * (qx * qz + qw * qy),
    )
    r10, r11, r12 = (
        s * (qx * qy + qw * qz),
        1.0 - s * (qx * qx + qz * qz),
        s * (qy * qz - qw * qx),
    )
    r20, r21, r22 = (
        s * (qx * qz - qw * qy),
        s * (qy * qz + qw * qx),
        1.0 - s * (qx * qx + qy * qy),
    )
    a, b, c = spin[0], spin[1], spin[2]
    # Of S against K, in S.
    ux = wx - (r00 * a + r10 * b + r20 * c)
    uy = wy - (r01 * a + r11 * b + r21 * c)
    uz = wz - (r02 * a + r12 * b + r22 * c)
    dq = (
        -0.5 * (qx * ux + qy * uy + qz * uz),
        0.5 * (qw * ux + qy * uz - qz * uy),
        0.5 * (qw * uy + qz * ux - qx * uz),
        0.5 * (qw * uz + qx * uy - qy * ux),
    )
    # The gradient in S times the whole inertia.
    g00, g01, g02 = gradient[0], gradient[1], gradient[2]
    g10, g11, g12 = gradient[3], gradient[4], gradient[5]
    g20, g21, g22 = gradient[6], gradient[7], gradient[8]
    t00, t01, t02 = (
        g00 * r00 + g01 * r10 + g02 * r20,
        g00 * r01 + g01 * r11 + g02 * r21,
        g00 * r02 + g01 * r12 + g02 * r22,
    )
    t10, t11, t12 = (
        g10 * r00 + g11 * r10 + g12 * r20,
        g10 * r01 + g11 * r11 + g12 * r21,
        g10 * r02 + g11 * r12 + g12 * r22,
    )
    t20, t21, t22 = (
        g20 * r00 + g21 * r10 + g22 * r20,
        g20 * r01 + g21 * r11 + g22 * r21,
        g20 * r02 + g21 * r12 + g22 * r22,
    )
    sxx = r00 * t00 + r10 * t10 + r20 * t20
    sxy = r00 * t01 + r10 * t11 + r20 * t21
    sxz = r00 * t02 + r10 * t12 + r20 * t22
    syy = r01 * t01 + r11 * t11 + r21 * t21
    syz = r01 * t02 + r11 * t12 + r21 * t22
    szz = r02 * t02 + r12 * t12 + r22 * t22
    i00, i01, i02 = inertia[0, 0], inertia[0, 1], inertia[0, 2]
    i11, i12, i22 = inertia[1, 1], inertia[1, 2], inertia[2, 2]
    gx = (sxy * i02 + syy * i12 + syz * i22) - (sxz * i01 + syz * i11 + szz * i12)
    gy = (sxz * i00 + syz * i01 + szz * i02) - (sxx * i02 + sxy * i12 + sxz * i22)
    gz = (sxx * i01 + sxy * i11 + sxz * i12) - (sxy * i00 + syy * i01 + syz * i02)
    # Euler's equation.
    lx = bus[0, 0] * wx + bus[0, 1] * wy + bus[0, 2] * wz + hx
    ly = bus[1, 0] * wx + bus[1, 1] * wy + bus[1, 2] * wz + hy
    lz = bus[2, 0] * wx + bus[2, 1] * wy + bus[2, 2] * wz + hz
    nx = nx + gx - (wy * lz - wz * ly)
    ny = ny + gy - (wz * lx - wx * lz)
    nz = nz + gz - (wx * ly - wy * lx)
    dw = (
        inverse[0, 0] * nx + inverse[0, 1] * ny + inverse[0, 2] * nz,
        inverse[1, 0] * nx + inverse[1, 1] * ny + inverse[1, 2] * nz,
        inverse[2, 0] * nx + inverse[2, 1] * ny + inverse[2, 2] * nz,
    )
    # Motion in K: w x (2 v + w x (r - c)) + w' x (r - c).
    d, e, f = spin_rate[0], spin_rate[1], spin_rate[2]
    px = 2.0 * vx + (b * z - c * y)
    py = 2.0 * vy + (c * x - a * z)
    pz = 2.0 * vz + (a * y - b * x)
    fx, fy, fz = force[0] / mass, force[1] / mass, force[2] / mass
    dv = (
        gravity[0] - (b * pz - c * py) - (e * z - f * y) + (r00 * fx + r01 * fy + r02 * fz),
        gravity[1] - (c * px - a * pz) - (f * x - d * z) + (r10 * fx + r11 * fy + r12 * fz),
        gravity[2] - (a * py - b * px) - (d * y - e * x) + (r20 * fx + r21 * fy + r22 * fz),
    )
    out = np.empty_like(state)
    out[0], out[1], out[2], out[3] = dq
    out[4], out[5], out[6] = vx, vy, vz
    out[7], out[8], out[9] = dw
    out[10], out[11], out[12] = dv
    for k in range(wheels):
        out[13 + k] = motors[k]
    out[13 + wheels] = 0.0 * mass
    return out


# Without the scope Drake searches the stack for this module, which slows each import.
@TemplateSystem.define("RigidSpacecraft_", T_list=[float, AutoDiffXd], scope=sys.modules[__name__])
def RigidSpacecraft_(T):  # noqa: N802 (Drake's own naming of templates)
    """`RigidSpacecraft` for the scalar type T, float or AutoDiffXd."""

    class Impl(LeafSystem_[T]):
        """A rigid spacecraft with reaction wheels, in the body-fixed rotating frame K.

        ```
        force (3), N, S ─────────────►┌─────────────────┐─► state (6), m and m/s: p_KS, v_KS
        torque (3), N m, S ──────────►│                 │─► position (3), m: p_KS
        gravity (3), m/s^2, K ───────►│                 │─► velocity (3), m/s: v_KS, as seen in K
        gravity_gradient (9), 1/s^2 ─►│ RigidSpacecraft │─► attitude (4): R_KS, w, x, y, z
        mass_flow (1), kg/s ─────────►│                 │─► angular_velocity (3), rad/s: w_NS, S
        wheel_torque (n), N m ───────►│                 │─► wheel_momentum (n), N m s
        spin (3), rad/s, K ──────────►│                 │─► mass (1), kg
        spin_rate (3), rad/s^2, K ───►└─────────────────┘
        ```

        The motion is that of `rigid_rates`. S has its origin in the centre of mass. Force and
        torque are those of thrusters. `wheel_torque` is what the motors give each wheel about its
        axis; the bus gets the opposite. A wheel's momentum is Js (w·a + Omega), with its axis a, so
        that its derivative is the motor's torque. The propellant lies at the centre of mass: the
        mass falls by the flow, centre of mass and inertia stay. The ports of wheels are missing if
        there are none, those of the spin if it is constant.

        The state is continuous: attitude, position, angular velocity, velocity, then momenta and
        mass. The attitude is not projected back to length 1, only where it is put out: RK3 in steps
        of 1 s lets it drift by 2e-9 an hour at 0.2 degrees/s.

        Args:
          mass: kg at the start.
          inertia: (3, 3) in kg m^2 of all of it about its centre of mass, in S.
          spin: (3,) in rad/s: the body's angular velocity, constant in K; None: it has the ports
            `spin` and `spin_rate` for it, as of a `BodyRotation`.
          start: the state at the start; None: at rest at the origin, aligned with K.
          axis_point: (3,) in m in K: a point of the spin axis.
          wheel_axes: (n, 3) unit vectors in S.
          wheel_inertia: kg m^2 of each wheel about its axis, included in `inertia`.
        """

        def _construct(
            self,
            mass: float,
            inertia: Matrix3,
            spin: Vector3 | None,
            start: RigidBodyStart | None = None,
            axis_point: Vector3 | tuple[float, ...] = (0.0, 0.0, 0.0),
            wheel_axes: Vectors3 | None = None,
            wheel_inertia: float = 0.0,
            *,
            converter=None,
        ):
            super().__init__(converter=converter)
            check_positive("RigidSpacecraft", mass=mass)
            self.mass, self.wheel_inertia = float(mass), float(wheel_inertia)
            self.inertia = check_inertia("RigidSpacecraft", inertia)
            self.spin = spin
            if spin is not None:
                self.spin = np.array(finite_vector("RigidSpacecraft", "spin", spin))
            self.axis_point = np.array(finite_vector("RigidSpacecraft", "axis_point", axis_point))
            self.start = start or RigidBodyStart(np.zeros(6))
            self.wheel_axes = np.zeros((0, 3)) if wheel_axes is None else np.array(wheel_axes)
            bus = self.inertia - wheel_inertia * self.wheel_axes.T @ self.wheel_axes
            self.bus_inertia = check_inertia("RigidSpacecraft's bus", bus)
            self._constants = _Constants(
                self.axis_point,
                self.bus_inertia,
                np.linalg.inv(bus),
                self.inertia,
                self.wheel_axes,
            )
            self._declare_ports()

        def _declare_ports(self):
            wheels = len(self.wheel_axes)
            declare = self.DeclareVectorInputPort
            self._push_ports = [declare("force", 3), declare("torque", 3)]
            self._pull_ports = [declare("gravity", 3), declare("gravity_gradient", 9)]
            self._flow_port = declare("mass_flow", 1)
            self._spin_ports = []
            if self.spin is None:
                self._spin_ports = [declare("spin", 3), declare("spin_rate", 3)]
            start, end = self.start, 13 + wheels
            w = np.array(start.angular_velocity)
            momenta = self.wheel_inertia * self.wheel_axes @ w
            state = np.concatenate(
                [start.attitude, start.state[:3], w, start.state[3:], momenta, [self.mass]]
            )
            self.DeclareContinuousState(
                model_vector=BasicVector_[T](state), num_q=7, num_v=6, num_z=wheels + 1
            )
            self._output("state", np.r_[4:7, 10:13])
            self._output("position", np.r_[4:7])
            self._output("velocity", np.r_[10:13])
            self._output("attitude", np.r_[0:4], unit=True)
            self._output("angular_velocity", np.r_[7:10])
            self._output("mass", np.r_[end : end + 1])
            if wheels:
                self._wheel_port = declare("wheel_torque", wheels)
                self._output("wheel_momentum", np.r_[13:end])

        def _output(self, name: str, part: np.ndarray, unit: bool = False):
            def calc(context, output):
                value = context.get_continuous_state_vector().CopyToVector()[part]
                output.SetFromVector(value / np.sqrt(value @ value) if unit else value)

            self.DeclareVectorOutputPort(name, part.size, calc, {self.xc_ticket()})

        def _construct_copy(self, other, converter=None):
            Impl._construct(
                self,
                other.mass,
                other.inertia,
                other.spin,
                other.start,
                other.axis_point,
                other.wheel_axes,
                other.wheel_inertia,
                converter=converter,
            )

        def DoCalcTimeDerivatives(self, context, derivatives):  # noqa: N802
            state = context.get_continuous_state_vector().CopyToVector()
            mass_left(self.mass, state[-1])
            motors = _NO_MOTORS
            if len(self.wheel_axes):
                motors = self._wheel_port.Eval(context)
            function = rigid_rates if T is float else rigid_rates.py_func
            given = [port.Eval(context) for port in self._push_ports]
            pull = [port.Eval(context) for port in self._pull_ports]
            spin = (self.spin, _STEADY)
            if self._spin_ports:
                spin = [port.Eval(context) for port in self._spin_ports]
            rates = function(state, *given, motors, *pull, *spin, self._constants)
            rates[-1] = -self._flow_port.Eval(context)[0]
            derivatives.get_mutable_vector().SetFromVector(rates)

    return Impl


if typing.TYPE_CHECKING:  # Editors don't see into templates.

    class RigidSpacecraft(LeafSystem):
        """A rigid spacecraft with reaction wheels, in K: see `RigidSpacecraft_`."""

        mass: float
        inertia: Matrix3
        bus_inertia: Matrix3
        spin: np.ndarray | None
        start: RigidBodyStart
        axis_point: np.ndarray
        wheel_axes: Vectors3
        wheel_inertia: float

        def __init__(
            self,
            mass: float,
            inertia: Matrix3,
            spin: Vector3 | None,
            start: RigidBodyStart | None = None,
            axis_point: Vector3 | tuple[float, ...] = (0.0, 0.0, 0.0),
            wheel_axes: Vectors3 | None = None,
            wheel_inertia: float = 0.0,
        ): ...

else:
    RigidSpacecraft = make_for_floats(RigidSpacecraft_)
