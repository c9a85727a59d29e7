"""`FlightMonitor`: the events of a flight: arrival, keep-out violation, collision."""

from __future__ import annotations

import numpy as np
from pydrake.systems.framework import (
    BasicVector,
    EventStatus,
    LeafSystem,
    UnrestrictedUpdateEvent,
    WitnessFunctionDirection,
)
from scipy.interpolate import CubicHermiteSpline

from proxops.systems.common import check_not_negative, check_positive
from proxops.systems.gravity import GravityField
from proxops.systems.shapes import blocks_segment, clearances, ray_caster

# A time that never comes. It is finite, so that a witness function may be interpolated.
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

    Witness functions find, to a fraction of a millisecond, when the spacecraft

    * enters or leaves the goal region (within `radius` and `speed` of the target),
    * goes deeper than `tolerance` into the keep-out ellipsoid: the violation is counted,
    * enters the true mesh: the flight ends,
    * has spent `dwell` in the goal region without a break: the flight ends.

    A witness function sees only the ends of an integration step. The path in between may cut a
    corner of the mesh or dip into the ellipsoid. So the path over each control period is checked as
    well: its chord is cast against the mesh, and a cubic through its ends is checked for depth.
    """

    def __init__(
        self,
        field: GravityField,
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
        # State, time and violations at the last control step.
        self._last_index = self.DeclareDiscreteState(BasicVector(np.full(8, np.nan)))
        self.DeclareStateOutputPort(name="outcome", state_index=self._outcome_index)
        self.DeclareInitializationDiscreteUpdateEvent(update=self._initialise)
        self.DeclarePeriodicDiscreteUpdateEvent(
            period_sec=period, offset_sec=period, update=self._check_path
        )
        falling = WitnessFunctionDirection.kPositiveThenNonPositive
        rising = WitnessFunctionDirection.kNegativeThenNonNegative
        self._witnesses = [
            self._witness("enters the goal region", falling, self._calc_outside_goal, self._enter),
            self._witness("leaves the goal region", rising, self._calc_outside_goal, self._leave),
            self._witness("dwell is over", falling, self._calc_dwell_left, self._finish),
            self._witness("keep-out violation", falling, self._calc_clearance, self._violate),
            self._witness("collision", falling, self._calc_outside_body, self._collide),
        ]

    def _witness(self, description, direction, calc, update):
        def callback(system, context, event, state):
            return update(context, state)

        event = UnrestrictedUpdateEvent(system_callback=callback)
        return self.MakeWitnessFunction(description, direction, calc, event)

    def DoGetWitnessFunctions(self, context):  # noqa: N802
        """Returns all witness functions."""
        return self._witnesses

    def _calc_outside_goal(self, context) -> float:
        error = self._state_port.Eval(context) - self._target_port.Eval(context)
        distance = float(np.linalg.norm(error[:3])) / self._radius
        return max(distance, float(np.linalg.norm(error[3:])) / self._speed) - 1.0

    def _calc_dwell_left(self, context) -> float:
        entered = context.get_discrete_state(self._outcome_index).GetAtIndex(ENTERED_GOAL)
        return entered + self._dwell - context.get_time()

    def _calc_clearance(self, context) -> float:
        position = self._state_port.Eval(context)[:3]
        return float(clearances(self._keep_out, position[None])[0]) + self._tolerance

    def _calc_outside_body(self, context) -> float:
        position = self._state_port.Eval(context)[:3]
        if np.sum((position / self._around) ** 2) >= 1.0:
            return 1.0
        return -1.0 if self._field.evaluate(position[None]).inside[0] else 1.0

    def _initialise(self, context, discrete_state):
        outcome = discrete_state.get_mutable_value(self._outcome_index)
        # A flight that continues in the goal region, from a cloned Context, entered it before.
        entered = min(outcome[ENTERED_GOAL], context.get_time())
        outcome[ENTERED_GOAL] = entered if self._calc_outside_goal(context) <= 0.0 else NEVER
        self._mark(context, discrete_state, outcome[VIOLATIONS])

    def _mark(self, context, discrete_state, violations: float) -> None:
        now = np.concatenate([self._state_port.Eval(context), [context.get_time(), violations]])
        discrete_state.set_value(self._last_index, now)

    def _check_path(self, context, discrete_state):
        last = context.get_discrete_state(self._last_index).value()
        state = self._state_port.Eval(context)
        outcome = discrete_state.get_mutable_value(self._outcome_index)
        duration = context.get_time() - last[6]
        # Nothing has been flown where a flight is taken up again at a control step.
        flown = duration > 0.0
        if flown and outcome[VIOLATIONS] == last[7] and self._dips(last[:6], state, duration):
            outcome[VIOLATIONS] += 1.0
        self._mark(context, discrete_state, outcome[VIOLATIONS])
        start, end = last[:3], state[:3]
        if blocks_segment(self._around, start, end) and self._hits_body(start, end):
            outcome[COLLIDED] = 1.0
            return EventStatus.ReachedTermination(self, "collision: a corner of the body was cut")
        return EventStatus.Succeeded()

    def _dips(self, start: np.ndarray, end: np.ndarray, duration: float) -> bool:
        """Whether the path goes too deep between two states (6,) that are not too deep.

        The path is the cubic through both states' positions and velocities. It lies in the convex
        hull of its Bézier points, so far from the ellipsoid it need not be evaluated.
        """
        third = duration / 3.0
        hull = np.stack([start[:3] + third * start[3:], end[:3] - third * end[3:], end[:3]])
        reach = np.linalg.norm(hull - start[:3], axis=1).max()
        if clearances(self._keep_out, start[None, :3])[0] + self._tolerance > reach:
            return False
        states, times = np.stack([start, end]), np.array([0.0, duration])
        path = CubicHermiteSpline(times, states[:, :3], states[:, 3:])
        clearance = clearances(self._keep_out, path(np.linspace(0.0, duration, 11)))
        clearance += self._tolerance
        return bool(clearance[0] > 0.0 and clearance[-1] > 0.0 and clearance.min() <= 0.0)

    def _hits_body(self, start: np.ndarray, end: np.ndarray) -> bool:
        length = float(np.linalg.norm(end - start))
        if length == 0.0:
            return False
        direction = (end - start)[None] / length
        return bool(self._caster.distances(start[None], direction)[0] <= length)

    def _enter(self, context, state):
        self._outcome(state)[ENTERED_GOAL] = context.get_time()
        return EventStatus.Succeeded()

    def _leave(self, context, state):
        self._outcome(state)[ENTERED_GOAL] = NEVER
        return EventStatus.Succeeded()

    def _violate(self, context, state):
        self._outcome(state)[VIOLATIONS] += 1.0
        return EventStatus.Succeeded()

    def _finish(self, context, state):
        self._outcome(state)[FINISHED] = 1.0
        return EventStatus.ReachedTermination(self, "the dwell in the goal region is over")

    def _collide(self, context, state):
        self._outcome(state)[COLLIDED] = 1.0
        return EventStatus.ReachedTermination(self, "collision with the body")

    def _outcome(self, state) -> np.ndarray:
        return state.get_mutable_discrete_state(self._outcome_index).get_mutable_value()
