"""Compiled kernel: the navigation's estimate, predicted over a short time.

The motion is eq. 2 of docs/method/equations.md, which names the symbols. Over a step, gravity is
linear about the point in its middle.

Sums and copies are explicit loops: array expressions and slices on the left take numba ten times as
long to compile. Products of matrices are numpy's; their last bits are those of BLAS.
"""

import math
from typing import NamedTuple

import numpy as np

from proxops.systems.common import cross_matrix, kernel
from proxops.systems.navigation import estimate as layout
from proxops.systems.rotation import SpinErrors

# Where each quantity begins in an estimate.
_V, _A = layout.VELOCITY.start, layout.ATTITUDE.start
_CONSTANT, _VARYING = layout.CONSTANT_ACCELERATION.start, layout.VARYING_ACCELERATION.start
_SPIN, _CENTRE = layout.SPIN.start, layout.CENTRE_OF_MASS.start
_TRACKER = layout.TRACKER.start
_THRUST, _DIRECTION = layout.THRUST.start, layout.THRUST_DIRECTION.start
_GRAVITY, _PROPELLANT, _SIZE, _BASE = (
    layout.GRAVITY,
    layout.PROPELLANT,
    layout.SIZE,
    layout.BASE,
)

# What is left of the mass is more than this share, whatever the estimate is.
_LEAST_MASS = 0.1


class LocalGravity(NamedTuple):
    """Believed gravity at a point, or its mean over a step."""

    acceleration: np.ndarray
    """(3,) in m/s^2 in K."""
    gradient: np.ndarray
    """(3, 3) in 1/s^2."""


class Turning(NamedTuple):
    """How the body turns as believed in the middle of a step, and what errors of that do."""

    rate: np.ndarray
    """w (3,) in rad/s in K."""
    acceleration: np.ndarray
    """Its derivative (3,) in rad/s^2 in K."""
    errors: SpinErrors


class ProcessNoise(NamedTuple):
    """What a step adds to the covariance."""

    attitude: float
    """Variance that the attitude gets, in rad^2."""
    decay: float
    """Factor on the varying acceleration."""
    varying: np.ndarray
    """Variance (3,) that this acceleration gets, in m^2/s^4."""
    kept: float
    """Factor on the star tracker's error."""
    tracker: float
    """Variance that this error gets, and the attitude with it, in rad^2."""


class _Middle(NamedTuple):
    """What acts in the middle of a step; vectors (3,), matrices (3, 3)."""

    rotation: np.ndarray
    """R_KS."""
    axes: np.ndarray
    """R_KS turned by the errors of the thrusters' directions."""
    thrust: np.ndarray
    """Acceleration by thrust, in K in m/s^2."""
    given: np.ndarray
    commanded: np.ndarray
    """Acceleration by thrust along the axes of S, with and without errors, in m/s^2."""
    gravity: np.ndarray
    """As believed, in m/s^2."""
    turn: np.ndarray
    """[w]x of the angular velocity, in rad/s."""
    errors: SpinErrors
    """Of w and its derivative, by the estimated error."""
    tide: np.ndarray
    """Derivative of the acceleration by position, in 1/s^2."""
    v: np.ndarray
    offset: np.ndarray
    """Position from the centre of mass, in m."""


_compiled = kernel(error_model="numpy")


@_compiled
def _times(a, b):
    """The product of matrices (I, K) and (K, J): so small, it takes longer by a library."""
    out = np.zeros((a.shape[0], b.shape[1]))
    for i in range(a.shape[0]):
        for k in range(a.shape[1]):
            for j in range(b.shape[1]):
                out[i, j] += a[i, k] * b[k, j]
    return out


@_compiled
def _along(a, v):
    """The product of a matrix (I, K) and a vector (K,)."""
    out = np.zeros(a.shape[0])
    for i in range(a.shape[0]):
        for k in range(a.shape[1]):
            out[i] += a[i, k] * v[k]
    return out


@_compiled
def _one_plus(matrix):
    """The identity plus a matrix (3, 3)."""
    out = np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            out[i, j] = (1.0 if i == j else 0.0) + matrix[i, j]
    return out


@_compiled
def _rotation(v):
    """The rotation about the direction of v by its length in rad (Rodrigues)."""
    angle = math.sqrt(v[0] ** 2 + v[1] ** 2 + v[2] ** 2)
    cross = cross_matrix(v)
    if angle < 1e-8:
        return _one_plus(cross)
    first = math.sin(angle) / angle
    second = (1.0 - math.cos(angle)) / angle**2
    out = _times(cross, cross)
    for i in range(3):
        for j in range(3):
            out[i, j] = (1.0 if i == j else 0.0) + first * cross[i, j] + second * out[i, j]
    return out


@_compiled
def turned(rotation, vector):
    """The rotation R (3, 3), turned further by a small rotation vector (3,) in K."""
    out = _times(_rotation(vector), rotation)
    # Rounding must not add up over a flight: one Gram-Schmidt step.
    x, y = out[0], out[1]
    size = math.sqrt(x @ x)
    for i in range(3):
        x[i] /= size
    along = y @ x
    for i in range(3):
        y[i] -= along * x[i]
    size = math.sqrt(y @ y)
    for i in range(3):
        y[i] /= size
    out[2, 0] = x[1] * y[2] - x[2] * y[1]
    out[2, 1] = x[2] * y[0] - x[0] * y[2]
    out[2, 2] = x[0] * y[1] - x[1] * y[0]
    return out


@_compiled
def _derivative(middle):
    """How the acceleration depends on the attitude and on the constants (3, BASE): eq. 6."""
    rotation, axes, thrust, given, commanded, gravity, turn, errors, tide, v, offset = middle
    by = np.zeros((3, _BASE))
    turned_thrust, moved, inner = (
        cross_matrix(thrust),
        cross_matrix(v),
        cross_matrix(_along(turn, offset)),
    )
    arm = cross_matrix(offset)
    turned_offset, directed = _times(turn, arm), _times(rotation, cross_matrix(given))
    by_rate = np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            by_rate[i, j] = 2.0 * moved[i, j] + inner[i, j] + turned_offset[i, j]
    spun, swung = _times(by_rate, errors.rate), _times(arm, errors.acceleration)
    for i in range(3):
        by[i, _CONSTANT + i] = by[i, _VARYING + i] = 1.0
        by[i, _GRAVITY] = gravity[i]
        for j in range(3):
            by[i, _A + j] = -turned_thrust[i, j]
            by[i, _THRUST + j] = axes[i, j] * commanded[j]
            by[i, _SPIN + j] = spun[i, j] + swung[i, j]
            by[i, _CENTRE + j] = -tide[i, j]
            by[i, _DIRECTION + j] = -directed[i, j]
    return by


@_compiled
def _by_size(gravity, offset, factor, size):
    """How the acceleration depends on the size of a body of the same mass (3,): eq. 6."""
    out = _along(gravity.gradient, offset)
    for i in range(3):
        out[i] = -factor * (2.0 * gravity.acceleration[i] + out[i]) / (1.0 + size)
    return out


@_compiled
def _moved_covariance(covariance, f, noise):
    """The covariance after a step with its transition and noise: eq. 8.

    Of the transition, f (9, BASE) are the first nine rows. The others are the identity, but for the
    decay of the varying acceleration and of the star tracker's error.
    """
    n = covariance.shape[0]
    rows = np.zeros((_CONSTANT, n))  # The first nine of f P.
    for k in range(_BASE):
        if covariance[k, k] == 0.0:  # What is exact is correlated with nothing.
            continue
        for i in range(_CONSTANT):
            if f[i, k] != 0.0:
                for j in range(n):
                    rows[i, j] += f[i, k] * covariance[k, j]
    out = covariance.copy()
    for i in range(_CONSTANT):
        for j in range(_CONSTANT, n):
            out[i, j] = out[j, i] = rows[i, j]
    for first, decay in ((_VARYING, noise.decay), (_TRACKER, noise.kept)):
        for i in range(first, first + 3):
            for j in range(n):
                out[i, j] *= decay
                out[j, i] *= decay
    for i in range(_CONSTANT):
        for j in range(i + 1):
            total = 0.0
            for k in range(_BASE):
                total += rows[i, k] * f[j, k]
            out[i, j] = out[j, i] = total
    for i in range(3):
        a, t = _A + i, _TRACKER + i
        out[a, a] += noise.attitude + noise.tracker
        out[t, t] += noise.tracker
        out[a, t] = out[t, a] = out[a, t] + noise.tracker
        out[_VARYING + i, _VARYING + i] += noise.varying[i]
    return out


@_compiled
def _transition(tide, turn, step):
    """exp(A t) and its integral (6, 6) for d' = A d + rate, by Taylor's series: eq. 4.

    d is the deviation of position and velocity from the point in the middle and from v.
    """
    a = np.zeros((6, 6))
    for i in range(3):
        a[i, 3 + i] = 1.0
        for j in range(3):
            a[3 + i, j] = tide[i, j]
            a[3 + i, 3 + j] = -2.0 * turn[i, j]
    a2 = _times(a, a)
    a3 = _times(a2, a)
    second, third, fourth = step**2 / 2.0, step**3 / 6.0, step**4 / 24.0
    phi, gamma = np.empty((6, 6)), np.empty((6, 6))
    for i in range(6):
        for j in range(6):
            one = 1.0 if i == j else 0.0
            phi[i, j] = one + step * a[i, j] + second * a2[i, j] + third * a3[i, j]
            gamma[i, j] = step * one + second * a[i, j] + third * a2[i, j] + fourth * a3[i, j]
    return phi, gamma


@_compiled
def predict(estimate, gravity, force, step, noise, turning, mass):
    """The estimate at the end of a step: eq. 3 to 8 of docs/method/equations.md.

    Args:
      estimate: an `Estimate`.
      gravity: `LocalGravity` at r + r' step/2 - c, or its mean over the step.
      force: (3,) in N along the axes of S, held over the step.
      step: in s; the derivative of gravity is constant over it. noise: its `ProcessNoise`.
      turning: in its middle, a `Turning`. mass: kg.

    Returns:
      Mean, rotation and covariance.
    """
    mean, rotation, covariance, spent = estimate
    errors, off = turning.errors, mean[_SPIN : _SPIN + 3]
    w, e = _along(errors.rate, off), _along(errors.acceleration, off)
    for i in range(3):
        w[i] += turning.rate[i]
        e[i] += turning.acceleration[i]
    turn = cross_matrix(w)
    around, swing = _times(turn, turn), cross_matrix(e)
    for i in range(3):
        for j in range(3):
            around[i, j] += swing[i, j]
    factor, v = 1.0 + mean[_GRAVITY], mean[_V : _V + 3]
    tide, offset, commanded, given = np.empty((3, 3)), np.empty(3), np.empty(3), np.empty(3)
    now = mass * max(1.0 - mean[_PROPELLANT] * spent, _LEAST_MASS)
    for i in range(3):
        offset[i] = mean[i] + 0.5 * step * v[i] - mean[_CENTRE + i]
        commanded[i] = force[i] / now
        given[i] = (1.0 + mean[_THRUST + i]) * force[i] / now
        for j in range(3):
            tide[i, j] = factor * gravity.gradient[i, j] - around[i, j]
    axes = _times(rotation, _one_plus(cross_matrix(mean[_DIRECTION : _DIRECTION + 3])))
    thrust, coriolis, centrifugal = _along(axes, given), _along(turn, v), _along(around, offset)
    total, believed = np.empty(3), gravity.acceleration
    for i in range(3):
        total[i] = factor * believed[i] - 2.0 * coriolis[i] - centrifugal[i] + thrust[i]
        total[i] += mean[_CONSTANT + i] + mean[_VARYING + i]
    phi, gamma = _transition(tide, turn, step)
    # From the point in the middle.
    start, rate = np.zeros(6), np.empty(6)
    for i in range(3):
        start[i] = -0.5 * step * v[i]
        rate[i], rate[3 + i] = v[i], total[i]
    by_start, by_rate = _along(phi, start), _along(gamma, rate)
    out = mean.copy()
    for i in range(3):
        out[i] += 0.5 * step * v[i] + (by_start[i] + by_rate[i])
        out[3 + i] += by_start[3 + i] + by_rate[3 + i]
        out[_VARYING + i] *= noise.decay
        out[_TRACKER + i] *= noise.kept

    # S follows K as believed, and K turns otherwise.
    drift = _along(errors.turn, off)
    for i in range(3):
        drift[i] = (noise.kept - 1.0) * mean[_TRACKER + i] - step * drift[i]
    out_rotation = turned(rotation, drift)

    by = _derivative(
        _Middle(rotation, axes, thrust, given, commanded, believed, turn, errors, tide, v, offset)
    )
    by_size = _by_size(gravity, offset, factor, mean[_SIZE])
    for i in range(3):
        by[i, _PROPELLANT] = thrust[i] * (spent * mass / now)
        by[i, _SIZE] = by_size[i]
    by_constants = _times(np.ascontiguousarray(gamma[:, 3:]), by)
    f = np.zeros((_CONSTANT, _BASE))
    for i in range(6):
        for j in range(6):
            f[i, j] = phi[i, j]
        for j in range(_A, _BASE):
            f[i, j] += by_constants[i, j]
    for i in range(3):
        for j in range(3):
            f[_A + i, _SPIN + j] = -step * errors.turn[i, j]
        f[_A + i, _A + i] = 1.0
        f[_A + i, _TRACKER + i] = noise.kept - 1.0
    return out, out_rotation, _moved_covariance(covariance, f, noise)
