"""How soon a spacecraft could be at the keep-out ellipsoid, whatever its thrusters do.

Seen from the frame that does not turn and coincides with K now, there is no Coriolis force. With
Q(t) the turn of K over t, where the spacecraft is in K at the time t is then exactly::

    r(t) = c(t) + integral over s of (t - s) Q(t - s)^T (f(s) / m + g(s)),
    c(t) = Q(t)^T (r_0 + (v_0 + w x r_0) t)

with the thrust f and the gravity g in K at the time s. For any unit vector n, with every thruster
between plus and minus its limit and the gravity no greater than G(s), n . r(t) is at least::

    n . c(t)  -  t^2 / 2 a max |Q(tau) n|_1  -  integral over s of (t - s) G(s)

The spacecraft is outside while this exceeds the greatest n . x of the ellipsoid, |A n|_2; n is the
ellipsoid's normal below c(t). Between two times that are looked at, the clearance changes by no
more than the speed in K allows, and Coriolis force changes no speed.

|g|^2 is subharmonic where there is no mass, so its greatest value outside a closed surface about
the body is on that surface: G is tabulated on ellipsoids round the keep-out.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numba
import numpy as np

from proxops.systems.gravity import Field
from proxops.systems.shapes import closest_point

# Heights of the table over the keep-out's shortest semi-axis, points on each, and what is added
# for the gaps between them.
_HEIGHTS = np.array([0.0, 0.1, 0.2, 0.4, 0.8, 1.6])
_POINTS = 500
_GAPS = 1.05


@dataclass(frozen=True)
class ReachModel:
    """What bounds the motion near a keep-out ellipsoid."""

    semi_axes: np.ndarray
    """(3,) of the keep-out ellipsoid in m."""
    spin: float
    """rad/s about z."""
    acceleration: float
    """Greatest of the thrusters along each axis of K, in m/s^2."""
    heights: np.ndarray
    """(L,) in m, rising from 0."""
    pulls: np.ndarray
    """(L,) greatest gravity in m/s^2 further than that from the ellipsoid."""

    @classmethod
    def of(
        cls, field: Field, semi_axes: np.ndarray, spin: float, acceleration: float
    ) -> ReachModel:
        """The model of a body's field; gravity is looked up on `_POINTS` points a height."""
        heights = _HEIGHTS * float(semi_axes.min())
        model = cls(
            np.asarray(semi_axes, dtype=np.float64),
            float(spin),
            float(acceleration),
            heights,
            greatest_pulls(field, semi_axes, heights),
        )
        model.steps_out_of_reach(np.zeros(6), 1.0, 1)  # Compiled now, not in flight.
        return model

    def steps_out_of_reach(
        self,
        state: np.ndarray,
        step: float,
        longest: int,
        position_error: float = 0.0,
        velocity_error: float = 0.0,
        stopping: bool = False,
    ) -> int:
        """For how many steps, at most `longest`, the spacecraft can't reach the ellipsoid.

        Args:
          state: (6,) in K, in m and m/s.
          step: length of a step in s.
          position_error, velocity_error: how far, in m and m/s, the state may be from the truth.
          stopping: and could be stopped before it then.
        """
        return int(
            _steps_out_of_reach(
                np.asarray(state, dtype=np.float64), self.semi_axes, self.spin, self.acceleration,
                self.heights, self.pulls, float(step), int(longest), float(position_error),
                float(velocity_error), bool(stopping),
            )
        )  # fmt: skip


def greatest_pulls(field: Field, semi_axes: np.ndarray, heights: np.ndarray) -> np.ndarray:
    """Bounds (L,) in m/s^2 of gravity further than heights (L,), in m, from an ellipsoid.

    All that is as far away is outside the ellipsoid with that added to each semi-axis, for the
    support function of the latter is the lesser (Minkowski); the body is inside it.
    """
    k = np.arange(_POINTS) + 0.5
    z, turn = 1.0 - 2.0 * k / _POINTS, math.pi * (1.0 + math.sqrt(5.0)) * k  # A spiral, evenly.
    across = np.sqrt(1.0 - z**2)
    directions = np.stack([across * np.cos(turn), across * np.sin(turn), z], axis=1)
    points = directions * (semi_axes + heights[:, None, None])
    gravity = field.evaluate(points.reshape(-1, 3)).acceleration
    sizes = np.linalg.norm(gravity, axis=1).reshape(len(heights), -1)
    return _GAPS * sizes.max(axis=1)


@numba.njit(cache=True, error_model="numpy")
def _steps_out_of_reach(
    state, semi_axes, spin, acceleration, heights, pulls, step, longest, position_error,
    velocity_error, stopping,
):  # fmt: skip
    position = state[:3].copy()
    velocity = state[3:].copy()  # In the frame that does not turn.
    velocity[0] -= spin * position[1]
    velocity[1] += spin * position[0]
    drift_error = velocity_error + abs(spin) * position_error
    # What gravity may have done to velocity and position so far.
    pulled_speed, pulled = 0.0, 0.0
    # Bounds of speed in K and of the distance from the spin axis.
    speed = np.sqrt(np.sum(state[3:] ** 2)) + velocity_error
    radius = np.sqrt(position[0] ** 2 + position[1] ** 2) + position_error
    thrust = np.sqrt(3.0) * acceleration
    # Over a step the bounds of speed and radius feed each other; this solves for both.
    slack = 1.0 - (spin * step) ** 2
    if not slack > 0.0:
        return 0
    before = _gap(position, semi_axes, _normal(position, semi_axes), 0.0) - position_error
    for k in range(longest):
        if not before > 0.0:  # NaN too.
            return k
        # Gravity is at most what it is at the least height of this step.
        fastest = (speed + step * (thrust + pulls[0] + spin**2 * radius)) / slack
        lowest = before - step * fastest
        pull = pulls[0]
        for j in range(len(heights)):
            if heights[j] <= lowest:
                pull = pulls[j]
        pulled += step * pulled_speed + 0.5 * step**2 * pull
        pulled_speed += step * pull
        gained = step * (thrust + pull + spin**2 * radius)
        speed = (speed + gained) / slack
        radius += step * speed
        time = (k + 1) * step
        cos, sin = np.cos(spin * time), np.sin(spin * time)
        moved = position + time * velocity
        centre = np.array(
            [cos * moved[0] + sin * moved[1], cos * moved[1] - sin * moved[0], moved[2]]
        )
        normal = _normal(centre, semi_axes)
        box = acceleration * _greatest_box_support(normal, spin * time)
        after = _gap(centre, semi_axes, normal, 0.5 * box * time**2 + pulled)
        after -= position_error + drift_error * time
        if not 0.5 * (before + after - step * speed) > 0.0:
            return k
        if stopping:
            drift = np.array(
                [
                    cos * velocity[0] + sin * velocity[1] + spin * centre[1],
                    cos * velocity[1] - sin * velocity[0] - spin * centre[0],
                    velocity[2],
                ]
            )
            inward = box * time + pulled_speed + drift_error - np.sum(normal * drift)
            # From what turns K: centrifugal, and Coriolis -2 w x v.
            outward = acceleration * np.sum(np.abs(normal)) - pull
            outward += spin**2 * (normal[0] * centre[0] + normal[1] * centre[1])
            outward += 2.0 * spin * (normal[0] * drift[1] - normal[1] * drift[0])
            if inward > 0.0 and not inward**2 < 2.0 * outward * after:
                return k
        before = after
    return longest


@numba.njit(cache=True, error_model="numpy")
def _normal(point, semi_axes):
    """The ellipsoid's unit normal below a point outside it; towards the point, if it is inside."""
    if not np.sum((point / semi_axes) ** 2) > 1.0:
        return point / np.sqrt(np.sum(point**2))
    normal = closest_point(semi_axes, point) / semi_axes**2
    return normal / np.sqrt(np.sum(normal**2))


@numba.njit(cache=True, error_model="numpy")
def _gap(centre, semi_axes, normal, moved):
    """A lower bound of the distance to the ellipsoid of all that is up to `moved` from `centre`."""
    return np.sum(normal * centre) - np.sqrt(np.sum((semi_axes * normal) ** 2)) - moved


@numba.njit(cache=True, error_model="numpy")
def _greatest_box_support(normal, turned):
    """The greatest |n|_1 while n turns about z by up to `turned`, in rad of either sign."""
    across = np.sqrt(normal[0] ** 2 + normal[1] ** 2)
    # |cos| + |sin| repeats each quarter turn, and is greatest in the middle of each.
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
