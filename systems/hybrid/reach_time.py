"""`ReachModel`: how soon a spacecraft could reach the keep-out ellipsoid, by any use of thrust.

Eq. 28 of docs/method/equations.md bounds the position along any unit vector n: here the ellipsoid's
normal below the place that is reached without gravity and thrust. The spacecraft is outside while
the bound exceeds the greatest n . x of the ellipsoid, |A n|_2. Between two evaluated times the
clearance changes by at most what the speed in K allows, and the Coriolis force does not change the
speed.

|g|^2 is subharmonic where there is no mass, so its greatest value outside a closed surface about
the body is on that surface. It is tabulated on ellipsoids around the keep-out ellipsoid.
"""

from __future__ import annotations

import functools
import math
from typing import NamedTuple

import numpy as np

from proxops.systems.common import State, Values, Vector3, kernel, spread_directions
from proxops.systems.gravity import Field
from proxops.systems.shapes import normal_below

# Heights of the table relative to the keep-out ellipsoid's shortest semi-axis, number of points at
# each height, and the factor that covers the gaps between the points.
_HEIGHTS = np.array([0.0, 0.1, 0.2, 0.4, 0.8, 1.6])
_POINTS = 500
_GAPS = 1.05


class ReachModel(NamedTuple):
    """Bounds of the motion near a keep-out ellipsoid."""

    semi_axes: Vector3
    """(3,) of the keep-out ellipsoid in m."""
    spin: float
    """rad/s about z."""
    acceleration: float
    """Greatest acceleration by the thrusters along each axis of K, in m/s^2."""
    heights: Values
    """(L,) in m, rising from 0."""
    gravity: Values
    """(L,) greatest gravity, with all other accelerations, in m/s^2 beyond each height."""
    weakest: float
    """Least acceleration that the thrusters can be relied on to give along each axis, in m/s^2."""

    @classmethod
    def of(
        cls,
        field: Field,
        semi_axes: Vector3,
        spin: float,
        acceleration: float,
        weakest: float | None = None,
        gravity: float = 0.0,
        other: float = 0.0,
    ) -> ReachModel:
        """Makes the model from a body's field.

        Args:
          field: the assumed gravity.
          semi_axes: (3,) of the keep-out ellipsoid in m.
          spin: rad/s about z.
          acceleration: greatest acceleration by the thrusters along each axis, in m/s^2.
          weakest: see above; None: `acceleration`.
          gravity: greatest error of the gravity's size, as a share of it.
          other: greatest other acceleration along each axis, in m/s^2.
        """
        heights = _HEIGHTS * float(semi_axes.min())
        model = cls(
            np.asarray(semi_axes, dtype=np.float64),
            float(spin),
            float(acceleration),
            heights,
            (1.0 + gravity) * greatest_gravity(field, semi_axes, heights) + math.sqrt(3.0) * other,
            float(acceleration if weakest is None else weakest),
        )
        model.steps_out_of_reach(np.zeros(6), 1.0, 1)  # Compiled now, not in flight.
        return model

    def steps_out_of_reach(
        self,
        state: State,
        step: float,
        longest: int,
        position_error: float = 0.0,
        velocity_error: float = 0.0,
        stopping: bool = False,
    ) -> int:
        """The number of steps, at most `longest`, in which the ellipsoid cannot be reached.

        Args:
          state: (6,) in K, in m and m/s.
          step: length of a step in s.
          longest: greatest number of steps to look at.
          position_error, velocity_error: bounds, in m and m/s, of the errors of the state.
          stopping: whether the spacecraft must also be able to stop before the ellipsoid after
            them.
        """
        return int(
            _steps_out_of_reach(
                np.asarray(state, dtype=np.float64),
                self,
                float(step),
                int(longest),
                float(position_error),
                float(velocity_error),
                bool(stopping),
            )
        )


def greatest_gravity(field: Field, semi_axes: np.ndarray, heights: Values) -> Values:
    """Bounds (L,) in m/s^2 of gravity farther than heights (L,), in m, from an ellipsoid.

    A point farther away than a height is outside the ellipsoid whose semi-axes are longer by that
    height: by Minkowski's inequality the support function of that ellipsoid is at most the sum of
    the first ellipsoid's and the height. The body is inside.
    """
    numbers = tuple(map(float, semi_axes)), tuple(map(float, heights))
    return np.array(_greatest_gravity(field, *numbers))


# The exact field at all of these points takes a tenth of the time of a flight with the hybrid.
@functools.lru_cache(maxsize=4)
def _greatest_gravity(
    field: Field, semi_axes: tuple[float, ...], heights: tuple[float, ...]
) -> tuple[float, ...]:
    scaled = np.array(semi_axes) + np.array(heights)[:, None, None]
    points = spread_directions(_POINTS) * scaled
    gravity = field.evaluate(points.reshape(-1, 3)).acceleration
    sizes = np.linalg.norm(gravity, axis=1).reshape(len(heights), -1)
    return tuple((_GAPS * sizes.max(axis=1)).tolist())


@kernel(error_model="numpy")
def _steps_out_of_reach(
    state, model, step, longest, position_error, velocity_error, stopping
):  # fmt: skip
    """See `ReachModel.steps_out_of_reach`: eq. 28 of docs/method/equations.md, step by step."""
    semi_axes, spin, acceleration, heights, gravity, weakest = model
    position = state[:3]
    # In the frame that does not turn.
    vx, vy, vz = state[3] - spin * state[1], state[4] + spin * state[0], state[5]
    drift_error = velocity_error + abs(spin) * position_error
    # The greatest change of speed and of position by gravity so far.
    pulled_speed, pulled = 0.0, 0.0
    # Upper bounds of the speed in K and of the distance from the spin axis.
    speed = math.sqrt(state[3] ** 2 + state[4] ** 2 + state[5] ** 2) + velocity_error
    radius = math.sqrt(state[0] ** 2 + state[1] ** 2) + position_error
    thrust = math.sqrt(3.0) * acceleration
    centre = np.empty(3)
    # Over a step the bounds of speed and radius depend on each other; this factor solves for both.
    slack = 1.0 - (spin * step) ** 2
    if not slack > 0.0:
        return 0
    before = _gap(position, semi_axes, normal_below(semi_axes, position), 0.0) - position_error
    for k in range(longest):
        if not before > 0.0:  # True for NaN, too.
            return k
        # The bound of gravity is that at the least height of this step.
        fastest = (speed + step * (thrust + gravity[0] + spin**2 * radius)) / slack
        lowest = before - step * fastest
        strongest = gravity[0]
        for j in range(len(heights)):
            if heights[j] <= lowest:
                strongest = gravity[j]
        pulled += step * pulled_speed + 0.5 * step**2 * strongest
        pulled_speed += step * strongest
        gained = step * (thrust + strongest + spin**2 * radius)
        speed = (speed + gained) / slack
        radius += step * speed
        time = (k + 1) * step
        cos, sin = math.cos(spin * time), math.sin(spin * time)
        x, y = position[0] + time * vx, position[1] + time * vy
        centre[0], centre[1] = cos * x + sin * y, cos * y - sin * x
        centre[2] = position[2] + time * vz
        normal = normal_below(semi_axes, centre)
        box = acceleration * _greatest_box_support(normal, spin * time)
        after = _gap(centre, semi_axes, normal, 0.5 * box * time**2 + pulled)
        after -= position_error + drift_error * time
        if not 0.5 * (before + after - step * speed) > 0.0:
            return k
        if stopping:
            ahead = cos * vx + sin * vy + spin * centre[1]
            aside = cos * vy - sin * vx - spin * centre[0]
            drift = normal[0] * ahead + normal[1] * aside + normal[2] * vz
            inward = box * time + pulled_speed + drift_error - drift
            # The terms of the rotating frame: centrifugal, and Coriolis -2 w x v.
            outward = weakest * (abs(normal[0]) + abs(normal[1]) + abs(normal[2])) - strongest
            outward += spin**2 * (normal[0] * centre[0] + normal[1] * centre[1])
            outward += 2.0 * spin * (normal[0] * aside - normal[1] * ahead)
            if inward > 0.0 and not inward**2 < 2.0 * outward * after:
                return k
        before = after
    return longest


@kernel(error_model="numpy")
def _gap(centre, semi_axes, normal, moved):
    """A lower bound of the distance to the ellipsoid from points within `moved` of `centre`."""
    along = square = 0.0
    for i in range(3):
        along += normal[i] * centre[i]
        square += (semi_axes[i] * normal[i]) ** 2
    return along - math.sqrt(square) - moved


@kernel(error_model="numpy")
def _greatest_box_support(normal, turned):
    """The greatest |n|_1 while n turns about z by up to `turned`, in rad, in either direction."""
    across = math.sqrt(normal[0] ** 2 + normal[1] ** 2)
    # |cos| + |sin| has a period of a quarter turn and is greatest in the middle of it.
    quarter = 0.5 * np.pi
    first = np.arctan2(normal[1], normal[0])
    last = first + turned
    low, high = min(first, last), max(first, last)
    peak = (np.ceil(low / quarter - 0.5) + 0.5) * quarter
    if peak <= high:
        level = np.sqrt(2.0)
    else:
        level = max(abs(np.cos(first)) + abs(np.sin(first)), abs(np.cos(last)) + abs(np.sin(last)))
    return across * level + abs(normal[2])
