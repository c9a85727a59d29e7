"""`ActualThrust`: what thrusters with errors make of a command, in force and in propellant."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from pydrake.systems.framework import LeafSystem

from proxops.systems.common import (
    LONG,
    InputError,
    Vector,
    check_not_negative,
    check_positive,
    config,
    finite_vector,
    number,
    one_of,
    quaternion_of,
    quaternion_product,
    rotated,
    vector,
)

STANDARD_GRAVITY = 9.80665
"""g0 in m/s^2, by which a specific impulse in s is an exhaust velocity."""


@config
class TrueThrustersConfig:
    """How the true thrust differs from the commanded force."""

    # True force along each axis, over the commanded force.
    scale: list[float] = vector([1.0] * 3, at_least=0.0, at_most=1e3)
    # Rotation vector of the thrusters' axes against the spacecraft's axes.
    direction_deg: list[float] = vector([0.0] * 3, at_least=-180.0, at_most=180.0, unit="degrees")
    # A force along one axis whose impulse in a control period is smaller gives nothing.
    least_impulse_n_s: float = number(0.0, at_least=0.0, at_most=1e9, unit="N s")
    # The force along each axis is a multiple of this; 0: any force.
    quantum_n: float = number(0.0, at_least=0.0, at_most=1e7, unit="N")
    # The axis whose thrusters fail, and the time from which they give nothing.
    failed_axis: str = one_of("none", ("none", "x", "y", "z"))
    failure_time_s: float = number(0.0, at_least=0.0, at_most=LONG, unit="s")

    def errors(self) -> ThrusterErrors:
        """Gives the errors in SI units."""
        return ThrusterErrors(
            scale=np.array(self.scale),
            direction=np.radians(self.direction_deg),
            least_impulse=self.least_impulse_n_s,
            quantum=self.quantum_n,
            failed_axis=None if self.failed_axis == "none" else "xyz".index(self.failed_axis),
            failure_time=self.failure_time_s,
        )


@dataclass(frozen=True)
class ThrusterErrors:
    """The errors of the thrusters, in SI units: see `TrueThrustersConfig`. By default none."""

    scale: Sequence[float] | np.ndarray = (1.0, 1.0, 1.0)
    direction: Sequence[float] | np.ndarray = (0.0, 0.0, 0.0)
    """(3,), rad: the rotation vector that turns S into the thrusters' axes."""
    least_impulse: float = 0.0
    quantum: float = 0.0
    failed_axis: int | None = None
    """0, 1 or 2; None: all work."""
    failure_time: float = 0.0

    def __post_init__(self) -> None:
        """Makes tuples of the vectors; raises `InputError` for errors that no thruster has."""
        owner = "ThrusterErrors"
        for name in ("scale", "direction"):
            object.__setattr__(self, name, finite_vector(owner, name, getattr(self, name)))
        x, y, z = self.scale
        check_not_negative(
            owner,
            **{"scale of x": x, "scale of y": y, "scale of z": z},
            least_impulse=self.least_impulse,
            quantum=self.quantum,
            failure_time=self.failure_time,
        )
        if self.failed_axis not in (None, 0, 1, 2):
            raise InputError(f"{owner} needs failed_axis None, 0, 1 or 2, got {self.failed_axis}")


def thrust_given(command: Vector, errors: ThrusterErrors, period: float, time: float) -> Vector:
    """The force (3,) in N that the thrusters give along their own axes.

    Args:
      command: (3,) in N, held over a control period.
      errors: of the thrusters.
      period: control period in s.
      time: s; it matters only if an axis fails.
    """
    a, b, c = (_axis_force(each, errors, period) for each in command)
    if errors.failed_axis is not None and time >= errors.failure_time:
        a, b, c = (0.0 if k == errors.failed_axis else f for k, f in enumerate((a, b, c)))
    x, y, z = errors.scale
    return x * a, y * b, z * c


def _axis_force(command: float, errors: ThrusterErrors, period: float) -> float:
    """The force in N of one axis that works, before its scale."""
    if abs(command) * period < errors.least_impulse:
        return 0.0
    return command if errors.quantum == 0.0 else round(command / errors.quantum) * errors.quantum


def mass_flow(thrust: Vector, specific_impulse: float) -> float:
    """Propellant in kg/s that a thrust (3,) in N takes: sum |F_i| / (Isp g0).

    Args:
      thrust: (3,), along the thrusters' axes: each axis has thrusters of its own.
      specific_impulse: Isp in s.
    """
    x, y, z = thrust
    return (abs(x) + abs(y) + abs(z)) / (specific_impulse * STANDARD_GRAVITY)


class ActualThrust(LeafSystem):
    """The force that thrusters with errors truly give, and the propellant that they use up.

    ```
                    ┌──────────────┐
    force ─────────►│              ├─► force (3), N, K
      (3), N, S     │ ActualThrust ├─► thrust (3), N, along the thrusters' own axes
    attitude ──────►│              │
      (4), optional │              ├─► mass_flow (1), kg/s
                    └──────────────┘
    ```

    `force` in is the held command, within the thrusters' limits; rounding may exceed them by half a
    quantum. `attitude` is R_KS as a unit quaternion (w, x, y, z); without it S has the axes of K.
    The thrust is that of `thrust_given`, and force = R_KS Rot(direction) thrust. The outputs depend
    on the inputs, and on time if an axis fails. The failure is a jump within a step of the
    integrator or at its end, so what it does to the motion may come early or late by up to a step.
    """

    def __init__(
        self, errors: ThrusterErrors, period: float, specific_impulse: float | None = None
    ):
        """Takes the errors, the control period in s, and the specific impulse in s.

        Without a specific impulse, the mass flow is 0.
        """
        super().__init__()
        check_positive("ActualThrust", period=period)
        if specific_impulse is not None:
            check_positive("ActualThrust", specific_impulse=specific_impulse)
        self.errors, self.period, self.specific_impulse = errors, period, specific_impulse
        self._mounting = quaternion_of(finite_vector("", "direction", errors.direction))
        self._command_port = self.DeclareVectorInputPort("force", 3)
        self._attitude_port = self.DeclareVectorInputPort("attitude", 4)
        depends = {self._command_port.ticket()}
        if errors.failed_axis is not None:
            depends.add(self.time_ticket())
        self.DeclareVectorOutputPort(
            "force", 3, self._calc_force, {*depends, self._attitude_port.ticket()}
        )
        self._thrust_port = self.DeclareVectorOutputPort("thrust", 3, self._calc_thrust, depends)
        self.DeclareVectorOutputPort(
            "mass_flow",
            1,
            self._calc_mass_flow,
            {self.nothing_ticket()} if specific_impulse is None else depends,
        )

    def _thrust(self, context) -> Vector:
        x, y, z = self._thrust_port.Eval(context).tolist()
        return x, y, z

    def _calc_thrust(self, context, output):
        x, y, z = self._command_port.Eval(context).tolist()
        output.SetFromVector(thrust_given((x, y, z), self.errors, self.period, context.get_time()))

    def _calc_force(self, context, output):
        rotation = self._mounting
        if self._attitude_port.HasValue(context):
            w, x, y, z = self._attitude_port.Eval(context).tolist()
            rotation = quaternion_product((w, x, y, z), rotation)
        output.SetFromVector(rotated(rotation, self._thrust(context)))

    def _calc_mass_flow(self, context, output):
        impulse = self.specific_impulse
        flow = 0.0 if impulse is None else mass_flow(self._thrust(context), impulse)
        output.SetFromVector([flow])
