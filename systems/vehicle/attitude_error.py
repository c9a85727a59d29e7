"""`AttitudeError`: how the spacecraft's axes S are turned against those of the body, K."""

from __future__ import annotations

import math
from typing import NamedTuple

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
from proxops.systems.rotation import Spin, spin_model
from proxops.systems.vehicle.gauss_markov import SlowVector


class SpinKnowledge(NamedTuple):
    """How a body turns, and what the spacecraft believes of that."""

    true: Spin
    believed: Spin
    phase: float = 0.0
    """In rad: what the believed rotation is ahead by at time 0, about the axis that is believed."""

    @property
    def ahead(self) -> Quaternion:
        """The phase as a rotation, about z without a spin."""
        rate = spin_model(self.believed).rate
        size = float(np.linalg.norm(rate))
        return quaternion_of(
            vector_of(self.phase / size * rate if size else (0.0, 0.0, self.phase))
        )


def believed_axes(time: float, spins: SpinKnowledge) -> Quaternion:
    """The rotation from the axes that the spacecraft takes for K's to K, if attitude is perfect.

    The inertial frame N has the axes of K at time 0. The spacecraft believes another rotation than
    the true R_NK, and is ahead by a phase about the axis that it believes. It turns its own axes S
    so that they have the attitude that it believes of K. So

        R_KS = R_NK^T Rot(phase) R_NK,believed

    Args:
      time: s.
      spins: of the body.

    Returns:
      A unit quaternion (w, x, y, z). It is the identity to the last bit where belief and truth are
      one steady spin about z.
    """
    believed, true, phase = spin_model(spins.believed), spin_model(spins.true), spins.phase
    if believed.about_z and true.about_z:
        ahead = float(believed.rate[2]) - float(true.rate[2])
        return quaternion_of((0.0, 0.0, ahead * time + phase))
    if believed.about_z:
        seen = quaternion_of((0.0, 0.0, float(believed.rate[2]) * time + phase))
    else:
        seen = quaternion_product(spins.ahead, believed.attitude(time))
    return quaternion_product(quaternion_inverse(true.attitude(time)), seen)


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

    @property
    def constant(self) -> Vector:
        """The constant rotation vector (3,) in rad."""
        return vector_of(np.radians(self.constant_deg))

    @property
    def varying_std(self) -> float:
        """The standard deviation in rad."""
        return math.radians(self.varying_std_deg)


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
        spins: SpinKnowledge,
        errors: TrueAttitudeConfig | None = None,
        period: float = 10.0,
        seed: int = 0,
    ):
        """Takes the errors of the knowledge of the rotation and of the attitude.

        Args:
          spins: of the body. errors: of star tracker and mounting; None: there are none.
          period: control period in s. seed: the seed of a new Context.
        """
        errors = errors or TrueAttitudeConfig()
        super().__init__(
            errors.constant, errors.varying_std, errors.correlation_time_s, period, seed
        )
        check_finite("AttitudeError", phase=spins.phase)
        self.spins = SpinKnowledge(spin_model(spins.true), spin_model(spins.believed), spins.phase)
        self.DeclareVectorOutputPort("attitude", 4, self._calc_attitude, self.seed_tickets())

    def _calc_attitude(self, context, output):
        axes = believed_axes(context.get_time(), self.spins)
        error = quaternion_of(self.vector_at(context))
        output.SetFromVector(quaternion_product(axes, error))
