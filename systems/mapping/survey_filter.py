"""The filter of a survey's flight: position, velocity and gravity by where the body is seen."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from proxops.systems.common import Matrix3, Values, Vector3, rotation_matrix
from proxops.systems.gravity import MoonConfig, tides
from proxops.systems.rotation import TorqueFreeSpin

PLACE, VELOCITY, GM, OFFSET, CONSTANT = (
    slice(0, 3), slice(3, 6), slice(6, 7), slice(7, 10), slice(10, 13),
)  # fmt: skip
STATES = 13
"""Position in m and velocity in m/s in N, GM in m^3/s^2, how far what is seen as the middle is from
the centre of mass in m in N, and a constant acceleration in m/s^2 in B."""
# Of the offset, over the longest semi-axis; it is alike over this share of a turn.
_SPREAD, _ALIKE = 0.1, 0.15
# Of a middle by one return, over the longest semi-axis, and the least that one is off anew.
_SINGLE, _LEAST = 0.5, 0.02
# The most deviations that a middle may be off, and what one far off adds to the position's.
_GATE, _DOUBT = 3.0, 0.5
# GM is at least this share of what is believed.
_LIGHTEST = 0.3


class Around(NamedTuple):
    """What is known of a body that is to be surveyed, and how it is flown around."""

    semi_axes: Vector3
    """(3,) in m along its axes, of an ellipsoid."""
    gm: float
    """In m^3/s^2, and one standard deviation of it over its value:"""
    gm_error: float
    rate: float
    """Spin rate about z in rad/s."""
    radius: float
    """Of the orbit in m."""
    keep_out: float
    """Radius in m of a sphere that holds any body that the ellipsoid permits: nothing enters it."""
    constant: float
    """One standard deviation in m/s^2 of a constant acceleration in B, along each axis."""
    varying: float
    """One standard deviation in m/s^2 of one that varies, along each axis, over"""
    correlation: float
    """a time in s."""
    moons: Sequence[MoonConfig] = ()
    """As they are believed; N has the axes that B has at time 0."""
    spin: TorqueFreeSpin | None = None
    """How a body turns that tumbles, with `rate` at time 0; None: about z."""

    @property
    def longest(self) -> float:
        """The longest semi-axis in m."""
        return float(np.max(self.semi_axes))

    @property
    def surest(self) -> float:
        """About the deviation in m/s of all axes to which the filter's velocity falls in time.

        That of a Kalman filter for white acceleration and white noise of the position.
        """
        white = 2.0 * self.varying**2 * self.correlation
        noise = 2.0 * (_SPREAD * self.longest) ** 2 * _ALIKE * 2.0 * math.pi / abs(self.rate)
        return math.sqrt(3.0 * math.sqrt(2.0) * white**0.75 * noise**0.25)

    def crossing(self, distance: float) -> float:
        """Time in s in which a ray crosses the body, at a distance in m: rays turn with S."""
        return min(2.0 * self.longest / distance, 2.0 * math.pi) / abs(self.rate)

    def turn(self, time: float) -> Matrix3:
        """R_NB (3, 3) at a time in s, as believed."""
        if self.spin is not None:
            return rotation_matrix(self.spin.attitude(time))
        c, s = math.cos(self.rate * time), math.sin(self.rate * time)
        return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])

    def angular_velocity(self, time: float) -> Vector3:
        """(3,) in rad/s in B at a time in s, as believed."""
        if self.spin is not None:
            return self.spin.angular_velocity(time)
        return np.array([0.0, 0.0, self.rate])


class Flown(NamedTuple):
    """What the filter knows."""

    mean: Values
    """(STATES,)."""
    covariance: np.ndarray
    """(STATES, STATES)."""

    @property
    def unsure(self) -> float:
        """One standard deviation in m/s of the velocity, of all axes together."""
        return math.sqrt(max(0.0, float(np.trace(self.covariance[VELOCITY, VELOCITY]))))


def first_seen(around: Around, middle: Vector3, unseen: Matrix3) -> Flown:
    """The start: a spacecraft at the place (3,) in m in N from the middle, of any velocity.

    `unseen` (3, 3) in m^2 in N says how far the middle may be off because no rays pass there.
    """
    mean = np.zeros(STATES)
    mean[PLACE], mean[GM] = middle, around.gm
    sigma = np.empty(STATES)
    sigma[PLACE] = 0.3 * around.longest
    # It may fall from afar.
    sigma[VELOCITY] = math.sqrt(2.0 * around.gm / np.linalg.norm(middle))
    sigma[GM] = around.gm_error * around.gm
    sigma[OFFSET], sigma[CONSTANT] = _SPREAD * around.longest, around.constant
    covariance = np.diag(sigma**2)
    covariance[PLACE, PLACE] += unseen
    return Flown(mean, covariance)


def corrected(flown: Flown, around: Around, middle: Vector3, count: int, unseen: Matrix3) -> Flown:
    """Takes the middle (3,) in m in N that a frame shows by so many returns into account.

    `unseen` is as of `first_seen`, for all frames together in which that is alike.
    """
    longest = around.longest
    covariance = flown.covariance.copy()
    off = middle - flown.mean[PLACE] - flown.mean[OFFSET]
    rows = np.zeros((3, STATES))
    rows[:, PLACE] = rows[:, OFFSET] = np.eye(3)
    noise = (_SINGLE**2 / count + _LEAST**2) * longest**2 * np.eye(3) + unseen
    spread = rows @ covariance @ rows.T + noise
    if off @ np.linalg.solve(spread, off) > 3.0 * _GATE**2:
        # Either this is false, or what is believed: then the next ones are taken.
        covariance[PLACE, PLACE] += np.eye(3) * (_DOUBT * longest) ** 2
        return flown._replace(covariance=covariance)
    gain = np.linalg.solve(spread, rows @ covariance).T
    mean = flown.mean + gain @ off
    mean[GM] = np.maximum(mean[GM], _LIGHTEST * around.gm)
    # Joseph's form: rounding must not make a variance negative.
    left = np.eye(STATES) - gain @ rows
    return Flown(mean, left @ covariance @ left.T + gain @ noise @ gain.T)


def predicted(flown: Flown, around: Around, time: float, thrust: Vector3, period: float) -> Flown:
    """Moves all over a period in s from a time in s on, with a commanded acceleration (3,) in N."""
    mean, turn = flown.mean.copy(), around.turn(time + 0.5 * period)
    place, velocity, gm = flown.mean[PLACE], flown.mean[VELOCITY], float(flown.mean[GM][0])
    known = thrust + turn @ flown.mean[CONSTANT]
    distance = float(np.linalg.norm(place))
    half = place + 0.5 * period * velocity
    if around.moons:
        known += tides(around.moons, np.array([time + 0.5 * period]), half[None])[0]
    pull = -gm * half / np.linalg.norm(half) ** 3 + known
    mean[PLACE] += period * velocity + 0.5 * period**2 * pull
    mean[VELOCITY] += period * pull
    kept = math.exp(-period / (_ALIKE * 2.0 * math.pi / abs(around.rate)))
    mean[OFFSET] *= kept
    step = np.eye(STATES)
    up = place / distance
    gradient = gm / distance**3 * (3.0 * np.outer(up, up) - np.eye(3))
    step[PLACE, PLACE] += 0.5 * period**2 * gradient
    step[PLACE, VELOCITY] = period * np.eye(3)
    step[VELOCITY, PLACE] = period * gradient
    step[VELOCITY, GM] = -period * place[:, None] / distance**3
    step[VELOCITY, CONSTANT] = period * turn
    step[OFFSET, OFFSET] = kept * np.eye(3)
    covariance = step @ flown.covariance @ step.T
    noise = 2.0 * around.varying**2 * around.correlation * period
    noise += (0.05 * np.linalg.norm(thrust) * period) ** 2
    covariance[VELOCITY, VELOCITY] += noise * np.eye(3)
    covariance[OFFSET, OFFSET] += (1.0 - kept**2) * (_SPREAD * around.longest) ** 2 * np.eye(3)
    return Flown(mean, covariance)
