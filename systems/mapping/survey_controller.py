"""`SurveyController`: goes to an orbit about a body without a map, and keeps it."""

from __future__ import annotations

import math

import numpy as np
from pydrake.systems.framework import BasicVector, LeafSystem

from proxops.systems.common import Matrix3, Values, Vector3, Vectors3, rotation_matrix
from proxops.systems.mapping.first_orbit import FEWEST, densest, middle_of, unseen
from proxops.systems.mapping.spheres import sphere
from proxops.systems.mapping.survey_filter import (
    GM,
    PLACE,
    STATES,
    VELOCITY,
    Around,
    Flown,
    corrected,
    first_seen,
    predicted,
)

# The orbit is at least this steep to the equator, as the cosine.
_COSINE = math.cos(math.radians(60.0))
# Beyond this many radii of its orbit it flies towards it; then it makes its orbit round.
_NEAR = 1.75
# It falls at least at this share of the speed of a round orbit.
_FALLING = 0.2
# Of a free orbit that is left alone, over the radius; and of one after a correction.
_LOWEST, HIGHEST = 0.85, 1.65
_LOW, _HIGH = 0.9, 1.5
# It passes the body at most at this share of the radius, and out of the plane that it should fly in
# by no more than this cosine.
_PASS, _FLAT = 1.3, 0.985
# It corrects what is more than this share of the speed of its orbit off, and this many deviations.
_BAND, _SURE, _SURE_AFAR = 0.02, 1.0, 4.0
# It waits until it knows its velocity to this share of its orbit's speed, or as well as it can.
_KNOWN = 0.15
# A free orbit whose lowest point is within so many radii of the keep-out sphere is left at once.
_GUARD = 1.3
# A part of the surface is seen if so many returns came from it.
_ENOUGH = 150
# The filter's mean and covariance, whether the body was seen, how long the orbit is kept, and how
# many returns each part of the surface had.
_SEEN = STATES + STATES**2
_KEPT = _SEEN + 1
_COUNTS = _KEPT + 1


class SurveyController(LeafSystem):
    """Orbits a body of which an ellipsoid, a mass and a spin are known, and nothing else.

    ```
    ranges (R), m ──────────►┌──────────────────┐─► force (3), N, K as believed
    body_attitude (4), R_KS ►│ SurveyController │─► state (6), m, m/s, K as believed; NaN: unseen
    given_force (3), N, K ──►└──────────────────┘─► deviations (2), m, m/s
    ```

    A Kalman filter in N (`survey_filter`) knows position, velocity and GM by where the frames show
    the body's middle. Far away the controller aims at the orbit's radius, in a plane that is steep
    to the equator; near it, at an orbit between two radii. It thrusts only if the velocity is off
    by more than is unsure: a free orbit costs nothing. K turns as believed. `body_attitude` is as
    measured against the stars; it may remain open: then S has K's axes. `deviations` are those of
    the distance from the middle and of its rate, along whatever axis is the least sure.
    `given_force` is what runtime assurance makes of the force; without it, it is that.
    """

    def __init__(
        self,
        around: Around,
        directions: Vectors3,
        mass: float,
        thrust: float,
        period: float,
        least_impulse: float = 0.0,
    ):
        """Takes what is known.

        Args:
          around: of the body and the orbit. directions: (R, 3) of the lidar's rays in S.
          mass, thrust: of the spacecraft in kg, and its limit per axis in N.
          period: control period in s.
          least_impulse: of a thruster in N s. Less is not asked for: it would not be given.
        """
        super().__init__()
        self.around, self._directions = around, directions
        self._mass, self._thrust, self._period = mass, thrust, period
        self._least = least_impulse / period
        self._ranges = self.DeclareVectorInputPort("ranges", len(directions))
        self._attitude = self.DeclareVectorInputPort("body_attitude", 4)
        self._given = self.DeclareVectorInputPort("given_force", 3)
        self._parts = sphere(2).vertices
        self.DeclareDiscreteState(np.zeros(_COUNTS + len(self._parts)))
        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._update)
        self._force_port = self.DeclareVectorOutputPort(
            "force",
            BasicVector(3),
            self._calc_force,
            {self.xd_ticket(), self.time_ticket()},
        )
        self.DeclareVectorOutputPort(
            "state", 6, self._calc_state, {self.xd_ticket(), self.time_ticket()}
        )
        self.DeclareVectorOutputPort("deviations", 2, self._calc_deviations, {self.xd_ticket()})

    def kept_for(self, context) -> float:
        """How long the orbit has been kept, in s."""
        self.ValidateContext(context)
        return float(context.get_discrete_state(0).value()[_KEPT])

    def seen(self, context) -> float:
        """Which share of the surface it has seen often, as far as it knows where it was."""
        self.ValidateContext(context)
        return float(np.mean(context.get_discrete_state(0).value()[_COUNTS:] >= _ENOUGH))

    def _calc_force(self, context, output):
        output.SetFromVector(self._force(context.get_time(), context.get_discrete_state(0).value()))

    def _calc_state(self, context, output):
        """As it was predicted for this control step, at whole multiples of the period."""
        values = context.get_discrete_state(0).value()
        if values[_SEEN] == 0.0:
            output.SetFromVector(np.full(6, np.nan))
            return
        mean, turn = values[:STATES], self.around.turn(context.get_time())
        place = mean[PLACE] @ turn
        turning = np.cross(self.around.angular_velocity(context.get_time()), place)
        output.SetFromVector(np.concatenate([place, mean[VELOCITY] @ turn - turning]))

    def _calc_deviations(self, context, output):
        values = context.get_discrete_state(0).value()
        if values[_SEEN] == 0.0:
            output.SetFromVector(np.full(2, np.nan))
            return
        mean, covariance = _flown(values)
        place, rate = (
            math.sqrt(max(0.0, float(np.linalg.eigvalsh(covariance[part, part])[-1])))
            for part in (PLACE, VELOCITY)
        )
        # Where the middle is seen beside its place, speed across is taken for a fall.
        beside = float(np.linalg.norm(mean[VELOCITY]) / np.linalg.norm(mean[PLACE]))
        output.SetFromVector([place, rate + beside * place])

    def _force(self, time: float, values: Values) -> Vector3:
        if values[_SEEN] == 0.0:
            return np.zeros(3)
        flown = _flown(values)
        off = wanted_velocity(flown.mean, self.around.radius) - flown.mean[VELOCITY]
        circular = math.sqrt(float(flown.mean[GM][0]) / self.around.radius)
        if flown.unsure > max(_KNOWN * circular, self.around.surest):
            return np.zeros(3)
        far = float(np.linalg.norm(flown.mean[PLACE])) > _NEAR * self.around.radius
        unsure = _BAND * circular + (_SURE_AFAR if far else _SURE) * flown.unsure
        if np.linalg.norm(off) < unsure and not self._is_low(flown):
            return np.zeros(3)
        force = self.around.turn(time).T @ (off * self._mass / self._period)
        force /= max(1.0, float(np.abs(force).max()) / self._thrust)
        return np.where(np.abs(force) < self._least, 0.0, force)

    def _is_low(self, flown: Flown) -> bool:
        """Whether it is near and falls towards the keep-out sphere."""
        place, velocity = flown.mean[PLACE], flown.mean[VELOCITY]
        low, _ = _ends(place, velocity, float(flown.mean[GM][0]))
        near = float(np.linalg.norm(place)) < _NEAR * self.around.radius
        return near and float(velocity @ place) < 0.0 and low < _GUARD * self.around.keep_out

    def _update(self, context, discrete):
        time, values = context.get_time(), context.get_discrete_state(0).value().copy()
        around, turn = self.around, self.around.turn(time)
        axes = turn
        if self._attitude.HasValue(context):
            axes = turn @ rotation_matrix(self._attitude.Eval(context))
        middle, rays = self._middle(turn, axes, self._ranges.Eval(context))
        given = self._given if self._given.HasValue(context) else self._force_port
        thrust = turn @ given.Eval(context) / self._mass
        flown = None if values[_SEEN] == 0.0 else _flown(values)
        if middle is not None:
            gap = axes @ unseen(self._directions, middle @ axes, around.longest) @ axes.T
            if flown is None:
                flown = first_seen(around, middle, gap)
            else:
                # So long what no ray shows is alike.
                alike = max(1.0, around.crossing(float(np.linalg.norm(middle))) / self._period)
                flown = corrected(flown, around, middle, len(rays), alike * gap)
        if flown is not None:
            near = np.linalg.norm(flown.mean[PLACE]) < _NEAR * around.radius
            values[_KEPT] += self._period if near or values[_KEPT] > 0.0 else 0.0
            ways = (flown.mean[PLACE] + rays) @ turn @ self._parts.T
            values[_COUNTS:] += np.bincount(ways.argmax(axis=1), minlength=len(self._parts))
            flown = predicted(flown, around, time, thrust, self._period)
            values[:_KEPT] = np.r_[flown.mean, flown.covariance.ravel(), 1.0]
        discrete.get_mutable_vector(0).SetFromVector(values)

    def _middle(
        self, turn: Matrix3, axes: Matrix3, ranges: Values
    ) -> tuple[Vector3 | None, Vectors3]:
        """The place (3,) from the body's middle, and rays (K, 3) that show it, in m in N.

        `turn` (3, 3) is R_NB, `axes` R_NS.
        """
        seen = np.flatnonzero(np.isfinite(ranges))
        if len(seen) < FEWEST:
            return None, np.zeros((0, 3))
        rays = (self._directions[seen] * ranges[seen, None]) @ axes.T
        rays = rays[densest(rays, self.around.longest)]
        if len(rays) < FEWEST:
            return None, np.zeros((0, 3))
        return middle_of(rays, self.around.semi_axes, turn), rays


def _flown(values: Values) -> Flown:
    return Flown(values[:STATES], values[STATES:_SEEN].reshape(STATES, STATES))


def wanted_velocity(state: Values, radius: float) -> Vector3:
    """The velocity (3,) in m/s in N that leads to, or keeps, an orbit of a radius.

    Far away: the radial speed stays, and across it is what makes the radius the orbit's lowest
    point. Near: that of a round orbit, and slowly to its radius.

    Args:
      state: (STATES,), see there. radius: in m.
    """
    place, velocity, gm = state[PLACE], state[VELOCITY], float(state[GM][0])
    distance = float(np.linalg.norm(place))
    up = place / distance
    low, high = _ends(place, velocity, gm)
    sound, rises = low > _LOWEST * radius, float(velocity @ up)
    far = distance > _NEAR * radius
    # The highest place of an orbit is changed at the lowest for the least, and the other way round.
    if not far and (sound if rises < 0.0 else high < HIGHEST * radius):
        return velocity
    momentum = np.cross(place, velocity)
    normal = orbit_normal(up, momentum)
    along = np.cross(normal, up)
    falling = -_FALLING * math.sqrt(gm / distance)
    if far:
        steep = abs(float(normal @ momentum)) > _FLAT * float(np.linalg.norm(momentum))
        if steep and sound and low < _PASS * radius and rises < falling:
            return velocity
        # It falls at least so fast: a flight from afar would take weeks.
        return _passing(distance, min(rises, falling), gm, radius) @ [up, along]
    if rises < 0.0:
        return _passing(distance, rises, gm, min(radius, 0.95 * distance)) @ [up, along]
    circular = math.sqrt(gm / distance)
    rise = (radius - distance) * math.sqrt(gm / radius**3)
    steady = circular * along + float(np.clip(rise, -0.2 * circular, 0.2 * circular)) * up
    for share in np.linspace(0.1, 0.9, 9):
        some = velocity + share * (steady - velocity)
        low, high = _ends(place, some, gm)
        if low > _LOW * radius and high < _HIGH * radius:
            return some
    return steady


def _passing(distance: float, rises: float, gm: float, low: float) -> Values:
    """Radial velocity (it stays) and the one across in m/s, with which it passes at a distance."""
    energy = rises**2 + 2.0 * gm * (1.0 / low - 1.0 / distance)
    return np.array([rises, math.sqrt(energy / ((distance / low) ** 2 - 1.0))])


def _ends(place: Vector3, velocity: Vector3, gm: float) -> tuple[float, float]:
    """The lowest and the highest distance in m of a free orbit."""
    # Number by number: it is asked a dozen times a step.
    (x, y, z), (u, v, w) = place.tolist(), velocity.tolist()
    energy = 0.5 * (u * u + v * v + w * w) - gm / math.hypot(x, y, z)
    square = (y * w - z * v) ** 2 + (z * u - x * w) ** 2 + (x * v - y * u) ** 2
    shape = math.sqrt(max(0.0, 1.0 + 2.0 * energy * square / gm**2))
    low = square / gm / (1.0 + shape)
    return low, math.inf if energy >= 0.0 else -0.5 * gm / energy * (1.0 + shape)


def orbit_normal(up: Vector3, momentum: Vector3) -> Vector3:
    """The normal (3,) of the plane through a place that is steep enough to the equator.

    Of those, the one nearest to the plane in which it flies.

    Args:
      up: (3,) unit vector to the place. momentum: (3,) of the flight, of any length.
    """
    east = np.cross([0.0, 0.0, 1.0], up)
    length = float(np.linalg.norm(east))
    east = np.array([1.0, 0.0, 0.0]) if length < 1e-6 else east / length
    north = np.cross(up, east)
    most = min(1.0, _COSINE / max(float(north[2]), 1e-9))
    along, across = float(momentum @ east), float(momentum @ north)
    sine = across / max(math.hypot(along, across), 1e-300)
    sine = min(max(sine, -most), most)
    return math.copysign(math.sqrt(1.0 - sine**2), along) * east + sine * north
