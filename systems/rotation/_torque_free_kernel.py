"""Compiled kernels: a rigid body that turns without torque, by elliptic functions.

`TorqueFreeSpin` names the equations. scipy has the elliptic functions, too; called from Python one
by one they took most of the time of a flight at a body that tumbles.
"""

import math
from typing import NamedTuple

import numpy as np

from proxops.systems.common import kernel, quaternion_inverse, quaternion_product, rotated

_inverse, _product, _rotated = (
    kernel(each) for each in (quaternion_inverse, quaternion_product, rotated)
)

_MOST_MEANS = 16
# Carlson's series of the fifth degree is exact to rounding where its arguments differ by less.
_NEAR = (0.25e-16) ** (1.0 / 6.0)


class Motion(NamedTuple):
    """A torque-free rotation in principal axes, by Jacobi's elliptic functions of time."""

    axes: np.ndarray
    """R_KP (4,) as a quaternion, of the principal axes P. The third is the one that L stays
    about."""
    moments: np.ndarray
    """(3,) of inertia."""
    amplitudes: np.ndarray
    """(3,) of w along the axes of P in rad/s, which are times cn, sn and dn."""
    momentum: float
    """|L|."""
    frequency: float
    """In rad/s."""
    start: float
    """The argument of the elliptic functions is start + frequency t."""
    parameter: float
    """m."""


@kernel(error_model="numpy")
def amplitude(u, m):
    """Jacobi's am u in rad, for a parameter 0 <= m < 1.

    By the arithmetic-geometric mean: DLMF, section 22.20(ii).
    """
    shares = np.empty(_MOST_MEANS)
    a, b, count = 1.0, math.sqrt(1.0 - m), 0
    c = math.sqrt(m)
    while abs(c) > 1e-16 * a and count < _MOST_MEANS:
        a, b, c = 0.5 * (a + b), math.sqrt(a * b), 0.5 * (a - b)
        shares[count] = c / a
        count += 1
    angle = 2.0**count * a * u
    for k in range(count - 1, -1, -1):
        angle = 0.5 * (angle + math.asin(shares[k] * math.sin(angle)))
    return angle


@kernel(error_model="numpy")
def rates(motion, time):
    """w (3 numbers) in rad/s along each axis of P, and am u in rad, at a time in s."""
    m = motion.parameter
    angle = amplitude(motion.start + motion.frequency * time, m)
    sn, cn = math.sin(angle), math.cos(angle)
    first, second, third = motion.amplitudes
    return first * cn, second * sn, third * math.sqrt(1.0 - m + m * cn * cn), angle


@kernel(error_model="numpy")
def rates_at(motion, times):
    """w (N, 3) in rad/s along the axes of P, at times (N,) in s."""
    found = np.empty((times.size, 3))
    for k in range(times.size):
        found[k, 0], found[k, 1], found[k, 2], _ = rates(motion, times[k])
    return found


@kernel(error_model="numpy")
def turned_at(motion, time):
    """R_JK as a quaternion, w in rad/s and its derivative in rad/s^2 in K, at a time in s.

    z of J lies along L, and axis 1 has gone round it by phi since time 0.
    """
    x, y, z, angle = rates(motion, time)
    a, b, c = motion.moments
    axes = (motion.axes[0], motion.axes[1], motion.axes[2], motion.axes[3])
    change = (b - c) / a * y * z, (c - a) / b * z * x, (a - b) / c * x * y
    p, q, r = a * x, b * y, c * z
    # About axis 1 until L is in the plane of 1 and 3, then about 2 until it lies along 3.
    lean, tip = 0.5 * math.atan2(q, r), -0.5 * math.atan2(p, math.sqrt(q * q + r * r))
    turn = 0.5 * _precession(motion, time, angle)
    attitude = _product(
        (math.cos(tip), 0.0, math.sin(tip), 0.0), (math.cos(lean), math.sin(lean), 0.0, 0.0)
    )
    attitude = _product((math.cos(turn), 0.0, 0.0, math.sin(turn)), attitude)
    attitude = _product(attitude, _inverse(axes))
    return attitude, _rotated(axes, (x, y, z)), _rotated(axes, change)


@kernel(error_model="numpy")
def attitudes_at(motion, start, times):
    """R_NK (N, 4) as quaternions at times (N,) in s, with R_NJ given as 4 numbers."""
    found = np.empty((times.size, 4))
    for k in range(times.size):
        turned, _, _ = turned_at(motion, times[k])
        found[k, 0], found[k, 1], found[k, 2], found[k, 3] = _product(start, turned)
    return found


@kernel(error_model="numpy")
def _precession(motion, time, angle):
    """The integral phi of phi' = L (1 / I3 + e sn^2 / (1 + d sn^2)) since time 0, in rad."""
    _, b, c = motion.moments
    m, second, third = motion.parameter, motion.amplitudes[1] ** 2, motion.amplitudes[2] ** 2
    d = b * b * second / (c * c * third) - m
    e = b * second * (c - b) / (c**3 * third)
    integral = third_kind(angle, m, d) - third_kind(amplitude(motion.start, m), m, d)
    return motion.momentum * (time / c + e * integral / motion.frequency)


@kernel(error_model="numpy")
def third_kind(angle, m, d):
    """The integral of sn^2 / (1 + d sn^2) over u, from 0 to where am u is `angle` in rad.

    By Carlson's R_J (DLMF, equation 19.25.14), and as many whole half rounds as are in it.
    """
    halves = round(angle / math.pi)
    sine = math.sin(angle - math.pi * halves)
    square = sine * sine
    part = sine**3 * carlson_rj(1.0 - square, 1.0 - m * square, 1.0, 1.0 + d * square)
    if halves != 0.0:
        part += 2.0 * halves * carlson_rj(0.0, 1.0 - m, 1.0, 1.0 + d)
    return part / 3.0


@kernel(error_model="numpy")
def carlson_rj(x, y, z, p):
    """Carlson's R_J (x, y, z, p), p > 0, by duplication: Carlson, Numer. Algorithms 10, 1995."""
    begun = mean = (x + y + z + 2.0 * p) / 5.0
    far = max(abs(mean - x), abs(mean - y), abs(mean - z), abs(mean - p)) / _NEAR
    delta = (p - x) * (p - y) * (p - z)
    first, second, third = x, y, z
    power, total = 1.0, 0.0
    while power * far > mean:
        f, g, h, k = math.sqrt(x), math.sqrt(y), math.sqrt(z), math.sqrt(p)
        product = (k + f) * (k + g) * (k + h)
        total += power / product * _carlson_rc(power**3 * delta / product**2)
        shift = f * g + f * h + g * h
        x, y, z = 0.25 * (x + shift), 0.25 * (y + shift), 0.25 * (z + shift)
        p, mean, power = 0.25 * (p + shift), 0.25 * (mean + shift), 0.25 * power
    x, y, z = (
        (begun - first) * power / mean,
        (begun - second) * power / mean,
        (begun - third) * power / mean,
    )
    p = -0.5 * (x + y + z)
    e2 = x * y + x * z + y * z - 3.0 * p * p
    e3 = x * y * z + 2.0 * e2 * p + 4.0 * p**3
    e4 = (2.0 * x * y * z + e2 * p + 3.0 * p**3) * p
    e5 = x * y * z * p * p
    series = 1.0 - 3.0 * e2 / 14.0 + e3 / 6.0 + 9.0 * e2**2 / 88.0 - 3.0 * e4 / 22.0
    series += 3.0 * e5 / 26.0 - 9.0 * e2 * e3 / 52.0
    return power * series / (mean * math.sqrt(mean)) + 6.0 * total


@kernel(error_model="numpy", forceinline=True)
def _carlson_rc(e):
    """Carlson's R_C (1, 1 + e), e > -1."""
    root = math.sqrt(abs(e))
    if root == 0.0:
        return 1.0
    return math.atan(root) / root if e > 0.0 else math.atanh(root) / root
