"""`AttitudeError`: how the spacecraft's axes S are turned against those of the body, K."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from proxops.systems.common import (
    LONG,
    Quaternion,
    Vector,
    check_finite,
    config,
    number,
    quaternion_inverse,
    quaternion_of,
    quaternion_product,
    vector,
    vector_of,
)
from proxops.systems.rotation import Spin, SpinModel, spin_model
from proxops.systems.vehicle.gauss_markov import SlowVector


def believed_axes(
    time: float,
    *,
    believed_spin: Spin,
    true_spin: Spin,
    phase: float = 0.0,
) -> Quaternion:
    """The rotation from the axes that the spacecraft takes for K's to K, if attitude is perfect.

    The inertial frame N has the axes of K at time 0. The spacecraft believes another rotation than
    the true R_NK, and is ahead by a phase about the axis that it believes. It turns its own axes S
    so that they have the attitude that it believes of K. So

        R_KS = R_NK^T Rot(phase) R_NK,believed

    Args:
      time: s.
      believed_spin, true_spin: of the body; see `spin_model`.
      phase: rad: what the believed rotation phase is ahead by.

    Returns:
      A unit quaternion (w, x, y, z). It is the identity to the last bit where belief and truth are
      one steady spin about z.
    """
    believed, true = spin_model(believed_spin), spin_model(true_spin)
    if believed.about_z and true.about_z:
        ahead = float(believed.rate[2]) - float(true.rate[2])
        return quaternion_of((0.0, 0.0, ahead * time + phase))
    if believed.about_z:
        seen = quaternion_of((0.0, 0.0, float(believed.rate[2]) * time + phase))
    else:
        ahead = quaternion_of(phase_vector(believed, phase))
        seen = quaternion_product(ahead, believed.attitude(time))
    return quaternion_product(quaternion_inverse(true.attitude(time)), seen)


def phase_vector(spin: SpinModel, phase: float) -> Vector:
    """A phase in rad as a rotation vector about the axis at time 0, which is z without a spin."""
    rate = float(np.linalg.norm(spin.rate))
    return vector_of(phase / rate * spin.rate if rate else (0.0, 0.0, phase))


@config
class TrueAttitudeConfig:
    """How the spacecraft's axes S are turned against what it takes for them: the body's axes K.

    This is the error of star tracker and mounting. Errors of spin rate, pole and phase turn S as
    well. Lidar rays and thrust turn with S.
    """

    # Constant rotation vector.
    constant_deg: list[float] = vector([0.0] * 3, at_least=-180.0, at_most=180.0, unit="degrees")
    # Standard deviation, per axis, of a rotation vector that varies (first-order Gauss-Markov), and
    # the time over which its correlation falls to 1/e.
    varying_std_deg: float = number(0.0, at_least=0.0, at_most=90.0, unit="degrees")
    correlation_time_s: float = number(3600.0, at_least=1e-2, at_most=LONG, unit="s")


class AttitudeError(SlowVector):
    """The attitude R_KS of a spacecraft that takes its axes S for those of the body, K.

    ```
    ┌───────────────┐
    │ AttitudeError ├─► attitude (4): R_KS as a unit quaternion (w, x, y, z)
    └───────────────┘
    ```

    R_KS = `believed_axes` · E. The first factor is what the spacecraft does not know of the body's
    rotation. E = Rot(constant + varying) is the error of star tracker and mounting, with a
    Gauss-Markov process for the varying part. The output depends on time and seed alone.
    """

    def __init__(
        self,
        *,
        constant: Sequence[float] | np.ndarray = (0.0, 0.0, 0.0),
        varying_std: float = 0.0,
        correlation_time: float = 3600.0,
        believed_spin: Spin,
        true_spin: Spin,
        phase: float = 0.0,
        period: float = 10.0,
        seed: int = 0,
    ):
        """Takes the errors of the attitude and of the knowledge of the rotation.

        Args:
          constant: (3,) rotation vector in rad in S.
          varying_std: standard deviation per axis in rad of the rotation vector that varies.
          correlation_time: s, of the part that varies.
          believed_spin, true_spin: of the body; see `spin_model`.
          phase: rad: what the believed rotation phase is ahead by.
          period: control period in s.
          seed: the seed of a new Context.
        """
        super().__init__(constant, varying_std, correlation_time, period, seed)
        owner = "AttitudeError"
        check_finite(owner, phase=phase)
        self.believed_spin, self.phase = spin_model(believed_spin), phase
        self.true_spin = spin_model(true_spin)
        self.DeclareVectorOutputPort("attitude", 4, self._calc_attitude, self.seed_tickets())

    def _calc_attitude(self, context, output):
        axes = believed_axes(
            context.get_time(),
            believed_spin=self.believed_spin,
            true_spin=self.true_spin,
            phase=self.phase,
        )
        error = quaternion_of(self.vector_at(context))
        output.SetFromVector(quaternion_product(axes, error))
