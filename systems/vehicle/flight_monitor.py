"""`FlightMonitor`: the events of a flight: arrival, keep-out violation, collision."""

from __future__ import annotations

import math

import numpy as np
from pydrake.systems.framework import (
    BasicVector,
    EventStatus,
    LeafSystem,
    UnrestrictedUpdateEvent,
    WitnessFunctionDirection,
)
from scipy.interpolate import CubicHermiteSpline
from scipy.optimize import brentq

from proxops.systems.common import check_not_negative, check_positive
from proxops.systems.gravity import BodyField
from proxops.systems.shapes import blocks_segment, clearances, ray_caster

# A time that never comes.
NEVER = 1e15
# Indices of the outcome vector.
ENTERED_GOAL, VIOLATIONS, COLLIDED, FINISHED = range(4)


def containing_ellipsoid(semi_axes: np.ndarray, vertices: np.ndarray) -> np.ndarray:
    """Semi-axes (3,) of an ellipsoid that contains a mesh: the given ones, or all longer alike.

    Args:
      semi_axes: (3,) of an ellipsoid about the origin. vertices: (N, 3) of the mesh, in one unit.
    """
    level = float(np.sqrt(np.sum((vertices / semi_axes) ** 2, axis=1).max()))
    # The margin is for rounding.
    return semi_axes if level <= 1.0 else (1.0 + 1e-9) * level * semi_axes


class FlightMonitor(LeafSystem):
    """Detects arrival, keep-out violations and collision, and ends the flight.

    ```
    state (6) ───►┌───────────────┐
    target (6) ──►│ FlightMonitor ├─► outcome (4): time in s of the last entry into the goal region
                  └───────────────┘   (NEVER outside it), number of keep-out violations,
                                      1 after a collision, 1 after the dwell in the goal region
    ```

    The path since the last control step is the cubic through both states' positions and velocities.
    From it, `outcome` has at any time

    * when the spacecraft entered or left the goal region (within `radius` and `speed` of the
      target): where the thrust does not change within the period, to a millisecond,
    * a violation for each time that it goes deeper than `tolerance` into the keep-out ellipsoid,
    * a collision, if the chord of the path meets the true mesh: the flight ends,
    * whether it has spent `dwell` in the goal region without a break: the flight ends at the first
      control step at which this is so.

    When the spacecraft enters the mesh and stays there, a witness function finds it to a fraction
    of a millisecond, and the flight ends there. Arrival has no witness function: Drake integrates
    some 200 times to find the zero of one.
    """

    def __init__(
        self,
        field: BodyField,
        keep_out_semi_axes: np.ndarray,
        radius: float,
        speed: float,
        dwell: float,
        tolerance: float = 1.0,
        period: float = 10.0,
    ):
        """Takes the true body and what counts as arrival and as violation.

        Args:
          field: the true body's field in K, which knows what is inside the body.
          keep_out_semi_axes: (3,) in m, of the keep-out ellipsoid. The true mesh may stick out.
          radius, speed: size of the goal region in m and m/s.
          dwell: time in s in the goal region after which the flight ends.
          tolerance: depth in m from which the keep-out ellipsoid counts as violated.
          period: control period in s.

        Raises:
          InputError: one of them is not positive, or the dwell or the tolerance is negative.
        """
        super().__init__()
        axes = dict(zip(("x", "y", "z"), keep_out_semi_axes, strict=True))
        check_positive("FlightMonitor", radius=radius, speed=speed, period=period)
        check_positive("the keep-out ellipsoid", **axes)
        check_not_negative("FlightMonitor", dwell=dwell, tolerance=tolerance)
        self._field, self._keep_out = field, np.asarray(keep_out_semi_axes, dtype=np.float64)
        self._around = containing_ellipsoid(self._keep_out, field.shape.vertices)
        self._radius, self._speed, self._dwell = radius, speed, dwell
        self._tolerance = tolerance
        self._caster = ray_caster(field.shape)
        self._state_port = self.DeclareVectorInputPort(name="state", size=6)
        self._target_port = self.DeclareVectorInputPort(name="target", size=6)
        self._outcome_index = self.DeclareDiscreteState(BasicVector([NEVER, 0.0, 0.0, 0.0]))
        # State, target and time at the last control step, when the outcome was as above.
        self._last_index = self.DeclareDiscreteState(BasicVector(np.full(13, np.nan)))
        self.DeclareVectorOutputPort(
            name="outcome",
            size=4,
            calc=lambda context, output: output.SetFromVector(self._outcome(context)),
        )
        self.DeclareInitializationDiscreteUpdateEvent(update=self._initialise)
        self.DeclarePeriodicDiscreteUpdateEvent(
            period_sec=period, offset_sec=period, update=self._check
        )

        def collide(system, context, event, state):
            return self._collide(state)

        self._witness = self.MakeWitnessFunction(
            "collision",
            WitnessFunctionDirection.kPositiveThenNonPositive,
            self._calc_outside_body,
            UnrestrictedUpdateEvent(system_callback=collide),
        )

    def DoGetWitnessFunctions(self, context):  # noqa: N802
        """Returns the witness function of a collision."""
        return [self._witness]

    def _calc_outside_body(self, context) -> float:
        position = self._state_port.Eval(context)[:3]
        if np.sum((position / self._around) ** 2) >= 1.0:
            return 1.0
        return -1.0 if self._field.evaluate(position[None]).inside[0] else 1.0

    def _collide(self, state):
        outcome = state.get_mutable_discrete_state(self._outcome_index).get_mutable_value()
        outcome[COLLIDED] = 1.0
        return EventStatus.ReachedTermination(self, "collision with the body")

    def _initialise(self, context, discrete_state):
        # A flight that continues in the goal region, from a cloned Context, entered it before.
        outcome = self._outcome(context)
        entered = min(outcome[ENTERED_GOAL], context.get_time())
        state, target = self._state_port.Eval(context), self._target_port.Eval(context)
        outcome[ENTERED_GOAL] = entered if self._level(state - target) <= 1.0 else NEVER
        self._keep(context, discrete_state, outcome)

    def _check(self, context, discrete_state):
        outcome = self._outcome(context)
        self._keep(context, discrete_state, outcome)
        if outcome[COLLIDED]:
            return EventStatus.ReachedTermination(self, "collision: a corner of the body was cut")
        if outcome[FINISHED]:
            return EventStatus.ReachedTermination(self, "the dwell in the goal region is over")
        return EventStatus.Succeeded()

    def _keep(self, context, discrete_state, outcome: np.ndarray) -> None:
        """Keeps the outcome, and the place from which the path goes on."""
        parts = self._state_port.Eval(context), self._target_port.Eval(context)
        now = np.concatenate([*parts, [context.get_time()]])
        discrete_state.set_value(self._outcome_index, outcome)
        discrete_state.set_value(self._last_index, now)

    def _outcome(self, context) -> np.ndarray:
        """The outcome (4,) now: that of the last control step and of the path since then."""
        outcome = context.get_discrete_state(self._outcome_index).value().copy()
        last = context.get_discrete_state(self._last_index).value()
        duration = context.get_time() - last[12]
        if not duration > 0.0:  # Nothing was flown, or the flight has not begun (NaN).
            return outcome
        start, state = last[:6], self._state_port.Eval(context)
        targets = np.stack([last[6:12], self._target_port.Eval(context)])
        self._follow(outcome, np.stack([start, state]), targets, last[12], duration)
        if self._violates(start, state, duration):
            outcome[VIOLATIONS] += 1.0
        blocked = blocks_segment(self._around, start[:3], state[:3])
        if blocked and self._hits_body(start[:3], state[:3]):
            outcome[COLLIDED] = 1.0
        return outcome

    def _level(self, error: np.ndarray) -> float:
        """How far away from the target (6,) the spacecraft is: the goal region is up to 1."""
        distance = math.hypot(*error[:3]) / self._radius
        return max(distance, math.hypot(*error[3:]) / self._speed)

    def _follow(
        self,
        outcome: np.ndarray,
        states: np.ndarray,
        targets: np.ndarray,
        time: float,
        span: float,
    ) -> None:
        """Follows entry into the goal region, exit and dwell over a path, in the outcome.

        Args:
          outcome: (4,) at the path's start.
          states, targets: (2, 6) at its ends.
          time, span: in s, of its start, and how long it takes.
        """
        was = outcome[ENTERED_GOAL] < NEVER
        ends_inside = self._level(states[1] - targets[1]) <= 1.0
        until = time + span
        if was != ends_inside:
            crossed = time + self._crossing(states, targets, span)
            if was:
                until = crossed
            else:
                outcome[ENTERED_GOAL] = crossed
        if (was or ends_inside) and until - outcome[ENTERED_GOAL] >= self._dwell:
            outcome[FINISHED] = 1.0
        elif not ends_inside:
            outcome[ENTERED_GOAL] = NEVER

    def _crossing(self, states: np.ndarray, targets: np.ndarray, span: float) -> float:
        """When, in s, a path from state to state (2, 6) crosses the edge of the goal region."""
        path = CubicHermiteSpline([0.0, span], states[:, :3], states[:, 3:])
        rate = path.derivative()

        def level(time: float) -> float:
            target = targets[0] + time / span * (targets[1] - targets[0])
            return self._level(np.concatenate([path(time), rate(time)]) - target) - 1.0

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
        hull = np.stack([start[:3] + third * start[3:], end[:3] - third * end[3:], end[:3]])
        if ends[0] > np.linalg.norm(hull - start[:3], axis=1).max():
            return False
        states, times = np.stack([start, end]), np.array([0.0, duration])
        path = CubicHermiteSpline(times, states[:, :3], states[:, 3:])
        along = clearances(self._keep_out, path(np.linspace(0.0, duration, 11)[1:-1]))
        return bool(along.min() + self._tolerance <= 0.0)

    def _hits_body(self, start: np.ndarray, end: np.ndarray) -> bool:
        length = float(np.linalg.norm(end - start))
        if length == 0.0:
            return False
        direction = (end - start)[None] / length
        return bool(self._caster.distances(start[None], direction)[0] <= length)
