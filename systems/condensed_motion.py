"""Condensing: the states along a plan as affine functions of its controls.

On interval k gravity is linearised about its middle, r_k, and the control u_k is constant. In K,
with C the Coriolis and centrifugal terms of the spin::

    d/dt (r, v) = (v, G_k r + C (r, v) + b u_k + c_k)        c_k = g(r_k) - G_k r_k + push

an affine motion, of which one interval is x_{k+1} = E_k x_k + B_k u_k + d_k, exactly, by the
exponential's series. Put into one another from the given x_0 on, the steps leave no state free::

    x_k = sum over j < k of  E_{k-1} ... E_{j+1} (B_j u_j + d_j)  +  E_{k-1} ... E_0 x_0

A program over the controls alone is small and dense, where one with the states as variables too is
large and sparse.
"""

from __future__ import annotations

import numba
import numpy as np

from proxops.systems.gravity_field import Field

# Terms of the exponential's series for one interval; |A| dt is at most about 0.3.
_EXPONENTIAL_TERMS = 9


def condensed_motion(
    field: Field,
    spin: float,
    start: np.ndarray,
    states: np.ndarray,
    controls: np.ndarray,
    lengths: np.ndarray,
    acceleration: float,
    push: np.ndarray,
) -> np.ndarray:
    """Rows (N, 6, 3 N + 2): the states at the ends of N intervals, linear in (u, stretch, 1).

    The stretch is a relative change of all lengths; it counts to first order about the given
    states and controls.

    Args:
      spin: rad/s about z.
      start: (6,), where the motion begins, in m and m/s, in K.
      states, controls: (N + 1, 6) at the knots and (N, 3) between them, to linearise about.
      lengths: (N,) of the intervals, in s.
      acceleration: what a control of 1 gives along an axis, in m/s^2.
      push: (3,) in m/s^2, an acceleration that the field does not explain.
    """
    middle = 0.5 * (states[1:, :3] + states[:-1, :3])
    gravity = field.evaluate(middle)
    gradient = np.ascontiguousarray(gravity.gradient)
    constant = gravity.acceleration - (gradient @ middle[:, :, None])[:, :, 0] + push
    return _affine_states(gradient, constant, spin, acceleration, lengths, start, states, controls)


@numba.njit(cache=True, error_model="numpy", forceinline=True)
def _times(left, right):
    """left[:, :6] (6, 6) times right (6, M), at a size where a call of BLAS costs more."""
    product = np.zeros(right.shape)
    for i in range(6):
        for j in range(6):
            if left[i, j] != 0.0:
                for m in range(right.shape[1]):
                    product[i, m] += left[i, j] * right[j, m]
    return product


@numba.njit(cache=True, error_model="numpy")
def _affine_states(gradient, constant, spin, acceleration, lengths, start, states, controls):
    """Rows of `condensed_motion`, from G (N, 3, 3) and c (N, 3)."""
    n = len(lengths)
    rows = np.zeros((n, 6, 3 * n + 2))
    before = np.zeros((6, 3 * n + 2))
    before[:, 3 * n + 1] = start
    # d/dt x = rates @ (x, u, 1).
    rates, term, step = np.zeros((6, 10)), np.empty((6, 10)), np.empty((6, 10))
    for i in range(3):
        rates[i, 3 + i] = 1.0
        rates[3 + i, 6 + i] = acceleration
    rates[3, 4], rates[4, 3] = 2.0 * spin, -2.0 * spin
    for k in range(n):
        rates[3:, :3] = gradient[k]
        rates[3, 0] += spin**2
        rates[4, 1] += spin**2
        rates[3:, 9] = constant[k]
        # (E - 1, B, d): exp(A) - 1 for A = ((rates), (0)) times the length.
        term[:] = lengths[k] * rates
        step[:] = term
        for order in range(2, _EXPONENTIAL_TERMS):
            term[:] = (lengths[k] / order) * _times(rates, term)
            step += term
        now = rows[k]
        now[:] = before + _times(step, before)
        now[:, 3 * k : 3 * k + 3] += step[:, 6:9]
        now[:, 3 * n + 1] += step[:, 9]
        # A longer interval: the rates at its end, times its length.
        flown = np.concatenate((states[k], controls[k], np.ones(1)))
        flown[:6] += np.sum(step * flown, axis=1)
        now[:, 3 * n] += lengths[k] * np.sum(rates * flown, axis=1)
        before = now
    return rows
