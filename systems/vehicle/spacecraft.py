"""`Spacecraft`: a thrusting point mass in the frame of a spinning body."""

from __future__ import annotations

import sys
import typing
from collections.abc import Sequence

import numpy as np
from pydrake.autodiffutils import AutoDiffXd
from pydrake.systems.framework import BasicVector_, LeafSystem, LeafSystem_
from pydrake.systems.scalar_conversion import TemplateSystem

from proxops.systems.common import (
    LARGEST,
    InputError,
    check_positive,
    check_type,
    config,
    finite_vector,
    make_for_floats,
    number,
)

# Below this share of the first mass, all propellant must have been used up long ago.
_LEAST_MASS = 1e-3


@config
class PointMassConfig:
    """The spacecraft: a point mass with one thruster pair per axis.

    It holds its axes S to those of the body-fixed frame K; `truth` says how they are turned.
    """

    mass_kg: float = number(100.0, at_least=1e-3, at_most=1e7, unit="kg")
    # Greatest force per axis, in both directions.
    thrust_limit_n: float = number(7.0, at_least=1e-6, at_most=1e7, unit="N")
    # Greatest speed per axis in the body-fixed frame. The MPC respects it; the plant does not
    # enforce it.
    speed_limit_m_s: float = number(40.0, at_least=1e-6, at_most=1e5, unit="m/s")


def rotating_frame_acceleration(position, velocity, gravity, force, mass: float, spin: float):
    """The acceleration in K: r'' = g(r) - 2 w x r' - w x (w x r) + F / m, with w = spin z.

    Args:
      position, velocity, gravity, force: (3,) in K, in m, m/s, m/s^2 and N.
      mass: kg. spin: rad/s about z.

    Returns:
      (3,) in m/s^2, in K, for any scalar type.
    """
    # Number by number: seven times a step in flight, where small arrays cost more than sums.
    turn, square = 2.0 * spin, spin**2
    return np.array(
        [
            gravity[0] + turn * velocity[1] + square * position[0] + force[0] / mass,
            gravity[1] - turn * velocity[0] + square * position[1] + force[1] / mass,
            gravity[2] + force[2] / mass,
        ]
    )


def spinning_frame_acceleration(
    position, velocity, gravity, force, mass, spin, axis_point, spin_rate=(0.0, 0.0, 0.0)
):
    """The acceleration in K: r'' = g(r) - 2 w x r' - w x (w x d) - w' x d + F / m, with d = r - c.

    It is that of `rotating_frame_acceleration` if the axis is z.

    Args:
      position, velocity, gravity, force: (3,) in K, in m, m/s, m/s^2 and N.
      mass: kg.
      spin: w (3,) in rad/s.
      axis_point: c (3,) in m: a point of the spin axis.
      spin_rate: w' (3,) in rad/s^2.

    Returns:
      (3,) in m/s^2, in K, for any scalar type.
    """
    # Number by number: see `rotating_frame_acceleration`.
    (p, q, r), (i, j, k), (u, v, w) = spin, spin_rate, velocity
    x, y, z = position[0] - axis_point[0], position[1] - axis_point[1], position[2] - axis_point[2]
    a, b, c = 2.0 * u + q * z - r * y, 2.0 * v + r * x - p * z, 2.0 * w + p * y - q * x
    return np.array(
        [
            gravity[0] - (j * z - k * y) - (q * c - r * b) + force[0] / mass,
            gravity[1] - (k * x - i * z) - (r * a - p * c) + force[1] / mass,
            gravity[2] - (i * y - j * x) - (p * b - q * a) + force[2] / mass,
        ]
    )


def _set_constants(craft, mass: float, spin, axis_point) -> None:
    """Sets mass, spin and axis of a `Spacecraft`; raises `InputError` if they make no sense."""
    check_positive("Spacecraft", mass=mass)
    craft.mass = float(mass)
    craft.axis_point = finite_vector("Spacecraft", "axis_point", axis_point)
    craft.about_z = False
    if spin is None:
        craft.spin = craft.rate = None
        return
    if np.ndim(spin) > 0:
        craft.spin = craft.rate = finite_vector("Spacecraft", "spin", spin)
        return
    check_type("Spacecraft", float, spin=spin)
    if not abs(spin) < LARGEST:
        raise InputError(f"the spin must be finite, got {spin} rad/s")
    craft.spin, craft.about_z = float(spin), not any(craft.axis_point)
    craft.rate = (0.0, 0.0, craft.spin)


def _initial_state(value) -> np.ndarray:
    """The initial state (6,) of a `Spacecraft`; raises `InputError` if it makes no sense."""
    state = np.zeros(6) if value is None else np.array(value, dtype=np.float64)
    if state.shape != (6,) or not (np.abs(state) < LARGEST).all():
        raise InputError(
            "Spacecraft needs an initial_state of six finite numbers, position in m and velocity "
            f"in m/s, got {value}"
        )
    return state


def _declare_state(craft, basic_vector) -> None:
    """Declares the state of a `Spacecraft` and the outputs, which are parts of it."""
    parts = {"position": slice(0, 3), "velocity": slice(3, 6)}
    start, sizes = craft.initial_state, {"num_q": 3, "num_v": 3, "num_z": 0}
    if craft.burns_propellant:
        start, sizes["num_z"] = np.append(start, craft.mass), 1
        parts = {"state": slice(0, 6), **parts, "mass": slice(6, 7)}
    state = craft.DeclareContinuousState(model_vector=basic_vector(start), **sizes)
    if not craft.burns_propellant:
        craft.DeclareStateOutputPort("state", state)
    for name, part in parts.items():

        def calc(context, output, part=part):
            output.SetFromVector(context.get_continuous_state_vector().CopyToVector()[part])

        craft.DeclareVectorOutputPort(name, part.stop - part.start, calc, {craft.xc_ticket()})


def _acceleration(craft, state, gravity, force, turning):
    """The acceleration (3,) of a `Spacecraft` in m/s^2, in K, for any scalar type.

    `turning` are the values of the ports of the spin, if it has them.
    """
    position, velocity = state[:3], state[3:6]
    mass = mass_left(craft.mass, state[6]) if craft.burns_propellant else craft.mass
    if craft.about_z:
        return rotating_frame_acceleration(position, velocity, gravity, force, mass, craft.spin)
    spin = turning or (craft.rate,)
    return spinning_frame_acceleration(
        position, velocity, gravity, force, mass, spin[0], craft.axis_point, *spin[1:]
    )


def mass_left(first: float, mass):
    """`mass` in kg, of any scalar type; raises `InputError` if next to nothing is left."""
    if not mass >= _LEAST_MASS * first:
        raise InputError(
            f"the propellant is used up: of {first:g} kg, less than {_LEAST_MASS * first:g} kg are "
            "left; raise the specific impulse or the mass, or fly for a shorter time"
        )
    return mass


# Without the scope Drake searches the stack for this module, which slows each import.
@TemplateSystem.define("Spacecraft_", T_list=[float, AutoDiffXd], scope=sys.modules[__name__])
def Spacecraft_(T):  # noqa: N802 (Drake's own naming of templates)
    """`Spacecraft` for the scalar type T, float or AutoDiffXd."""

    class Impl(LeafSystem_[T]):
        """A point mass in the body-fixed rotating frame K.

        ```
                         ┌────────────┐
        force ──────────►│            ├─► state (6), m and m/s: p_KS, v_KS
          (3), N, K      │            ├─► position (3), m: p_KS
        gravity ────────►│ Spacecraft ├─► velocity (3), m/s: v_KS, as seen in K
          (3), m/s^2     │            │
        mass_flow ──────►│            ├─► mass (1), kg
          (1), kg/s      │            │   (both only if it burns propellant)
        spin ───────────►│            │
          (3), rad/s, K  │            │   (both only if `spin` is None)
        spin_rate ──────►│            │
          (3), rad/s^2   └────────────┘
        ```

        The motion is that of `rotating_frame_acceleration` if the spin is a number and the axis
        goes through the origin, otherwise that of `spinning_frame_acceleration`. The mass is
        constant, unless the spacecraft burns propellant: then m' = -mass_flow. The state is
        continuous, so no output depends directly on an input.

        Args:
          mass: kg; the mass at the start if it burns propellant.
          spin: of the body, rad/s in K: a number about z, or a vector (3,); None: it is told by
            ports, as of a `BodyRotation`.
          initial_state: (6,) in m and m/s in K; None: at rest at the origin.
          axis_point: (3,) in m in K: a point of the spin axis.
          burns_propellant: whether the mass is a state, with the ports `mass_flow` and `mass`.
        """

        def _construct(
            self,
            mass: float,
            spin: float | Sequence[float] | np.ndarray | None,
            initial_state=None,
            *,
            axis_point: Sequence[float] | np.ndarray = (0.0, 0.0, 0.0),
            burns_propellant: bool = False,
            converter=None,
        ):
            super().__init__(converter=converter)
            self.initial_state = _initial_state(initial_state)
            _set_constants(self, mass, spin, axis_point)
            self.burns_propellant = burns_propellant
            self._force_port = self.DeclareVectorInputPort("force", 3)
            self._gravity_port = self.DeclareVectorInputPort("gravity", 3)
            if burns_propellant:
                self._flow_port = self.DeclareVectorInputPort("mass_flow", 1)
            names = ("spin", "spin_rate") if spin is None else ()
            self._spin_ports = [self.DeclareVectorInputPort(name, 3) for name in names]
            _declare_state(self, BasicVector_[T])

        def _construct_copy(self, other, converter=None):
            Impl._construct(
                self,
                other.mass,
                other.spin,
                other.initial_state,
                axis_point=other.axis_point,
                burns_propellant=other.burns_propellant,
                converter=converter,
            )

        def DoCalcTimeDerivatives(self, context, derivatives):  # noqa: N802
            state = context.get_continuous_state_vector().CopyToVector()
            force, gravity = self._force_port.Eval(context), self._gravity_port.Eval(context)
            turning, rates = [port.Eval(context) for port in self._spin_ports], state.copy()
            if T is float:  # Python's numbers are faster than numpy's.
                given = (state, force, gravity, *turning)
                state, force, gravity, *turning = (each.tolist() for each in given)
            rates[:3], rates[3:6] = state[3:6], _acceleration(self, state, gravity, force, turning)
            if self.burns_propellant:
                rates[6:] = -self._flow_port.Eval(context)
            derivatives.get_mutable_vector().SetFromVector(rates)

    return Impl


if typing.TYPE_CHECKING:  # Editors don't see into templates.

    class Spacecraft(LeafSystem):
        """A point mass in the body-fixed rotating frame K: see `Spacecraft_`."""

        mass: float
        spin: float | np.ndarray | None
        initial_state: np.ndarray
        axis_point: np.ndarray
        burns_propellant: bool

        def __init__(
            self,
            mass: float,
            spin: float | Sequence[float] | np.ndarray | None,
            initial_state: Sequence[float] | np.ndarray | None = None,
            *,
            axis_point: Sequence[float] | np.ndarray = (0.0, 0.0, 0.0),
            burns_propellant: bool = False,
        ): ...

else:
    Spacecraft = make_for_floats(Spacecraft_)
