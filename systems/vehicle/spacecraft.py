"""`Spacecraft`: a thrusting point mass in the frame of a uniformly spinning body."""

from __future__ import annotations

import numpy as np
from pydrake.systems.framework import BasicVector_, LeafSystem_
from pydrake.systems.scalar_conversion import TemplateSystem

from proxops.systems.common import LARGEST, InputError, check_positive


def rotating_frame_acceleration(position, velocity, gravity, force, mass: float, spin: float):
    """The acceleration in K: r'' = g(r) - 2 w x r' - w x (w x r) + F / m, with w = spin z.

    Args:
      position, velocity, gravity, force: (3,) in K, in m, m/s, m/s^2 and N.
      mass: kg. spin: rad/s about z.

    Returns:
      (3,) in m/s^2, in K, for any scalar type.
    """
    coriolis = np.array([2.0 * spin * velocity[1], -2.0 * spin * velocity[0], 0.0])
    centrifugal = np.array([spin**2 * position[0], spin**2 * position[1], 0.0])
    return gravity + coriolis + centrifugal + force / mass


def jacobi_integral(
    positions: np.ndarray, velocities: np.ndarray, potentials: np.ndarray, spin: float
) -> np.ndarray:
    """Jacobi integrals (N,) in m^2/s^2: v^2/2 - w^2 (x^2 + y^2)/2 - U, constant in free motion.

    Args:
      positions, velocities: (N, 3) in K. potentials: (N,), positive. spin: rad/s about z.
    """
    kinetic = 0.5 * np.sum(velocities**2, axis=1)
    return kinetic - 0.5 * spin**2 * np.sum(positions[:, :2] ** 2, axis=1) - potentials


@TemplateSystem.define("Spacecraft_")
def Spacecraft_(T):  # noqa: N802 (Drake's own naming of templates)
    """`Spacecraft` for the scalar type T, float or AutoDiffXd."""

    class Impl(LeafSystem_[T]):
        """A point mass whose attitude is held to the body-fixed rotating frame K.

        ```
                       ┌────────────┐
        force ────────►│            ├─► state (6), m and m/s: p_KS, v_KS
          (3), N, K    │ Spacecraft ├─► position (3), m: p_KS
        gravity ──────►│            ├─► velocity (3), m/s: v_KS, as seen in K
          (3), m/s^2   └────────────┘
        ```

        The motion is that of `rotating_frame_acceleration`. The mass is constant. The state is
        continuous, so no output depends directly on an input.
        """

        def _construct(self, mass: float, spin: float, initial_state=None, *, converter=None):
            """Takes the mass in kg, the body's spin about z in rad/s and the default initial state.

            `initial_state` (6) is in m and m/s in K; None: at rest at the origin.

            Raises:
              InputError: the mass is not positive or the spin is not finite.
            """
            super().__init__(converter=converter)
            check_positive("Spacecraft", mass=mass)
            if not abs(spin) < LARGEST:
                raise InputError(f"the spin must be finite, got {spin} rad/s")
            self.mass, self.spin = float(mass), float(spin)
            self.initial_state = np.zeros(6) if initial_state is None else np.array(initial_state)
            self._force_port = self.DeclareVectorInputPort(name="force", size=3)
            self._gravity_port = self.DeclareVectorInputPort(name="gravity", size=3)
            state = self.DeclareContinuousState(
                model_vector=BasicVector_[T](self.initial_state), num_q=3, num_v=3, num_z=0
            )
            self._state_port = self.DeclareStateOutputPort(name="state", state_index=state)
            depends = {self.xc_ticket()}
            self._position_port = self.DeclareVectorOutputPort(
                name="position", size=3, calc=self._calc_position, prerequisites_of_calc=depends
            )
            self._velocity_port = self.DeclareVectorOutputPort(
                name="velocity", size=3, calc=self._calc_velocity, prerequisites_of_calc=depends
            )

        def _construct_copy(self, other, converter=None):
            Impl._construct(self, other.mass, other.spin, other.initial_state, converter=converter)

        def DoCalcTimeDerivatives(self, context, derivatives):  # noqa: N802
            state = context.get_continuous_state_vector().CopyToVector()
            acceleration = rotating_frame_acceleration(
                state[:3],
                state[3:],
                self._gravity_port.Eval(context),
                self._force_port.Eval(context),
                self.mass,
                self.spin,
            )
            derivatives.get_mutable_vector().SetFromVector(
                np.concatenate([state[3:], acceleration])
            )

        def _calc_position(self, context, output):
            output.SetFromVector(context.get_continuous_state_vector().CopyToVector()[:3])

        def _calc_velocity(self, context, output):
            output.SetFromVector(context.get_continuous_state_vector().CopyToVector()[3:])

    return Impl


Spacecraft = Spacecraft_[None]
