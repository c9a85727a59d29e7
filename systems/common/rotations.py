"""Rotations as unit quaternions and as matrices."""

from __future__ import annotations

import math

import numpy as np

from proxops.systems.common.errors import InputError


def rotation_matrix(quaternion: np.ndarray) -> np.ndarray:
    """The rotation matrix (3, 3) of a quaternion (w, x, y, z), which is scaled to length 1.

    The identity quaternion gives the identity to the last bit. R = (w² - v²) I + 2 v vᵀ + 2 w [v]×
    with v = (x, y, z): see Diebel, Representing Attitude, 2006, equation 125.

    Raises:
      InputError: the quaternion is not of four numbers, or its length is 0 or not finite.
    """
    parts = np.asarray(quaternion, dtype=np.float64)
    length = math.sqrt(float(parts @ parts)) if parts.shape == (4,) else math.nan
    if not 0.0 < length < math.inf:
        raise InputError(f"an attitude needs a quaternion (w, x, y, z) of length 1, got {parts}")
    w, x, y, z = (parts / length).tolist()
    return np.array(
        [
            [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
            [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
            [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
        ]
    )
