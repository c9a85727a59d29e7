"""Compiled kernel: the navigation's estimate, predicted over a short time.

The equations of motion in K, for a position r, the true spin w and the true centre of mass c, are

    r'' = (1 + k) g(r - c) - 2 w x r' - w x (w x (r - c)) + R T u / m + a

with the field g as believed, k the error of gravity, u the commanded force along the axes of S, R
the rotation of S against K, T = (1 + [d]x) diag(1 + s) the errors of thrust, m = m0 (1 - j b) the
mass after b = integral of |u| / m0, and a what nothing explains. Over a step, gravity is linear
about the point in its middle.
"""

import math

import numba
import numpy as np

# The layout of `estimate`, as plain numbers for the compiler.
_V, _A, _CONSTANT, _VARYING, _GRAVITY = 3, 6, 9, 12, 15
_SPIN, _CENTRE, _THRUST, _DIRECTION, _PROPELLANT, _BASE = 16, 19, 22, 25, 28, 33

# What is left of the mass is more than this share, whatever the estimate is.
_LEAST_MASS = 0.1

_compiled = numba.njit(cache=True, error_model="numpy")
_inlined = numba.njit(cache=True, error_model="numpy", forceinline=True)


@_inlined
def _cross(v):
    """The matrix W for which W u is v x u."""
    out = np.zeros((3, 3))
    out[0, 1], out[0, 2], out[1, 2] = -v[2], v[1], -v[0]
    out[1, 0], out[2, 0], out[2, 1] = v[2], -v[1], v[0]
    return out


@_inlined
def _rotation(v):
    """The rotation about the direction of v by its length in rad (Rodrigues)."""
    angle = math.sqrt(v[0] ** 2 + v[1] ** 2 + v[2] ** 2)
    cross = _cross(v)
    if angle < 1e-8:
        return np.eye(3) + cross
    first = math.sin(angle) / angle
    second = (1.0 - math.cos(angle)) / angle**2
    return np.eye(3) + first * cross + second * (cross @ cross)


@_compiled
def turned(rotation, vector):
    """The rotation R (3, 3), turned further by a small rotation vector (3,) in K."""
    out = _rotation(vector) @ rotation
    # Rounding must not add up over a flight: one Gram-Schmidt step.
    x = out[0] / math.sqrt(out[0] @ out[0])
    y = out[1] - (out[1] @ x) * x
    y /= math.sqrt(y @ y)
    out[0], out[1] = x, y
    out[2, 0] = x[1] * y[2] - x[2] * y[1]
    out[2, 1] = x[2] * y[0] - x[0] * y[2]
    out[2, 2] = x[0] * y[1] - x[1] * y[0]
    return out


@_inlined
def _derivative(rotation, axes, push, given, commanded, pull, turn, tide, v, offset):
    """How the acceleration depends on the attitude and on the constants (3, BASE)."""
    by = np.zeros((3, _BASE))
    by[:, _A : _A + 3] = -_cross(push)
    for i in range(3):
        by[i, _CONSTANT + i] = by[i, _VARYING + i] = 1.0
        by[:, _THRUST + i] = axes[:, i] * commanded[i]
    by[:, _GRAVITY] = pull
    inner = turn @ offset
    by[:, _SPIN : _SPIN + 3] = 2.0 * _cross(v) + _cross(inner) + turn @ _cross(offset)
    by[:, _CENTRE : _CENTRE + 3] = -tide
    by[:, _DIRECTION : _DIRECTION + 3] = -(rotation @ _cross(given))
    return by


@_inlined
def _moved_covariance(covariance, f, noise):
    """The covariance after a step with the transition f (BASE, BASE) and its noise.

    Beyond the first nine rows, f is the identity but for the decay of the varying acceleration.
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
    decay = noise[1]
    out = covariance.copy()
    for i in range(_VARYING, _VARYING + 3):
        for j in range(_CONSTANT, n):
            out[i, j] *= decay
            out[j, i] *= decay
    for i in range(_CONSTANT):
        for j in range(_CONSTANT, n):
            share = decay if _VARYING <= j < _VARYING + 3 else 1.0
            out[i, j] = out[j, i] = share * rows[i, j]
        for j in range(i + 1):
            total = 0.0
            for k in range(_BASE):
                total += rows[i, k] * f[j, k]
            out[i, j] = out[j, i] = total
    for i in range(3):
        out[_A + i, _A + i] += noise[0]
        out[_VARYING + i, _VARYING + i] += noise[2]
    return out


@_compiled
def predict(
    mean, rotation, covariance, spent, pull, gradient, force, time, step, spin, mass, noise
):
    """The estimate `step` s later.

    Args:
      mean, rotation, covariance, spent: the estimate; see `estimate`.
      pull, gradient: believed gravity (3,) and its derivative (3, 3) at r + r' step/2 - c.
      force: (3,) in N along the axes of S, held over the step.
      time: s, at the start of the step.
      spin: as believed, rad/s about z. mass: kg.
      noise: (3,): variance that the step adds to the attitude, decay of the varying acceleration
        over the step, and the variance that this gets.

    Returns:
      Mean, rotation and covariance.
    """
    w = mean[_SPIN : _SPIN + 3].copy()
    w[2] += spin
    turn = _cross(w)
    around = turn @ turn
    factor = 1.0 + mean[_GRAVITY]
    tide = factor * gradient - around
    v = mean[_V : _V + 3]
    offset = mean[:3] + 0.5 * step * v - mean[_CENTRE : _CENTRE + 3]

    now = mass * max(1.0 - mean[_PROPELLANT] * spent, _LEAST_MASS)
    given = (1.0 + mean[_THRUST : _THRUST + 3]) * force / now
    direction = np.eye(3) + _cross(mean[_DIRECTION : _DIRECTION + 3])
    axes = rotation @ direction
    push = axes @ given
    total = factor * pull - 2.0 * (turn @ v) - around @ offset + push
    total += mean[_CONSTANT : _CONSTANT + 3] + mean[_VARYING : _VARYING + 3]

    # The deviation from the point in the middle and from v follows d' = A d + (v, total).
    a = np.zeros((6, 6))
    for i in range(3):
        a[i, 3 + i] = 1.0
    a[3:, :3] = tide
    a[3:, 3:] = -2.0 * turn
    a2 = a @ a
    a3 = a2 @ a
    phi = np.eye(6) + step * a + (step**2 / 2.0) * a2 + (step**3 / 6.0) * a3
    gamma = step * np.eye(6) + (step**2 / 2.0) * a + (step**3 / 6.0) * a2 + (step**4 / 24.0) * a3
    start, rate = np.zeros(6), np.zeros(6)
    start[:3] = -0.5 * step * v
    rate[:3], rate[3:] = v, total
    moved = phi @ start + gamma @ rate
    out = mean.copy()
    out[:3] += 0.5 * step * v + moved[:3]
    out[3:6] += moved[3:]
    out[_VARYING : _VARYING + 3] *= noise[1]

    # The believed pole stays where it is in inertial space, so in K it goes round with the spin.
    angle = spin * (time + 0.5 * step)
    back = np.zeros((3, 3))
    back[0, 0], back[0, 1] = math.cos(angle), math.sin(angle)
    back[1, 0], back[1, 1] = -math.sin(angle), math.cos(angle)
    back[2, 2] = 1.0
    drift = -step * (back @ mean[_SPIN : _SPIN + 3])
    out_rotation = turned(rotation, drift)

    by = _derivative(rotation, axes, push, given, force / now, pull, turn, tide, v, offset)
    by[:, _PROPELLANT] = push * (spent * mass / now)
    f = np.eye(_BASE)
    f[:6, :6] = phi
    f[:6, _A:] += (np.ascontiguousarray(gamma[:, 3:]) @ by)[:, _A:]
    f[_A : _A + 3, _SPIN : _SPIN + 3] = -step * back
    for i in range(3):
        f[_VARYING + i, _VARYING + i] = noise[1]
    return out, out_rotation, _moved_covariance(covariance, f, noise)
