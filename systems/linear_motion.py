"""Motion in K with gravity linearised about a path, in intervals of constant force."""

import numpy as np

from proxops.systems.gravity_field import Field

# Terms of the exponential's series for one interval; |A| dt is at most about 0.3.
_EXPONENTIAL_TERMS = 9


def linear_motion(
    field: Field,
    spin: float,
    positions: np.ndarray,
    lengths: np.ndarray,
    units: np.ndarray,
    force_unit: float,
    push: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """How each interval takes the state at its start, x, and a constant control u to its end.

    Args:
      spin: rad/s about z.
      positions: (N + 1, 3) in m, in K, at the knots; gravity is linearised about the middles.
      lengths: (N,) of the intervals, in s.
      units: (6,) in m and m/s that x is scaled by, the same along each axis.
      force_unit: acceleration of a unit of control, in m/s^2.
      push: (3,) in m/s^2, an acceleration that the field does not explain.

    Returns:
      E (N, 10, 10), with (x, u, 1) at an interval's end E times that at its start, and A
      (N, 10, 10), with E = exp(A): d/dt (x, u, 1) times the interval's length. E is exact for this
      linear motion, by the exponential's series.
    """
    n = len(lengths)
    length_unit, speed_unit = float(units[0]), float(units[3])
    middle = 0.5 * (positions[1:] + positions[:-1])
    gravity = field.evaluate(middle)
    gradient = gravity.gradient.copy()
    constant = gravity.acceleration - np.einsum("nij,nj->ni", gradient, middle) + push
    gradient[:, [0, 1], [0, 1]] += spin**2

    rates = np.zeros((n, 10, 10))
    rates[:, [0, 1, 2], [3, 4, 5]] = speed_unit / length_unit
    rates[:, 3:6, 0:3] = gradient * (length_unit / speed_unit)
    rates[:, 3, 4], rates[:, 4, 3] = 2.0 * spin, -2.0 * spin
    rates[:, [3, 4, 5], [6, 7, 8]] = force_unit / speed_unit
    rates[:, 3:6, 9] = constant / speed_unit
    rates *= lengths[:, None, None]
    term = rates
    step = np.eye(10) + rates
    for k in range(2, _EXPONENTIAL_TERMS):
        term = term @ rates / k
        step += term
    return step, rates
