"""Bounds of a state's errors, from what is known of them and from its covariance."""

from __future__ import annotations

import math

import numpy as np


def error_bounds(
    covariance: np.ndarray, deviations: float, position: float, velocity: float
) -> tuple[float, float]:
    """Bounds of the errors of position and velocity, in m and m/s, in any direction.

    Args:
      covariance: (81,) of position in m, velocity in m/s and attitude, row by row.
      deviations: number of standard deviations along the longest axis.
      position, velocity: what is added to them, in m and m/s.

    Returns:
      Two bounds; NaN where the covariance is not finite.
    """
    square = covariance.reshape(9, 9)
    blocks = np.stack([square[:3, :3], square[3:6, 3:6]])
    if not np.isfinite(blocks).all():
        return np.nan, np.nan
    of_position, of_velocity = np.linalg.eigvalsh(blocks)[:, -1].tolist()
    return (
        position + deviations * math.sqrt(max(of_position, 0.0)),
        velocity + deviations * math.sqrt(max(of_velocity, 0.0)),
    )
