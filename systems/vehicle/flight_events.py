"""`FlightEvents`: what a path does to the outcome of a flight: arrival, violation, collision."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from proxops.systems.common import (
    FAR,
    LONG,
    State,
    States,
    Values,
    Vector3,
    Vectors3,
    check_not_negative,
    check_positive,
    checked_semi_axes,
    config,
    kernel,
    number,
)
from proxops.systems.gravity import BodyField, Moon
from proxops.systems.rotation import Spin
from proxops.systems.shapes import (
    blocks_segment,
    clearances,
    ellipsoidal_norms,
    ray_caster,
    squared_norm,
)

# A time that never comes.
NEVER = 1e15
# Indices of the outcome vector.
ENTERED_GOAL, VIOLATIONS, COLLIDED, FINISHED = range(4)
# The keep-out ellipsoid counts as violated from this depth in m on, or from this share of its
# longest semi-axis, whichever is less.
_DEPTH, _SHARE = 1.0, 1e-5


def hermite_curve(times: Values, states: States) -> Any:
    """The cubic spline of positions (3,) in m by time in s through states: `CubicHermiteSpline`."""
    from scipy.interpolate import CubicHermiteSpline  # Slow to import.

    return CubicHermiteSpline(times, states[:, :3], states[:, 3:])


def containing_ellipsoid(semi_axes: Vector3, vertices: Vectors3) -> Vector3:
    """Semi-axes (3,) of an ellipsoid that contains a mesh: the given ones, or all longer alike.

    Args:
      semi_axes: (3,) of an ellipsoid about the origin. vertices: (N, 3) of the mesh, in one unit.
    """
    farthest = float(ellipsoidal_norms(semi_axes, vertices).max())
    # The margin is for rounding.
    return semi_axes if farthest <= 1.0 else (1.0 + 1e-9) * farthest * semi_axes


@config
class ArrivalConfig:
    """When a flight counts as arrived.

    Arrival is the start of the first `dwell_s` in which the spacecraft always stays within
    `radius_m` of the goal and is slower than `speed_m_s`.
    """

    radius_m: float = number(1.0e3, at_least=1e-6, at_most=FAR, unit="m")
    speed_m_s: float = number(1.0, at_least=1e-9, at_most=1e5, unit="m/s")
    dwell_s: float = number(600.0, at_least=1e-2, at_most=LONG, unit="s")
    # A flight succeeds only if it arrives by this time. It ends at most `dwell_s` later.
    deadline_s: float = number(7200.0, at_least=1e-2, at_most=LONG, unit="s")


class _Regions(NamedTuple):
    """Where something can happen."""

    around: Vector3
    """Semi-axes (3,) in m of an ellipsoid that contains the body and the keep-out ellipsoid."""
    radius: float
    speed: float
    """Size of the goal region in m and m/s."""


class FlownPath(NamedTuple):
    """A path that is flown: the cubic through the positions and velocities at its ends."""

    states: np.ndarray
    """(2, 6) in m and m/s."""
    targets: np.ndarray
    """(2, 6) at the same times."""
    time: float
    """Of its start, in s."""
    span: float
    """How long it takes, in s: more than 0."""


class FlightEvents:
    """Follows the outcome of a flight over paths.

    An outcome (4,) is the time in s of the last entry into the goal region (NEVER outside it), the
    number of keep-out violations, 1 after a collision, and 1 after the dwell in the goal region. A
    violation is a metre deep or more; at bodies of less than some 100 km, less deep in proportion.
    """

    def __init__(
        self,
        field: BodyField,
        keep_out_semi_axes: np.ndarray,
        radius: float,
        speed: float,
        dwell: float,
        moons: Sequence[Moon] = (),
        spin: Spin = 0.0,
    ):
        """Takes the true body and what counts as arrival and as violation.

        Args:
          field: the true body's field in K, which knows what is inside the body.
          keep_out_semi_axes: (3,) in m, of the keep-out ellipsoid. The true mesh may stick out.
          radius, speed: size of the goal region in m and m/s.
          dwell: time in s in the goal region after which the flight ends.
          moons: the body's. To enter the ball about one counts as a violation, to meet its surface
            as a collision, both by the straight way from one control step to the next.
          spin: of the body, with which moons go round in K.
        """
        check_positive("a flight", radius=radius, speed=speed)
        check_not_negative("a flight", dwell=dwell)
        self._field = field
        self._keep_out = checked_semi_axes("the keep-out ellipsoid", keep_out_semi_axes)
        self._tolerance = min(_DEPTH, _SHARE * float(self._keep_out.max()))
        self._around = containing_ellipsoid(self._keep_out, field.shape.vertices)
        self._radius, self._speed, self._dwell = radius, speed, dwell
        self._regions = _Regions(self._around, float(radius), float(speed))
        self._caster = ray_caster(field.shape)
        self._moons, self._spin = moons, spin
        # Nearer to the body than this, in m, no moon's ball ever is.
        nearest = [m.semi_major_axis_m * (1.0 - m.eccentricity) - m.radius_m
                   for m in (moon.config for moon in moons)]  # fmt: skip
        self._moonless = max(0.0, min(nearest, default=math.inf))

    def is_in_body(self, position: Vector3) -> bool:
        """Whether a position (3,) in m lies inside the true mesh."""
        x, y, z = (position / self._around).tolist()
        if x * x + y * y + z * z >= 1.0:
            return False
        return bool(self._field.evaluate(position[None]).inside[0])

    def is_in_region(self, state: State, target: State) -> bool:
        """Whether a state (6,) lies in the goal region of a target (6,)."""
        return self._level(state - target) <= 1.0

    def after(self, outcome: np.ndarray, path: FlownPath) -> np.ndarray:
        """The outcome (4,) after a path, from that at its start."""
        outcome = outcome.copy()
        start, end = path.states
        outside = outcome[ENTERED_GOAL] >= NEVER
        one = start[None], end[None], path.targets[1:]
        if outside and self.nothing_happens(*one, path.span)[0]:
            return outcome
        self._follow(outcome, path)
        if self._violates(start, end, path.span):
            outcome[VIOLATIONS] += 1.0
        blocked = blocks_segment(self._around, start[:3], end[:3])
        if blocked and self._hits_body(start[:3], end[:3]):
            outcome[COLLIDED] = 1.0
        for moon in self._moons:
            self._pass(outcome, moon, path)
        return outcome

    def _pass(self, outcome: np.ndarray, moon: Moon, path: FlownPath) -> None:
        """Counts in an outcome, in place, what a path does at a moon."""
        start, end = path.states[:, :3]
        way = start, end, (path.time, path.time + path.span), self._spin
        radius = moon.config.radius_m
        first, nearest = moon.distance(*way)
        if nearest < radius:
            outcome[VIOLATIONS] += float(first >= radius)
            outcome[COLLIDED] = max(outcome[COLLIDED], float(moon.hits(*way)))

    def nothing_happens(self, starts: States, ends: States, targets: States, span: float) -> Values:
        """Which of many paths (N,), bool, surely leave an outcome outside the goal region as it is.

        Such a path ends outside the goal region, far from the ellipsoid, and is nearer to the body
        than any moon. Of others it says False.

        Args:
          starts, ends: (N, 6) states in m and m/s. targets: (N, 6), at the end.
          span: how long the paths take, in s.
        """
        quiet = np.empty(len(starts), dtype=bool)
        _find_uneventful(starts, ends, targets, span, self._regions, quiet)
        if self._moons:
            for places in (starts[:, :3], ends[:, :3]):
                quiet &= np.einsum("ni,ni->n", places, places) < self._moonless**2
        return quiet

    def _level(self, error: np.ndarray) -> float:
        """How far away from the target (6,) the spacecraft is: the goal region is up to 1."""
        distance = math.hypot(*error[:3]) / self._radius
        return max(distance, math.hypot(*error[3:]) / self._speed)

    def _follow(self, outcome: np.ndarray, path: FlownPath) -> None:
        """Follows entry into the goal region, exit and dwell over a path, in the outcome (4,)."""
        was = outcome[ENTERED_GOAL] < NEVER
        ends_inside = self.is_in_region(path.states[1], path.targets[1])
        until = path.time + path.span
        if was != ends_inside:
            crossed = path.time + self._crossing(path)
            if was:
                until = crossed
            else:
                outcome[ENTERED_GOAL] = crossed
        if (was or ends_inside) and until - outcome[ENTERED_GOAL] >= self._dwell:
            outcome[FINISHED] = 1.0
        elif not ends_inside:
            outcome[ENTERED_GOAL] = NEVER

    def _crossing(self, path: FlownPath) -> float:
        """How long, in s, after its start a path crosses the edge of the goal region."""
        states, targets, _, span = path
        from scipy.optimize import brentq  # Slow to import; few flights cross it in most steps.

        curve = hermite_curve(np.array([0.0, span]), states)
        rate = curve.derivative()

        def level(time: float) -> float:
            target = targets[0] + time / span * (targets[1] - targets[0])
            return self._level(np.concatenate([curve(time), rate(time)]) - target) - 1.0

        # Rounding may put a state on the edge on either side of it.
        if not level(0.0) * level(span) < 0.0:
            return span
        return brentq(level, 0.0, span)  # pyright: ignore[reportReturnType]  (without full_output)

    def _violates(self, start: np.ndarray, end: np.ndarray, duration: float) -> bool:
        """Whether the path between two states (6,) goes too deep, after it was not too deep.

        It lies in the convex hull of its Bézier points, so far from the ellipsoid it need not be
        evaluated.
        """
        ends = clearances(self._keep_out, np.stack([start[:3], end[:3]])) + self._tolerance
        if ends[0] <= 0.0 or ends[1] <= 0.0:
            return bool(ends[0] > 0.0)
        third = duration / 3.0
        left, right = start[:3] + third * start[3:], end[:3] - third * end[3:]
        others = np.stack([left, right, end[:3]])
        if ends[0] > np.linalg.norm(others - start[:3], axis=1).max():
            return False
        states, times = np.stack([start, end]), np.array([0.0, duration])
        path = hermite_curve(times, states)
        along = clearances(self._keep_out, path(np.linspace(0.0, duration, 11)[1:-1]))
        return bool(along.min() + self._tolerance <= 0.0)

    def _hits_body(self, start: np.ndarray, end: np.ndarray) -> bool:
        length = float(np.linalg.norm(end - start))
        if length == 0.0:
            return False
        direction = (end - start)[None] / length
        return bool(self._caster.distances(start[None], direction)[0] <= length)


@kernel(error_model="numpy", forceinline=True)
def _uneventful(start, end, target, span, regions):
    """Whether a path between states (6,) ends outside the goal region, far from the ellipsoid."""
    around, radius, speed = regions
    position = velocity = left = right = straight = 0.0
    third = span / 3.0
    for i in range(3):
        position += (end[i] - target[i]) ** 2
        velocity += (end[3 + i] - target[3 + i]) ** 2
        # From the start to the other Bézier points, in whose convex hull the path lies.
        left += (third * start[3 + i]) ** 2
        right += (end[i] - third * end[3 + i] - start[i]) ** 2
        straight += (end[i] - start[i]) ** 2
    # The nearest point of an ellipsoid is at least this far away.
    norm = math.sqrt(squared_norm(around, start))
    free = (norm - 1.0) * min(around[0], around[1], around[2])
    away = math.sqrt(position) > radius or math.sqrt(velocity) > speed
    return away and free > math.sqrt(max(left, right, straight))


@kernel(error_model="numpy")
def _find_uneventful(starts, ends, targets, span, regions, quiet):
    """Fills ``quiet`` (N,): see `FlightEvents.nothing_happens`."""
    for n in range(len(starts)):
        start, end, target = starts[n], ends[n], targets[n]
        quiet[n] = _uneventful(start, end, target, span, regions)
