"""The standard deviations of a state along its longest axes, from its covariance."""

from __future__ import annotations

import numpy as np


def longest_deviations(covariance: np.ndarray) -> tuple[float, float]:
    """The greatest standard deviation of position and of velocity in any direction.

    Args:
      covariance: (N, N) of position (3) in m, velocity (3) in m/s, and whatever else.

    Returns:
      In m and m/s; NaN where the covariance is not finite.
    """
    position, velocity = (
        float(np.sqrt(max(np.linalg.eigvalsh(block)[-1], 0.0)))
        if np.isfinite(block).all()
        else np.nan
        for block in (covariance[:3, :3], covariance[3:6, 3:6])
    )
    return position, velocity
