"""`Estimate`: what the navigation believes, and how uncertain it is."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from proxops.systems.common import Matrix3, State, Values, Vector3
from proxops.systems.navigation.expected_errors import ExpectedErrors

# Where each quantity is in the vector of the estimate. Errors of the attitude are rotation vectors
# in K, so the vector holds zeros there and the rotation itself is kept as a matrix.
POSITION, VELOCITY, ATTITUDE = slice(0, 3), slice(3, 6), slice(6, 9)
"""Of the spacecraft in K, in m and m/s; of its axes S against K, in rad."""
CONSTANT_ACCELERATION, VARYING_ACCELERATION = slice(9, 12), slice(12, 15)
"""That nothing explains, in m/s^2 in K."""
GRAVITY = 15
"""True mass of the body over the believed one, less 1."""
SPIN = slice(16, 19)
"""True angular velocity less the believed one, in rad/s in K."""
CENTRE_OF_MASS = slice(19, 22)
"""True centre of mass less the believed one, in m in K; the spin axis goes through it."""
THRUST, THRUST_DIRECTION = slice(22, 25), slice(25, 28)
"""True force along each axis of S over the commanded one, less 1; rotation of these axes, rad."""
PROPELLANT = 28
"""Share of the mass at the start that each m/s of commanded velocity change uses up, in s/m."""
TRACKER = slice(29, 32)
"""Part of the attitude's error that is the star tracker's, which varies, in rad in K."""
# From here on: what a range depends on besides the pose, in the order of the frame kernel.
SIZE = 32
"""True size of the body over that of the map, less 1."""
LIDAR_BIAS, LIDAR_SCALE, HALF_BEAM = 33, 34, 35
"""Of all ranges: a length in m, a share, and half of the angle of the lidar's beams in rad."""
BASE = 36
"""Number of these quantities. After them come the coefficients of the map's error."""
MEASURED = np.array([0, 1, 2, 6, 7, 8, SIZE, LIDAR_BIAS, LIDAR_SCALE, HALF_BEAM])
"""Those that a range depends on, besides the coefficients of the map's error."""


class Estimate(NamedTuple):
    """A mean and a covariance, in the layout above."""

    mean: np.ndarray
    """(BASE + M,)."""
    rotation: Matrix3
    """R_KS (3, 3)."""
    covariance: np.ndarray
    """(BASE + M, BASE + M)."""
    spent: float = 0.0
    """Velocity change commanded so far, in m/s: the sum over the axes of S."""

    @property
    def state(self) -> State:
        """Position and velocity (6,) in K, in m and m/s."""
        return self.mean[:6]


def first_estimate(
    position: Vector3, rotation: Matrix3, sigma: np.ndarray, spent: float = 0.0
) -> Estimate:
    """What is believed before the first frame is used.

    Args:
      position: (3,) in m in K, near which the frame will be linearised.
      rotation: R_KS (3, 3), likewise.
      sigma: (BASE + M,) standard deviations; see `first_sigmas`.
      spent: velocity change commanded so far in m/s.
    """
    mean, covariance = np.zeros(sigma.size), np.diag(sigma**2)
    mean[POSITION] = position
    part = np.diag(sigma[TRACKER] ** 2)
    covariance[ATTITUDE, TRACKER] = covariance[TRACKER, ATTITUDE] = part
    return Estimate(mean, rotation, covariance, spent)


def first_sigmas(
    expected: ExpectedErrors, spin: Vector3, modes: int, position: float, velocity: float
) -> np.ndarray:
    """Standard deviations (BASE + M,) before the first frame is used.

    Args:
      expected: one standard deviation of everything. spin: (3,) as believed at time 0, in rad/s.
      modes: M, number of coefficients of the map's error, each of variance 1.
      position: in m: large, because nothing is known of it. velocity: in m/s, about 0.
    """
    sigma = np.concatenate([sigmas(expected, spin), np.ones(modes)])
    sigma[POSITION], sigma[VELOCITY] = position, velocity
    return sigma


def sigmas(expected: ExpectedErrors, spin: Vector3) -> Values:
    """Standard deviations (BASE,) of an estimate; 0 for position and velocity.

    Args:
      expected: one standard deviation of everything. spin: (3,) as believed at time 0, in rad/s.
    """
    sigma = np.zeros(BASE)
    parts = expected.attitude_deg, expected.attitude_varying_deg, expected.attitude_noise_deg
    pole, rate = math.radians(expected.pole_deg), float(np.linalg.norm(spin))
    along = np.square(spin / rate) if rate else np.array([0.0, 0.0, 1.0])
    for where, value in (
        (ATTITUDE, math.hypot(*map(math.radians, parts))),
        (CONSTANT_ACCELERATION, expected.acceleration_m_s2),
        (VARYING_ACCELERATION, expected.acceleration_varying_m_s2),
        (GRAVITY, expected.gravity),
        (SPIN, rate * np.sqrt(pole**2 * (1.0 - along) + expected.spin**2 * along)),
        (CENTRE_OF_MASS, expected.centre_of_mass_m),
        (THRUST, expected.thrust),
        (THRUST_DIRECTION, math.radians(expected.thrust_direction_deg)),
        (PROPELLANT, expected.propellant_s_per_m),
        (SIZE, expected.size),
        (LIDAR_BIAS, expected.lidar_bias_m),
        (LIDAR_SCALE, expected.lidar_scale),
        (HALF_BEAM, expected.half_beam),
        (TRACKER, math.radians(expected.attitude_noise_deg)),
    ):
        sigma[where] = value
    return sigma
