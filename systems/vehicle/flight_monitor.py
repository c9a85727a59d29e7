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

from proxops.systems.common import check_positive
from proxops.systems.vehicle.flight_events import (
    COLLIDED,
    ENTERED_GOAL,
    FINISHED,
    NEVER,
    FlightEvents,
    FlownPath,
)


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

    * when the spacecraft entered or left the goal region of `FlightEvents`: where the thrust does
      not change within the period, to a millisecond,
    * a violation for each time that it goes too deep into the keep-out ellipsoid,
    * a collision, if the chord of the path meets the true mesh: the flight ends,
    * whether it has spent the dwell in the goal region without a break: the flight ends at the
      first control step at which this is so.

    When the spacecraft enters the mesh and stays there, a witness function finds it to a fraction
    of a millisecond, and the flight ends there. Arrival has no witness function: Drake integrates
    some 200 times to find the zero of one.
    """

    def __init__(self, events: FlightEvents, period: float = 10.0):
        """Takes the true body with what counts as arrival and violation, and the control period.

        Args:
          events: knows the true body, the keep-out ellipsoid and the goal region.
          period: control period in s.
        """
        super().__init__()
        check_positive("FlightMonitor", period=period)
        self._events = events
        self._state_port = self.DeclareVectorInputPort("state", 6)
        self._target_port = self.DeclareVectorInputPort("target", 6)
        self._outcome_index = self.DeclareDiscreteState(BasicVector([NEVER, 0.0, 0.0, 0.0]))
        # State, target and time at the last control step, when the outcome was as above.
        self._last_index = self.DeclareDiscreteState(BasicVector(np.full(13, np.nan)))
        self.DeclareVectorOutputPort(
            "outcome", 4, lambda context, output: output.SetFromVector(self._outcome(context))
        )
        self.DeclareInitializationDiscreteUpdateEvent(update=self._initialise)
        self.DeclarePeriodicDiscreteUpdateEvent(period, period, self._check)

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
        return -1.0 if self._events.is_in_body(self._state_port.Eval(context)[:3]) else 1.0

    def _collide(self, state):
        outcome = state.get_mutable_discrete_state(self._outcome_index).get_mutable_value()
        outcome[COLLIDED] = 1.0
        return EventStatus.ReachedTermination(self, "collision with the body")

    def _initialise(self, context, discrete_state):
        # A flight that continues in the goal region, from a cloned Context, entered it before.
        outcome = self._outcome(context)
        entered = min(outcome[ENTERED_GOAL], context.get_time())
        state, target = self._state_port.Eval(context), self._target_port.Eval(context)
        outcome[ENTERED_GOAL] = entered if self._events.is_in_region(state, target) else NEVER
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
        states = np.stack([last[:6], self._state_port.Eval(context)])
        targets = np.stack([last[6:12], self._target_port.Eval(context)])
        return self._events.after(outcome, FlownPath(states, targets, last[12], duration))
