"""Rotations as unit quaternions (w, x, y, z) of plain floats.

A quaternion takes under a microsecond here. An array of numpy takes as long to be made.
"""

from __future__ import annotations

import math

from proxops.systems.vehicle._vectors import Vector

Quaternion = tuple[float, float, float, float]
"""(w, x, y, z). R_KS turns the coordinates of a vector in S into those in K."""

IDENTITY: Quaternion = (1.0, 0.0, 0.0, 0.0)


def from_rotation_vector(vector: Vector) -> Quaternion:
    """The rotation about the direction of `vector` by its length in rad."""
    x, y, z = vector
    angle = math.hypot(x, y, z)
    if angle == 0.0:
        return IDENTITY
    part = math.sin(0.5 * angle) / angle
    return math.cos(0.5 * angle), part * x, part * y, part * z


def product(first: Quaternion, second: Quaternion) -> Quaternion:
    """The rotation R_first R_second: `second` acts on a vector before `first` does."""
    a, b, c, d = first
    w, x, y, z = second
    return (
        a * w - b * x - c * y - d * z,
        a * x + b * w + c * z - d * y,
        a * y - b * z + c * w + d * x,
        a * z + b * y - c * x + d * w,
    )


def inverse(rotation: Quaternion) -> Quaternion:
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
