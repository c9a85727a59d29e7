"""Condensing: writes the states along a plan as affine functions of its controls.

On interval k gravity is linearised about its middle and the control u_k is constant: eq. 9 of
docs/method/equations.md. This motion is affine. Over one interval it is exactly
x_{k+1} = E_k x_k + B_k u_k + d_k, by the series of the matrix exponential. Substituted into one
another from the given x_0 on, these steps eliminate the states: eq. 10.

A program over the controls alone is small and dense. With the states as variables it would be large
and sparse.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from proxops.systems.common import State, States, Values, Vector3, Vectors3, kernel
from proxops.systems.gravity import Field
from proxops.systems.rotation import SpinModel

# Terms of the exponential's series for one interval, after 1. With 16 intervals |A| dt is at most
# about 0.5 at Kleopatra, and the next term 1e-8; with a few intervals it grows, and with it the
# error of the plan, not that of the flight.
_EXPONENTIAL_TERMS = 8


class Reference(NamedTuple):
    """What the motion is linearised about."""

    states: States
    """(N + 1, 6) at the knots, in K, in m and m/s."""
    controls: Vectors3
    """(N, 3) between them."""
    lengths: Values
    """(N,) of the intervals, in s."""


class _Turning(NamedTuple):
    """The body's angular velocity w and its derivative in the intervals, along the axes of K."""

    rates: Vectors3
    """(N, 3) in rad/s."""
    accelerations: Vectors3
    """(N, 3) in rad/s^2."""


def condensed_motion(
    field: Field,
    spin: SpinModel,
    start: State,
    reference: Reference,
    acceleration: float,
    disturbance: Vector3,
    time: float,
) -> np.ndarray:
    """Coefficients (N, 6, 3 N + 2) of the states at the ends of N intervals in (u, stretch, 1).

    The stretch is a relative change of all lengths. Its effect is of first order about the given
    states and controls.

    Args:
      field: the assumed gravity.
      spin: of the body. It is taken as in the middle of each interval.
      start: (6,), the first state, in m and m/s, in K.
      reference: to linearise about.
      acceleration: by a control of 1 along an axis, in m/s^2.
      disturbance: (3,) in m/s^2, an acceleration that the field does not explain.
      time: of the first state in s.
    """
    states, lengths = reference.states, reference.lengths
    middle = 0.5 * (states[1:, :3] + states[:-1, :3])
    gravity = field.evaluate(middle)
    constant = _constant(gravity.acceleration, gravity.gradient, middle, disturbance)
    times = time + np.cumsum(lengths) - 0.5 * lengths
    turning = _Turning(
        np.array(spin.angular_velocity(times)), np.array(spin.angular_acceleration(times))
    )
    return _affine_states(gravity.gradient, constant, turning, acceleration, start, reference)


@kernel(error_model="numpy")
def _constant(acceleration, gradient, middle, disturbance):
    """c (N, 3) of the intervals."""
    constant = np.empty(middle.shape)
    for k in range(middle.shape[0]):
        for i in range(3):
            constant[k, i] = acceleration[k, i] + disturbance[i]
            for j in range(3):
                constant[k, i] -= gradient[k, i, j] * middle[k, j]
    return constant


# Explicit loops compile in a fraction of the time that array expressions take.
@kernel(error_model="numpy", forceinline=True)
def _add_product(left, right, share, out):
    """Adds share times left[:, :6] (6, 6) times right (6, M) to out (6, M)."""
    for i in range(6):
        for j in range(6):
            factor = share * left[i, j]
            if factor != 0.0:
                for m in range(right.shape[1]):
                    out[i, m] += factor * right[j, m]


@kernel(error_model="numpy")
def _affine_states(gradient, constant, turning, acceleration, start, reference):
    """The coefficients of `condensed_motion`, from G (N, 3, 3) and c (N, 3): eq. 10."""
    states, controls, lengths = reference
    n = lengths.size
    rows = np.zeros((n, 6, 3 * n + 2))
    before = np.zeros((6, 3 * n + 2))
    # d/dt x = rates @ (x, u, 1); (E - 1, B, d) = step; (x, u, 1) at an interval's end.
    rates, flown = np.zeros((6, 10)), np.ones(10)
    for i in range(6):
        before[i, 3 * n + 1] = start[i]
    for i in range(3):
        rates[i, 3 + i] = 1.0
        rates[3 + i, 6 + i] = acceleration
    for k in range(n):
        length, now = lengths[k], rows[k]
        w, e = turning.rates[k], turning.accelerations[k]
        for i in range(3):
            for j in range(3):
                rates[3 + i, j] = gradient[k, i, j]
            rates[3 + i, 9] = constant[k, i]
        for i in range(3):  # -2 [w]x, and -[w]x [w]x - [w']x.
            j, m = (i + 1) % 3, (i + 2) % 3
            rates[3 + i, 3 + j], rates[3 + i, 3 + m] = 2.0 * w[m], -2.0 * w[j]
            rates[3 + i, i] += w[j] ** 2 + w[m] ** 2
            rates[3 + i, j] += e[m] - w[i] * w[j]
            rates[3 + i, m] -= e[j] + w[i] * w[m]
        # The upper rows of exp(A) - 1 for A = ((rates), (0)) times the length, by Horner's rule:
        # A (1 + A / 2 (1 + A / 3 (1 + ...))), inside out.
        step = np.zeros((6, 10))
        for order in range(_EXPONENTIAL_TERMS, 0, -1):
            longer = np.empty((6, 10))
            for i in range(6):
                for j in range(10):
                    longer[i, j] = length / order * rates[i, j]
            _add_product(rates, step, length / order, longer)
            step = longer

        for i in range(6):
            for m in range(3 * n + 2):
                now[i, m] = before[i, m]
        _add_product(step, before, 1.0, now)
        for i in range(6):
            for j in range(3):
                now[i, 3 * k + j] += step[i, 6 + j]
            now[i, 3 * n + 1] += step[i, 9]
        # The column of the stretch: the rates at the interval's end, times its length.
        for j in range(3):
            flown[6 + j] = controls[k, j]
        for i in range(6):
            flown[i] = states[k, i] + step[i, 9]
            for j in range(6):
                flown[i] += step[i, j] * states[k, j]
            for j in range(3):
                flown[i] += step[i, 6 + j] * controls[k, j]
        for i in range(6):
            for j in range(10):
                now[i, 3 * n] += length * rates[i, j] * flown[j]
        before = now
    return rows
