"""`SurveyController`: goes to an orbit about a body without a map, and keeps it."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from pydrake.systems.framework import BasicVector, LeafSystem

from proxops.systems.common import Values, Vector3, Vectors3
from proxops.systems.mapping.first_orbit import densest, middle_of

# Inclination of the orbit, as the cosine: nearly over the poles.
_COSINE = math.cos(math.radians(75.0))
# Beyond this many radii of its orbit it flies towards it; then it makes its orbit round.
_NEAR = 1.25
# It falls at least at this share of the speed of a round orbit.
_FALLING = 0.2
# Of a free orbit that is left alone, over the radius.
_LOWEST, _HIGHEST = 0.88, 1.2
# It corrects what is more than this share of the speed of its orbit off, and this many deviations.
_BAND, _SURE = 0.04, 2.0
# Of a middle, over the longest semi-axis; its errors are alike over this share of a turn. And the
# most that one may be off.
_SPREAD, _ALIKE, _GATE = 0.15, 0.2, 3.0
# Returns of a frame that show where the body is. What a middle far off adds to the deviation of the
# position, over the longest semi-axis.
_FEWEST, _DOUBT = 8, 0.5
# Position, velocity and GM (7), their covariance (49), whether the body was seen, and how long the
# orbit is kept.
_STATES = 7
_SEEN, _KEPT = _STATES + _STATES**2, _STATES + _STATES**2 + 1


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
    acceleration: float
    """One standard deviation in m/s^2 of what nothing explains, over `correlation` in s."""
    correlation: float


class SurveyController(LeafSystem):
    """Orbits a body of which an ellipsoid, a mass and a spin are known, and nothing else.

    ```
             ┌──────────────────┐
    ranges ─►│ SurveyController ├─► force (3), N, S
      (R), m └──────────────────┘
    ```

    A Kalman filter in N knows position, velocity and GM by where the frames show the body's middle.
    Far away the controller aims at the orbit's radius, in a plane that is steep to the equator;
    near it, at the speed of a round orbit. It thrusts only if that is off by more than a band: a
    free orbit costs nothing. Attitude is as believed: S turns with the body's believed rotation.
    """

    def __init__(
        self, around: Around, directions: Vectors3, mass: float, thrust: float, period: float
    ):
        """Takes what is known.

        Args:
          around: of the body and the orbit. directions: (R, 3) of the lidar's rays in S.
          mass, thrust: of the spacecraft in kg, and its limit per axis in N.
          period: control period in s.
        """
        super().__init__()
        self.around, self._directions = around, directions
        self._mass, self._thrust, self._period = mass, thrust, period
        self._ranges = self.DeclareVectorInputPort("ranges", len(directions))
        self.DeclareDiscreteState(np.zeros(_KEPT + 1))
        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._update)
        self.DeclareVectorOutputPort(
            "force",
            BasicVector(3),
            self._calc_force,
            {self.xd_ticket(), self.time_ticket()},
        )

    def kept_for(self, context) -> float:
        """How long the orbit has been kept, in s."""
        return float(context.get_discrete_state(0).value()[_KEPT])

    def _turn(self, time: float) -> np.ndarray:
        """R_NS (3, 3), as believed."""
        c, s = math.cos(self.around.rate * time), math.sin(self.around.rate * time)
        return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])

    def _calc_force(self, context, output):
        output.SetFromVector(self._force(context.get_time(), context.get_discrete_state(0).value()))

    def _force(self, time: float, values: Values) -> Vector3:
        if values[_SEEN] == 0.0:
            return np.zeros(3)
        covariance = values[_STATES:_SEEN].reshape(_STATES, _STATES)
        wanted = wanted_velocity(values[:_STATES], self.around.radius)
        off = wanted - values[3:6]
        circular = math.sqrt(values[6] / self.around.radius)
        unsure = _SURE * math.sqrt(np.trace(covariance[3:6, 3:6]))
        if unsure > circular / _SURE or np.linalg.norm(off) < _BAND * circular + unsure:
            return np.zeros(3)
        force = self._turn(time).T @ (off * self._mass / self._period)
        return force / max(1.0, float(np.abs(force).max()) / self._thrust)

    def _update(self, context, discrete):
        time, values = context.get_time(), context.get_discrete_state(0).value().copy()
        turn, ranges = self._turn(time), self._ranges.Eval(context)
        measured = self._middle(turn, ranges)
        force = turn @ self._force(time, values)
        if values[_SEEN] == 0.0:
            if measured is not None:
                values[:_STATES] = np.r_[measured, np.zeros(3), self.around.gm]
                longest, radius = self.around.semi_axes.max(), self.around.radius
                speed = 2.0 * math.sqrt(self.around.gm / radius)
                sigma = np.r_[np.full(3, 0.3 * longest), np.full(3, speed)]
                sigma = np.r_[sigma, self.around.gm_error * self.around.gm]
                values[_STATES:_SEEN] = np.diag(sigma**2).ravel()
                values[_SEEN] = 1.0
        else:
            self._correct(values, measured)
            near = np.linalg.norm(values[:3]) < _NEAR * self.around.radius
            values[_KEPT] += self._period if near or values[_KEPT] > 0.0 else 0.0
        if values[_SEEN] == 1.0:
            self._predict(values, force / self._mass)
        discrete.get_mutable_vector(0).SetFromVector(values)

    def _middle(self, turn: np.ndarray, ranges: Values) -> Vector3 | None:
        """Where the spacecraft is from the body's middle (3,) in N, if the frame shows it."""
        seen = np.flatnonzero(np.isfinite(ranges))
        if len(seen) < _FEWEST:
            return None
        rays = (self._directions[seen] * ranges[seen, None]) @ turn.T
        rays = rays[densest(rays, float(self.around.semi_axes.max()))]
        return None if len(rays) < _FEWEST else middle_of(rays, self.around.semi_axes, turn)

    def _correct(self, values: Values, measured: Vector3 | None) -> None:
        """Takes a middle into account."""
        longest = float(self.around.semi_axes.max())
        covariance = values[_STATES:_SEEN].reshape(_STATES, _STATES)
        if measured is None:
            return
        off = measured - values[:3]
        sigma = _GATE * math.sqrt(np.trace(covariance[:3, :3]) + longest**2)
        if np.linalg.norm(off) > sigma:
            # Either this is false, or what is believed: then the next ones are taken.
            covariance[:3, :3] += np.eye(3) * (_DOUBT * longest) ** 2
            return
        alike = max(1.0, _ALIKE * 2.0 * math.pi / abs(self.around.rate) / self._period)
        noise = alike * (_SPREAD * longest) ** 2
        gain = np.linalg.solve(covariance[:3, :3] + noise * np.eye(3), covariance[:3]).T
        values[:_STATES] += gain @ off
        # Joseph's form: rounding must not make a variance negative.
        left = np.eye(_STATES)
        left[:, :3] -= gain
        covariance[:] = left @ covariance @ left.T + noise * gain @ gain.T
        least = 0.3 * self.around.gm
        values[6] = max(values[6], least)

    def _predict(self, values: Values, thrust: Vector3) -> None:
        """Moves position and velocity, with their covariance, over a period."""
        period, gm = self._period, values[6]
        covariance = values[_STATES:_SEEN].reshape(_STATES, _STATES)

        def pull(place: Vector3) -> Vector3:
            return -gm * place / np.linalg.norm(place) ** 3 + thrust

        place, velocity = values[:3].copy(), values[3:6].copy()
        distance = float(np.linalg.norm(place))
        gradient = gm / distance**3 * (3.0 * np.outer(place, place) / distance**2 - np.eye(3))
        step = np.eye(_STATES)
        step[:3, :3] += 0.5 * period**2 * gradient
        step[:3, 3:6] = period * np.eye(3)
        step[3:6, :3] = period * gradient
        step[3:6, 6] = -period * place / distance**3
        half = place + 0.5 * period * velocity
        values[:3] = place + period * velocity + 0.5 * period**2 * pull(half)
        values[3:6] = velocity + period * pull(half)
        covariance[:] = step @ covariance @ step.T
        around = self.around
        noise = 2.0 * around.acceleration**2 * around.correlation * period
        noise += (0.05 * np.linalg.norm(thrust) * period) ** 2
        covariance[3:6, 3:6] += noise * np.eye(3)


def wanted_velocity(state: Values, radius: float) -> Vector3:
    """The velocity (3,) in m/s in N that leads to, or keeps, an orbit of a radius.

    Far away: the radial speed stays, and across it is what makes the radius the orbit's lowest
    point. Near: that of a round orbit, and slowly to its radius.

    Args:
      state: (7,) position in m, velocity in m/s, GM. radius: in m.
    """
    place, velocity, gm = state[:3], state[3:6], state[6]
    distance = float(np.linalg.norm(place))
    up = place / distance
    normal = orbit_normal(up, np.cross(place, velocity))
    along = np.cross(normal, up)
    if distance > _NEAR * radius:
        # It falls at least so fast: a flight from afar would take weeks.
        falling = -_FALLING * math.sqrt(gm / distance)
        radial = min(float(velocity @ up), falling)
        energy = radial**2 + 2.0 * gm * (1.0 / radius - 1.0 / distance)
        across = math.sqrt(energy / ((distance / radius) ** 2 - 1.0))
        return radial * up + across * along
    if _is_round(place, velocity, gm, radius):
        return velocity
    circular = math.sqrt(gm / distance)
    rise = (radius - distance) * math.sqrt(gm / radius**3)
    return circular * along + float(np.clip(rise, -0.2 * circular, 0.2 * circular)) * up


def _is_round(place: Vector3, velocity: Vector3, gm: float, radius: float) -> bool:
    """Whether a free orbit stays between the least and the greatest distance."""
    energy = 0.5 * velocity @ velocity - gm / np.linalg.norm(place)
    if energy >= 0.0:
        return False
    momentum = np.cross(place, velocity)
    shape = math.sqrt(max(0.0, 1.0 + 2.0 * energy * float(momentum @ momentum) / gm**2))
    low, high = (-0.5 * gm / energy * (1.0 + sign * shape) for sign in (-1.0, 1.0))
    return bool(low > _LOWEST * radius and high < _HIGHEST * radius)


def orbit_normal(up: Vector3, momentum: Vector3) -> Vector3:
    """The normal (3,) of the plane through a place that is as steep as wanted.

    Of those, the one nearest to the plane in which it flies.

    Args:
      up: (3,) unit vector to the place. momentum: (3,) of the flight, of any length.
    """
    east = np.cross([0.0, 0.0, 1.0], up)
    length = float(np.linalg.norm(east))
    east = np.array([1.0, 0.0, 0.0]) if length < 1e-6 else east / length
    north = np.cross(up, east)
    sine = min(1.0, _COSINE / max(float(north[2]), 1e-9))
    cosine = math.sqrt(1.0 - sine**2)
    normals = [a * cosine * east + b * sine * north for a in (1, -1) for b in (1, -1)]
    return max(normals, key=lambda each: float(each @ momentum))
