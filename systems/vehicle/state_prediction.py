"""Prediction of the state over a short time, and the acceleration that a prediction lacks."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from proxops.systems.common import State, Vector3
from proxops.systems.gravity import Field
from proxops.systems.rotation import Spin, SpinModel, spin_model
from proxops.systems.vehicle.spacecraft import (
    rotating_frame_acceleration,
    spinning_frame_acceleration,
)

# Longest step of the prediction (s). Gravity changes over some 100 s, so the error of the classical
# Runge-Kutta method is a few micrometres.
_LONGEST_STEP = 5.0
_ORIGIN = np.zeros(3)


def believed_acceleration(
    state: State, gravity: Vector3, force: Vector3, mass: float, spin: SpinModel, time: float
) -> Vector3:
    """The acceleration (3,) in m/s^2 in K at a time in s, about a centre of mass at the origin.

    Args:
      state: (6,) in K, in m and m/s. gravity: (3,) in m/s^2. force: (3,) in N in K. mass: kg.
      spin: of the body.
    """
    position, velocity = state[:3], state[3:]
    if spin.about_z:
        rate = float(spin.rate[2])
        return rotating_frame_acceleration(position, velocity, gravity, force, mass, rate)
    rate, change = spin.angular_velocity(time), spin.angular_acceleration(time)
    return spinning_frame_acceleration(
        position, velocity, gravity, force, mass, rate, _ORIGIN, change
    )


def predicted_state(
    state: State,
    force: Vector3,
    duration: float,
    field: Field,
    mass: float,
    spin: Spin,
    time: float = 0.0,
) -> State:
    """The state (6,) after `duration` s under gravity and a constant force, by Runge-Kutta.

    Args:
      state: (6,) in K, in m and m/s. force: (3,) in N in K.
      field: the assumed gravity. mass: kg. spin: of the body; a number is in rad/s about z.
      time: of the state in s. The spin is taken as in the middle of the prediction.
    """
    spin, middle = spin_model(spin), time + 0.5 * duration

    def rate(at: np.ndarray) -> np.ndarray:
        gravity = field.evaluate(at[None, :3]).acceleration[0]
        acceleration = believed_acceleration(at, gravity, force, mass, spin, middle)
        return np.concatenate([at[3:], acceleration])

    steps = math.ceil(duration / _LONGEST_STEP)
    for _ in range(steps):
        state = runge_kutta_step(rate, state, duration / steps)
    return state


def runge_kutta_step(
    rate: Callable[[np.ndarray], np.ndarray], state: np.ndarray, step: float
) -> np.ndarray:
    """The state, an array of any shape, after a step in s of the classical Runge-Kutta method.

    Args:
      rate: the derivative of a state by the time in s; it does not depend on time itself.
    """
    first = rate(state)
    second = rate(state + 0.5 * step * first)
    third = rate(state + 0.5 * step * second)
    fourth = rate(state + step * third)
    return state + step / 6.0 * (first + 2.0 * (second + third) + fourth)


def moved_by(disturbance: np.ndarray, duration: float) -> np.ndarray:
    """The change (6,) of a state by a constant acceleration (3,), in m/s^2, over `duration` s."""
    return np.concatenate([0.5 * duration**2 * disturbance, duration * disturbance])


def unexplained_acceleration(
    before: State,
    after: State,
    force: np.ndarray,
    duration: float,
    field: Field,
    mass: float,
    spin: Spin,
    time: float = 0.0,
) -> Vector3:
    """The mean acceleration (3,), in m/s^2, that gravity and a constant force do not explain.

    Args:
      before, after: states (6,) in K, `duration` s apart.
      force, field, mass, spin: as in `predicted_state`. time: of `before` in s.
    """
    change = after[3:] - before[3:]
    # The position halfway on the cubic through both states.
    middle = 0.5 * (before[:3] + after[:3]) - 0.125 * duration * change
    expected = believed_acceleration(
        np.concatenate([middle, 0.5 * (before[3:] + after[3:])]),
        field.evaluate(middle[None]).acceleration[0],
        force,
        mass,
        spin_model(spin),
        time + 0.5 * duration,
    )
    return change / duration - expected
