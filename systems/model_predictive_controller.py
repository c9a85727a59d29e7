"""`ModelPredictiveController`: the expert, which knows its state exactly."""

from __future__ import annotations

import dataclasses
import time

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import LeafSystem

from proxops.systems.errors import InputError
from proxops.systems.plan import Plan, PlanProgram
from proxops.systems.spacecraft import rotating_frame_acceleration

SOLVED, FLOWN_ON, BRAKING = 0, 1, 2


class ModelPredictiveController(LeafSystem):
    """Plans from the state to the target at every step and commands the plan's first force.

    ```
    state (6) ──────►┌───────────────────────────┐
    target (6) ─────►│ ModelPredictiveController ├─► force (3), N
    enable (1) ─────►│                           ├─► plan (abstract Plan)
                     └───────────────────────────┴─► record (2): wall time in s, Plan.status
    ```

    All vectors are in K, in m, m/s and N. The command depends on the state and the target alone:
    the last plan, kept in the Context as discrete state and replaced every `period`, only says
    where to linearise first. It is linearised about once if it is one period old
    and fits the state and target, and `cold_iterations` times if not, or if there is none.

    `enable`, if connected, gates the periodic update: while it is 0, nothing is solved unless an
    output is asked for.

    With `estimator_gain` above 0 it is offset-free: the acceleration that gravity and its own last
    force do not explain is estimated from the motion over the last period, smoothed by that gain,
    and planned for. The estimate is kept with the plan; the command then depends on it too.

    If the solver fails the flight goes on: the last plan is flown on by the clock (status 1), and
    without one the spacecraft brakes (status 2).
    """

    def __init__(
        self,
        program: PlanProgram,
        period: float = 10.0,
        cold_iterations: int = 10,
        estimator_gain: float = 0.0,
    ):
        """Takes the program to solve, the control period in s and the estimator's gain, 0 to 1.

        Raises:
          InputError: the period or the number of iterations is not positive, or the gain is not
            from 0 to 1.
        """
        super().__init__()
        if not (period > 0.0 and cold_iterations >= 1):
            raise InputError(
                "the MPC needs a positive period and at least one cold iteration, "
                f"got {period} and {cold_iterations}"
            )
        if not 0.0 <= estimator_gain <= 1.0:
            raise InputError(f"the MPC's estimator gain must be from 0 to 1, got {estimator_gain}")
        self.program, self.period, self.cold_iterations = program, period, cold_iterations
        self.estimator_gain = estimator_gain
        self._state_port = self.DeclareVectorInputPort(name="state", size=6)
        self._target_port = self.DeclareVectorInputPort(name="target", size=6)
        self._enable_port = self.DeclareVectorInputPort(name="enable", size=1)
        knots = program.horizon.knots
        # Whether there is a plan, when it was made, its length, target, states and forces, and the
        # estimate of what pushes besides gravity.
        self._memory = self.DeclareDiscreteState(9 + 6 * (knots + 1) + 3 * knots + 3)
        depends = {
            self._state_port.ticket(),
            self._target_port.ticket(),
            self.discrete_state_ticket(self._memory),
            self.time_ticket(),
        }
        self._plan_port = self.DeclareAbstractOutputPort(
            name="plan",
            alloc=lambda: AbstractValue.Make(_empty_plan(knots)),
            calc=self._calc_plan,
            prerequisites_of_calc=depends,
        )
        self._force_port = self.DeclareVectorOutputPort(
            name="force", size=3, calc=self._calc_force, prerequisites_of_calc=depends
        )
        self._record_port = self.DeclareVectorOutputPort(
            name="record", size=2, calc=self._calc_record, prerequisites_of_calc=depends
        )
        # Discrete, not unrestricted: at one time all discrete updates see the same state before
        # it, so that the hold downstream reads the plan that is cached and nothing is solved twice.
        self.DeclarePeriodicDiscreteUpdateEvent(
            period_sec=period, offset_sec=0.0, update=self._remember_plan
        )

    def _calc_plan(self, context, output):
        state = self._state_port.Eval(context)
        target = self._target_port.Eval(context)
        last, age = self._recall(context)
        close = (
            last is not None
            and age <= 1.5 * self.period
            and self.program.fits(last, age, state, target)
        )
        iterations = 1 if close else self.cold_iterations
        started = time.perf_counter()
        push = self._estimate(context, last, age, state)
        plan = self.program.solve(state, target, last, age, iterations, push)
        if plan is None:
            if last is not None:
                # A plan that leads nowhere may be what the solver choked on: again from nothing.
                plan = self.program.solve(state, target, None, 0.0, self.cold_iterations, push)
            if plan is None:
                plan = self._flown_on(last, age) if last is not None else self._braking(state)
            plan = dataclasses.replace(plan, solve_time=time.perf_counter() - started)
        output.set_value(plan)

    def _calc_force(self, context, output):
        plan = self._plan_port.Eval(context)
        limit = self.program.limits.thrust
        output.SetFromVector(np.clip(plan.forces[0], -limit, limit))

    def _calc_record(self, context, output):
        plan = self._plan_port.Eval(context)
        output.SetFromVector([plan.solve_time, plan.status])

    def _remember_plan(self, context, discrete_state):
        enabled = not self._enable_port.HasValue(context) or self._enable_port.Eval(context)[0] != 0
        if not enabled:
            return
        plan = self._plan_port.Eval(context)
        if plan.status != SOLVED:
            return  # The last plan that was solved stays, to be flown on by its own clock.
        head = [1.0, context.get_time(), plan.times[-1], *plan.target]
        push = self._estimate(context, *self._recall(context), plan.states[0])
        memory = np.concatenate([head, plan.states.ravel(), plan.forces.ravel(), push])
        discrete_state.set_value(self._memory, memory)

    def _recall(self, context) -> tuple[Plan | None, float]:
        """The last plan and its age in s."""
        memory = context.get_discrete_state(self._memory).value()
        if memory[0] == 0.0:
            return None, 0.0
        knots = self.program.horizon.knots
        split = 9 + 6 * (knots + 1)
        plan = dataclasses.replace(
            _empty_plan(knots),
            times=memory[2] * self.program.horizon.fractions(),
            target=memory[3:9],
            states=memory[9:split].reshape(knots + 1, 6),
            forces=memory[split:-3].reshape(knots, 3),
        )
        return plan, context.get_time() - memory[1]

    def _estimate(self, context, last: Plan | None, age: float, state: np.ndarray) -> np.ndarray:
        """What pushes besides gravity and the force commanded `age` s ago: (3,) in m/s^2."""
        known = context.get_discrete_state(self._memory).value()[-3:].copy()
        if self.estimator_gain == 0.0 or last is None or not 0.0 < age <= 1.5 * self.period:
            return known
        limits, before = self.program.limits, last.states[0]
        change = state[3:] - before[3:]
        middle = 0.5 * (before[:3] + state[:3]) - 0.125 * age * change
        expected = rotating_frame_acceleration(
            middle,
            0.5 * (before[3:] + state[3:]),
            self.program.field.evaluate(middle[None]).acceleration[0],
            np.clip(last.forces[0], -limits.thrust, limits.thrust),
            limits.mass,
            self.program.spin,
        )
        return known + self.estimator_gain * (change / age - expected - known)

    def _flown_on(self, last: Plan, age: float) -> Plan:
        """What is left of the last plan, on the same knots; past its end, its last force."""
        times = self.program.horizon.fractions() * max(last.times[-1] - age, self.period)
        forces = last.forces_at(age + 0.5 * (times[1:] + times[:-1]))
        # The force that is due now, not the mean over the first of the new intervals.
        forces[0] = last.forces_at(np.array([age]))[0]
        states = last.states_at(age + times)
        return dataclasses.replace(last, times=times, states=states, forces=forces, status=FLOWN_ON)

    def _braking(self, state: np.ndarray) -> Plan:
        """Hover thrust and full braking of the velocity in K, within the limits."""
        knots, limits = self.program.horizon.knots, self.program.limits
        if not np.isfinite(state).all():
            return _empty_plan(knots)  # Of no known state, no thrust.
        gravity = self.program.field.evaluate(state[None, :3]).acceleration[0]
        spin = self.program.spin
        apparent = gravity + [spin**2 * state[0], spin**2 * state[1], 0.0]
        apparent += [2.0 * spin * state[4], -2.0 * spin * state[3], 0.0]
        force = -limits.mass * (apparent + state[3:] / self.period)
        force = np.clip(force, -limits.thrust, limits.thrust)
        return dataclasses.replace(
            _empty_plan(knots),
            times=self.program.horizon.fractions() * self.program.horizon.minimum,
            states=np.tile(state, (knots + 1, 1)),
            forces=np.tile(force, (knots, 1)),
            status=BRAKING,
        )


def _empty_plan(knots: int) -> Plan:
    return Plan(
        times=np.zeros(knots + 1),
        states=np.zeros((knots + 1, 6)),
        forces=np.zeros((knots, 3)),
        target=np.zeros(6),
        cost=np.nan,
        slack=np.nan,
        status=BRAKING,
        iterations=0,
        solve_time=0.0,
    )
