"""`ModelPredictiveController`: plans at every step and commands the plan's first force."""

from __future__ import annotations

import dataclasses
import math
import time

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.solvers import SolutionResult
from pydrake.systems.framework import LeafSystem

from proxops.systems.common import (
    FAR,
    LONG,
    InputError,
    LegendEntry,
    LoggedPort,
    SolverFailure,
    check_positive,
    check_type,
    config,
    number,
    one_of,
)
from proxops.systems.expert.fallback_plans import braking, continued_plan
from proxops.systems.expert.plan import Plan, PlanProgram, PlanReason, PlanStatus, empty_plan
from proxops.systems.expert.plan_memory import memory_size, packed, unpacked
from proxops.systems.expert.weighted_program import WeightedCostConfig
from proxops.systems.vehicle import moved_by, predicted_state, unexplained_acceleration

# Most linearisations about an old plan, which end when the first force changes by less than this
# share of the thrust limit. One or two are usual.
_MOST_FOR_OLD_PLAN, _SETTLED = 5, 1e-2
_MOST_ITERATIONS = 1000
# The reasons in the log for the solver's results. All others are SOLVER_ERROR.
_FAILURES = {
    SolutionResult.kInvalidInput: PlanReason.INPUT_NOT_FINITE,
    SolutionResult.kInfeasibleConstraints: PlanReason.SOLVER_INFEASIBLE,
    SolutionResult.kInfeasibleOrUnbounded: PlanReason.SOLVER_INFEASIBLE,
    SolutionResult.kIterationLimit: PlanReason.SOLVER_ITERATION_LIMIT,
}


# The costs that the MPC may minimise.
COSTS = ("time_and_fuel", "weighted")


@config
class MpcConfig:
    """The MPC; see `proxops.systems.ModelPredictiveController`."""

    # Number of intervals of a plan; the force is constant over each. Limits hold at their ends:
    # with few intervals a path may cut through the body between them.
    intervals: int = number(16, at_least=2, at_most=500)
    # Ratio of the length of a plan's last interval to the length of its first.
    interval_growth: float = number(4.0, at_least=1e-3, at_most=1e3)
    # This acceleration sets the price of time. Without gravity and with fuel_weight 0, a transit
    # takes as long as if the spacecraft accelerated by it halfway and then braked by it.
    nominal_acceleration_m_s2: float = number(0.03, at_least=1e-9, at_most=1e6, unit="m/s^2")
    # Weight of the thrust's 1-norm (fuel) against its square in the cost; both are relative to the
    # limit. 0 gives the smoothest thrust, 1 gives nearly the least fuel.
    fuel_weight: float = number(0.8, at_least=0.0, at_most=1e6)
    # No plan is shorter than this time. Below twice the control period the MPC is not stable at the
    # goal.
    min_horizon_s: float = number(300.0, at_least=1e-2, at_most=LONG, unit="s")
    # For its plans the MPC adds this length to every semi-axis of the keep-out ellipsoid. It does
    # not reach a goal that lies within.
    keep_out_margin_m: float = number(3.0e3, at_least=0.0, at_most=FAR, unit="m")
    # If true, the MPC computes gravity from a point mass, not from the polyhedron.
    point_mass: bool = False
    # If above 0, the MPC estimates the disturbing acceleration, with this gain at each step, and
    # plans with it.
    estimator_gain: float = number(0.0, at_least=0.0, at_most=1.0)
    # Number of linearisations at a step that has no recent plan to start from. A step that
    # continues the plan of the step before needs one.
    cold_iterations: int = number(10, at_least=1, at_most=1000)
    # The cost that a plan minimises: `time_and_fuel`, set by the keys above, or `weighted`, the
    # paper's cost, set by the keys under `weighted`.
    cost: str = one_of("time_and_fuel", COSTS)
    weighted: WeightedCostConfig = dataclasses.field(default_factory=WeightedCostConfig)
    # Simulated time that the MPC takes to solve, at most control_period_s. A command acts this long
    # after the state from which it was computed; the MPC predicts the state at that time and plans
    # from there.
    solve_delay_s: float = number(0.0, at_least=0.0, at_most=1e6, unit="s")


class ModelPredictiveController(LeafSystem):
    """Plans from the state to the target at every step and commands the plan's first force.

    ```
    state (6) ──────►┌───────────────────────────┐
    target (6) ─────►│ ModelPredictiveController ├─► force (3), N
    enable (1) ─────►│                           ├─► plan (abstract Plan)
                     │                           ├─► record (3): wall time in s, Plan.status,
                     │                           │               Plan.reason
                     └───────────────────────────┴─► planned_force (3), N
    ```

    All vectors are in K, in m, m/s and N. The command depends on the state and the target alone,
    up to the side of the body on which the last plan passes it, and with a finite `latest` on the
    time that is left. The last plan, which is discrete state in
    the Context and is replaced every `period`, only says where to linearise first:

    * If it is one period old and fits the state and the target, the program is linearised once.
    * If it does not fit, or if there is none, the program is linearised `cold_iterations` times.
    * If it is older, because the MPC was not asked in between, it is shifted by its age and the
      program is linearised up to five times, until the first force settles. If the force does not
      settle, the plan is discarded.

    `enable`, if connected, gates the periodic update. While it is 0, the controller solves only if
    one of the outputs `force`, `plan` and `record` is evaluated. `planned_force` never solves: it
    is the force that the last plan has for the present time, or the braking force if there is no
    last plan, or none if there is no state either.

    With `estimator_gain` above 0 the control is offset-free. The acceleration that gravity and the
    last force do not explain is estimated from the motion over the last period, smoothed by that
    gain, and included in the plan's motion. The estimate is kept with the plan, and the command
    depends on it.

    With `delay` above 0 the command is assumed to act that much later, as through a `DelayedHold`.
    The plan then begins at the predicted state at that time, under the last command and the assumed
    gravity. The last command is kept as well, and the command depends on it.

    With a finite `latest` a plan takes no longer than the time that is left until then, after
    enough linearisations, each of which shortens it by a tenth. Where the thrust does not allow
    that, the plan misses the target. Once less is left than the shortest horizon, it is too late
    for any, and plans are as long as they need.

    If the solver fails, the flight goes on: the last plan is continued (status 1), or the
    spacecraft brakes if there is none (status 2); without a state, there is no force.
    `Plan.reason` says why.
    """

    legend_entry = LegendEntry("MPC", (0.22, 0.55, 0.95))

    def __init__(
        self,
        program: PlanProgram,
        period: float = 10.0,
        cold_iterations: int = 10,
        estimator_gain: float = 0.0,
        delay: float = 0.0,
        latest: float = math.inf,
    ):
        """Takes the program to solve and how to use it.

        Args:
          program: the optimal control problem.
          period: control period in s.
          cold_iterations: number of linearisations without a recent plan.
          estimator_gain: from 0 to 1; 0: no estimate of an unexplained acceleration.
          delay: time in s from a command's evaluation until it acts.
          latest: time in s of the flight at which plans should have ended; inf: at none.
        """
        super().__init__()
        check_type("ModelPredictiveController", PlanProgram, program=program)
        check_positive("ModelPredictiveController", period=period)
        if not 1 <= cold_iterations <= _MOST_ITERATIONS:
            raise InputError(
                f"the MPC needs from 1 to {_MOST_ITERATIONS} cold_iterations, got {cold_iterations}"
            )
        if not 0.0 <= estimator_gain <= 1.0:
            raise InputError(f"the MPC's estimator gain must be from 0 to 1, got {estimator_gain}")
        if not 0.0 <= delay <= period:
            raise InputError(f"the MPC's delay must be from 0 to its period, got {delay} s")
        if not latest > 0.0:
            raise InputError(f"the MPC's latest end of a plan must be positive, got {latest} s")
        self.program, self.period, self.cold_iterations = program, period, cold_iterations
        self.estimator_gain, self.delay, self.latest = estimator_gain, delay, float(latest)
        self._state_port = self.DeclareVectorInputPort("state", 6)
        self._target_port = self.DeclareVectorInputPort("target", 6)
        self._enable_port = self.DeclareVectorInputPort("enable", 1)
        intervals = program.horizon.intervals
        self._memory = self.DeclareDiscreteState(memory_size(intervals))
        # The last command, which is needed with a delay only. It is zero at first.
        self._command = self.DeclareDiscreteState(3) if delay > 0.0 else None
        self._declare_outputs(intervals)
        # The update is discrete, not unrestricted: all discrete updates at one time see the state
        # before it. So the hold downstream reads the cached plan, and nothing is solved twice.
        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._remember_plan)

    def _declare_outputs(self, intervals: int) -> None:
        depends = {
            self._state_port.ticket(),
            self._target_port.ticket(),
            self.xd_ticket(),
            self.time_ticket(),
        }
        self._plan_port = self.DeclareAbstractOutputPort(
            "plan", lambda: AbstractValue.Make(empty_plan(intervals)), self._calc_plan, depends
        )
        self._force_port = self.DeclareVectorOutputPort("force", 3, self._calc_force, depends)
        self._record_port = self.DeclareVectorOutputPort("record", 3, self._calc_record, depends)
        self.DeclareVectorOutputPort(
            "planned_force",
            3,
            self._calc_planned_force,
            {self._state_port.ticket(), self.xd_ticket(), self.time_ticket()},
        )

    def logged_ports(self) -> dict[str, LoggedPort]:
        """The ports whose values a log keeps, by the names of their columns."""
        return {
            "mpc_force": LoggedPort(self._force_port),
            "mpc_record": LoggedPort(self._record_port),
        }

    def _calc_plan(self, context, output):
        state = self._state_port.Eval(context)
        target = self._target_port.Eval(context)
        started = time.perf_counter()
        last, age = self._recall(context)
        disturbance = np.zeros(3) if last is None else last.disturbance
        if np.isfinite(state).all() and np.isfinite(target).all():
            state = self._predict(context, state)
            start = context.get_time() + self.delay
            disturbance = self._estimate(last, age, state, start)
            if self.delay > 0.0:
                state = state + moved_by(disturbance, self.delay)
            longest = self._longest(context)
            task = (disturbance, longest, start)
            plan, reason = self._solve(state, target, last, age, task)
        else:
            plan, reason = None, PlanReason.INPUT_NOT_FINITE
        if plan is None:
            plan = self._fallback(context, state, last, age)
        solve_time = time.perf_counter() - started
        output.set_value(
            dataclasses.replace(plan, solve_time=solve_time, reason=reason, disturbance=disturbance)
        )

    def _calc_force(self, context, output):
        output.SetFromVector(self._first_force(self._plan_port.Eval(context)))

    def _calc_record(self, context, output):
        plan = self._plan_port.Eval(context)
        output.SetFromVector([plan.solve_time, plan.status, plan.reason])

    def _calc_planned_force(self, context, output):
        state = self._state_port.Eval(context)
        plan = self._fallback(context, state, *self._recall(context))
        output.SetFromVector(self._first_force(plan))

    def _remember_plan(self, context, discrete_state):
        enabled = not self._enable_port.HasValue(context) or self._enable_port.Eval(context)[0] != 0
        if not enabled:
            return
        plan = self._plan_port.Eval(context)
        if self._command is not None:
            discrete_state.set_value(self._command, self._first_force(plan))
        if plan.status == PlanStatus.SOLVED:
            discrete_state.set_value(self._memory, packed(plan, context.get_time() + self.delay))
        # Otherwise the last plan that was solved stays, to be continued.

    def _first_force(self, plan: Plan) -> np.ndarray:
        limit = self.program.limits.thrust
        return np.clip(plan.forces[0], -limit, limit)

    def _recall(self, context) -> tuple[Plan | None, float]:
        """The last plan or None, and its age in s when the next force takes effect."""
        memory = context.get_discrete_state(self._memory).value()
        last, start = unpacked(memory, self.program.horizon)
        return last, 0.0 if last is None else context.get_time() + self.delay - start

    def _predict(self, context, state: np.ndarray) -> np.ndarray:
        """The state when the next force takes effect, without unexplained acceleration."""
        if self._command is None:
            return state
        program, force = self.program, context.get_discrete_state(self._command).value()
        mass, time = program.limits.mass, context.get_time()
        return predicted_state(state, force, self.delay, program.field, mass, program.spin, time)

    def _estimate(
        self, last: Plan | None, age: float, state: np.ndarray, time: float
    ) -> np.ndarray:
        """The acceleration (3,) in m/s^2 besides gravity and the force commanded `age` s ago.

        Args:
          last: the last plan, which begins with that force.
          age: in s.
          state: (6,), predicted without an unexplained acceleration. time: its time in s.
        """
        if last is None:
            return np.zeros(3)
        known = last.disturbance
        if self.estimator_gain == 0.0 or not 0.0 < age <= 1.5 * self.period:
            return known
        program = self.program
        # Both states must be predictions over the delay without an unexplained acceleration.
        before = last.states[0] - moved_by(known, self.delay)
        force = self._first_force(last)
        mass, begun = program.limits.mass, time - age
        found = unexplained_acceleration(
            before, state, force, age, program.field, mass, program.spin, begun
        )
        return known + self.estimator_gain * (found - known)

    def _longest(self, context) -> float:
        """The length in s that a plan should not exceed; inf when it is too late for any."""
        left = self.latest - context.get_time() - self.delay
        return left if left > self.program.horizon.minimum else math.inf

    def _solve(
        self,
        state: np.ndarray,
        target: np.ndarray,
        last: Plan | None,
        age: float,
        task: tuple[np.ndarray, float, float],
    ) -> tuple[Plan | None, PlanReason]:
        """A new plan, or None if the solver fails, and the reason.

        `task` are the last three arguments of `PlanProgram.solve`.
        """
        solve, iterations = self.program.solve, self.cold_iterations
        if last is None:
            reason = PlanReason.SOLVED_ANEW_NO_PLAN
        elif age > 1.5 * self.period:
            reason = PlanReason.SOLVED_ANEW_PLAN_TOO_OLD
        elif not self.program.fits(last, age, state, target):
            reason = PlanReason.SOLVED_ANEW_PLAN_ELSEWHERE
        else:
            reason, iterations = PlanReason.SOLVED_ABOUT_LAST_PLAN, 1
        try:
            if last is not None and reason == PlanReason.SOLVED_ANEW_PLAN_TOO_OLD:
                plan = self._solve_about_old_plan(state, target, last, age, task)
                return plan, reason
            return solve(state, target, last, age, iterations, *task), reason
        except SolverFailure as failure:
            result = failure.result
        if last is not None:
            # The last plan may be the cause of the failure: try again without it.
            try:
                plan = solve(state, target, None, 0.0, self.cold_iterations, *task)
                return plan, PlanReason.SOLVED_ANEW_AFTER_FAILURE
            except SolverFailure as failure:
                result = failure.result
        return None, _FAILURES.get(result, PlanReason.SOLVER_ERROR)

    def _solve_about_old_plan(
        self,
        state: np.ndarray,
        target: np.ndarray,
        last: Plan,
        age: float,
        task: tuple[np.ndarray, float, float],
    ) -> Plan:
        """A plan about the last one, shifted by its age; without it if that does not settle."""
        iterations = self.cold_iterations
        plan, due = last, last.forces_at(np.array([age]))[0]
        for count in range(1, min(_MOST_FOR_OLD_PLAN, iterations) + 1):
            plan = self.program.solve(state, target, plan, age, 1, *task)
            change = np.abs(plan.forces[0] - due).max()
            if change < _SETTLED * self.program.limits.thrust:
                return dataclasses.replace(plan, iterations=count)
            due, age = plan.forces[0], 0.0
        return self.program.solve(state, target, None, 0.0, iterations, *task)

    def _fallback(self, context, state: np.ndarray, last: Plan | None, age: float) -> Plan:
        """The rest of the last plan, or braking if there is none."""
        program = self.program
        if last is not None:
            return continued_plan(last, age, program.horizon, self.period)
        time = context.get_time() + self.delay
        return braking(
            state, program.field, program.spin, program.limits, program.horizon, self.period, time
        )
