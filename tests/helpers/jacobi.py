"""The Jacobi integral, which free motion about a spinning body keeps."""

import numpy as np


def jacobi_integral(
    positions: np.ndarray, velocities: np.ndarray, potentials: np.ndarray, spin: float
) -> np.ndarray:
    """Jacobi integrals (N,) in m^2/s^2: v^2/2 - w^2 (x^2 + y^2)/2 - U, constant in free motion.

    Args:
      positions, velocities: (N, 3) in K. potentials: (N,), positive. spin: rad/s about z.
    """
    kinetic = 0.5 * np.sum(velocities**2, axis=1)
    return kinetic - 0.5 * spin**2 * np.sum(positions[:, :2] ** 2, axis=1) - potentials
