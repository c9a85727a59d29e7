"""Motion about a body that turns: the textbook's cross products, and SciPy's integration."""

import numpy as np
from numpy.typing import ArrayLike
from scipy.integrate import solve_ivp

from proxops.systems.gravity import Field


def acceleration(
    field: Field, spin: float, position: np.ndarray, velocity: np.ndarray
) -> np.ndarray:
    """Acceleration (3,) in K without thrust, in m/s^2: gravity, Coriolis and centrifugal.

    Args:
      spin: rad/s about z. position, velocity: (3,) in K, in m and m/s.
    """
    turn = np.array([0.0, 0.0, spin])
    gravity = field.evaluate(position[None]).acceleration[0]
    return gravity - 2.0 * np.cross(turn, velocity) - np.cross(turn, np.cross(turn, position))


def moved(
    field: Field,
    spin: float,
    state: np.ndarray,
    push: ArrayLike,
    duration: float,
    rtol: float = 1e-10,
) -> np.ndarray:
    """The state (6,) in K after a duration, in s, of a push (3,) in m/s^2 that is constant in K."""

    def rate(_: float, at: np.ndarray) -> np.ndarray:
        return np.concatenate([at[3:], acceleration(field, spin, at[:3], at[3:]) + push])

    return solve_ivp(rate, (0.0, duration), state, "DOP853", rtol=rtol, atol=1e-6).y[:, -1]
