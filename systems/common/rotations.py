"""Rotations as unit quaternions (w, x, y, z) and as matrices, and the matrix of a cross product.

Quaternions are tuples of plain floats: a product takes under a microsecond, as long as numpy takes
to make an array.
"""

from __future__ import annotations

import math

import numpy as np

from proxops.systems.common.array_types import Matrix3
from proxops.systems.common.checks import Vector
from proxops.systems.common.errors import InputError
from proxops.systems.common.kernels import kernel

Quaternion = tuple[float, float, float, float]
"""(w, x, y, z). R_KS turns the coordinates of a vector in S into those in K."""


def quaternion_of(vector: Vector) -> Quaternion:
    """The rotation about the direction of a rotation vector by its length in rad."""
    x, y, z = vector
    angle = math.hypot(x, y, z)
    if angle == 0.0:
        return 1.0, 0.0, 0.0, 0.0
    part = math.sin(0.5 * angle) / angle
    return math.cos(0.5 * angle), part * x, part * y, part * z


def quaternion_product(first: Quaternion, second: Quaternion) -> Quaternion:
    """The rotation R_first R_second: `second` acts on a vector before `first` does."""
    a, b, c, d = first
    w, x, y, z = second
    return (
        a * w - b * x - c * y - d * z,
        a * x + b * w + c * z - d * y,
        a * y - b * z + c * w + d * x,
        a * z + b * y - c * x + d * w,
    )


def quaternion_inverse(rotation: Quaternion) -> Quaternion:
    """The rotation back."""
    w, x, y, z = rotation
    return w, -x, -y, -z


def rotated(rotation: Quaternion, vector: Vector) -> Vector:
    """The vector R v. With the identity it is `vector` to the last bit.

    With u the vector part of the quaternion, R v = v + w t + u x t, where t = 2 u x v.
    """
    w, x, y, z = rotation
    a, b, c = vector
    p, q, r = 2.0 * (y * c - z * b), 2.0 * (z * a - x * c), 2.0 * (x * b - y * a)
    return (a + w * p + (y * r - z * q), b + w * q + (z * p - x * r), c + w * r + (x * q - y * p))


def rotation_matrix(quaternion: Quaternion | np.ndarray) -> Matrix3:
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


@kernel(error_model="numpy", forceinline=True)
def turned_vector(matrix, x, y, z):
    """The product (3 numbers) of a matrix (3, 3) and the vector x, y, z, in compiled functions."""
    return (
        matrix[0, 0] * x + matrix[0, 1] * y + matrix[0, 2] * z,
        matrix[1, 0] * x + matrix[1, 1] * y + matrix[1, 2] * z,
        matrix[2, 0] * x + matrix[2, 1] * y + matrix[2, 2] * z,
    )


@kernel(error_model="numpy", forceinline=True)
def cross_matrix(vector):
    """The matrix (3, 3) W of a vector w (3,), for which W v is w x v."""
    x, y, z = vector[0], vector[1], vector[2]
    out = np.zeros((3, 3))
    out[0, 1], out[0, 2], out[1, 2] = -z, y, -x
    out[1, 0], out[2, 0], out[2, 1] = z, -y, x
    return out


@kernel(error_model="numpy", forceinline=True)
def inverse_matrix(matrix):
    """The inverse of a matrix (3, 3), by its cofactors, in compiled functions."""
    out = np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            a, b, c, d = (j + 1) % 3, (j + 2) % 3, (i + 1) % 3, (i + 2) % 3
            out[i, j] = matrix[a, c] * matrix[b, d] - matrix[a, d] * matrix[b, c]
    determinant = matrix[0, 0] * out[0, 0] + matrix[0, 1] * out[1, 0] + matrix[0, 2] * out[2, 0]
    return out / determinant
