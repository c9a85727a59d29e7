"""What every convex program of a plan has: motion, limits and keep-out about an earlier plan.

The variables are scaled to numbers of order one: states by `units`, forces by the thrust limit.
Each limit but that of thrust has an exactly penalised slack, so that no state is infeasible.
"""

from __future__ import annotations

import time

import numpy as np
from pydrake.solvers import (
    ClarabelSolver,
    MathematicalProgram,
    MathematicalProgramResult,
    SolverOptions,
)

from proxops.systems.ellipsoid import tangent_half_spaces
from proxops.systems.errors import InputError
from proxops.systems.first_guess import first_positions
from proxops.systems.gravity_field import Field
from proxops.systems.linear_motion import linear_motion
from proxops.systems.plan import Horizon, Plan, TransitLimits

# Prices of one scaled unit of slack, against an effort of 0 to 3: above every multiplier, so that
# slack is used only where there is no other way (an exact penalty). Staying out of the keep-out
# ellipsoid goes before all else.
KEEP_OUT_PRICE, SLACK_PRICE = 1000.0, 100.0
# A plan is close whose state now and target are within this many units: 0.5 km and 0.5 m/s.
_CLOSE = 0.05


class LinearisedTransit:
    """A MathematicalProgram with the states and forces of a plan, to which costs are added.

    Attributes:
      program, x (N + 1, 6), u (N, 6), slacks: what costs and further constraints are added to.
        u is the force over its limit along +x, +y, +z, -x, -y, -z, none negative: linear cost of
        the sum is then the 1-norm. Its mean square over the plan is already part of the cost.
      stretch: (1,) the change of the plan's length over its length, if it is free; else empty.
      stretch_bounds: the constraint that bounds it.
      fractions: (N + 1,) knots as shares of the plan's length.
      units: (6,) in m and m/s.
    """

    def __init__(
        self,
        field: Field,
        spin: float,
        limits: TransitLimits,
        horizon: Horizon,
        free_time: bool,
        end_slacks: int = 0,
    ):
        """Takes the field and spin (rad/s about z) that the plan believes in.

        Args:
          free_time: whether `stretch` is a variable.
          end_slacks: how many further slacks to make, the last of `slacks`.

        Raises:
          InputError: the horizon has no length or fewer than two intervals.
        """
        if horizon.knots < 2 or not horizon.minimum > 0.0:
            raise InputError("a plan needs at least 2 knots and a horizon of positive length")
        self.field, self.spin, self.limits, self.horizon = field, spin, limits, horizon
        self.fractions = horizon.fractions()
        speed_unit = limits.speed / 4.0
        length_unit = float(np.min(limits.keep_out_semi_axes)) / 7.0
        self.units = np.repeat([length_unit, speed_unit], 3)
        self.program = MathematicalProgram()
        self._build(free_time, end_slacks)
        self.solver = ClarabelSolver()
        self.options = SolverOptions()

    def _build(self, free_time: bool, end_slacks: int) -> None:
        n, program = self.horizon.knots, self.program
        self.x = program.NewContinuousVariables(n + 1, 6, "x")
        self.u = program.NewContinuousVariables(n, 6, "u")
        self.stretch = program.NewContinuousVariables(int(free_time), "stretch")
        keep_out_slack = program.NewContinuousVariables(n, "keep_out_slack")
        speed_slack = program.NewContinuousVariables(n, "speed_slack")
        end_slack = program.NewContinuousVariables(end_slacks, "end_slack")
        self.slacks = np.concatenate([keep_out_slack, speed_slack, end_slack])
        zero, free = np.zeros(6), np.full(6, np.inf)

        self._start = program.AddBoundingBoxConstraint(zero, zero, self.x[0])
        self._motion = [
            program.AddLinearEqualityConstraint(
                np.zeros((6, 18 + self.stretch.size)),
                zero,
                np.concatenate([self.x[k], self.u[k], self.x[k + 1], self.stretch]),
            )
            for k in range(n)
        ]
        program.AddBoundingBoxConstraint(0.0, 1.0, self.u)
        if free_time:
            self.stretch_bounds = program.AddBoundingBoxConstraint(0.0, 0.0, self.stretch)
        program.AddBoundingBoxConstraint(0.0, np.inf, self.slacks)
        limit = self.limits.speed / self.units[3]
        both_ways = np.hstack([np.vstack([np.eye(3), -np.eye(3)]), -np.ones((6, 1))])
        for k in range(n):
            velocity = np.append(self.x[k + 1, 3:], speed_slack[k])
            program.AddLinearConstraint(both_ways, -free, np.full(6, limit), velocity)
        self._keep_out = [
            program.AddLinearConstraint(
                np.zeros((1, 4)), [0.0], [np.inf], np.append(self.x[k + 1, :3], keep_out_slack[k])
            )
            for k in range(n)
        ]
        for share, force in zip(np.diff(self.fractions), self.u, strict=True):
            program.AddQuadraticCost(2.0 * share * np.eye(6), np.zeros(6), force, is_convex=True)
        price = np.full(self.slacks.size, SLACK_PRICE)
        price[:n] = KEEP_OUT_PRICE
        program.AddLinearCost(price, 0.0, self.slacks)

    def first_plan(self, state: np.ndarray, target: np.ndarray, duration: float) -> Plan:
        """Something to linearise about that depends on state and target alone."""
        times = duration * self.fractions
        axes = self.limits.keep_out_semi_axes
        positions = first_positions(self.fractions, state[:3], target[:3], axes)
        states = np.hstack([positions, np.gradient(positions, times, axis=0)])
        return Plan(times, states, np.zeros((len(times) - 1, 3)), target, 0.0, 0.0, 0, 0, 0.0)

    def what_is_left(
        self, last: Plan, age: float, duration: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """States (N + 1, 6) and controls (N, 3) of a plan `age` s old, on knots over `duration`."""
        times = age + duration * self.fractions
        controls = last.forces_at(0.5 * (times[1:] + times[:-1])) / self.limits.thrust
        return last.states_at(times), controls

    def linearise(
        self, states: np.ndarray, controls: np.ndarray, duration: float, push: np.ndarray
    ) -> None:
        """Motion and keep-out about states (N + 1, 6) at the knots and controls (N, 3) between."""
        n = self.horizon.knots
        positions = states[:, :3]
        lengths = duration * np.diff(self.fractions)
        force_unit = self.limits.thrust / self.limits.mass
        step, rates = linear_motion(
            self.field, self.spin, positions, lengths, self.units, force_unit, push
        )
        motion = np.empty((n, 6, 18 + self.stretch.size))
        motion[:, :, :9] = step[:, :6, :9]
        motion[:, :, 9:12] = -step[:, :6, 6:9]
        motion[:, :, 12:18] = -np.eye(6)
        if self.stretch.size:
            # A longer T makes each step longer: d exp(A) / dT along the plan.
            flown = np.concatenate([states[:-1] / self.units, controls, np.ones((n, 1))], axis=1)
            ends = np.einsum("nij,nj->ni", step, flown)
            motion[:, :, 18] = np.einsum("nij,nj->ni", rates, ends)[:, :6]
        normals, offsets = tangent_half_spaces(self.limits.keep_out_semi_axes, positions[1:])
        rows = np.ones((n, 1, 4))
        rows[:, 0, :3] = normals
        bounds = offsets / self.units[0]
        free = [np.inf]
        for k in range(n):
            self._motion[k].evaluator().UpdateCoefficients(motion[k], -step[k, :6, 9])
            self._keep_out[k].evaluator().UpdateCoefficients(rows[k], bounds[k : k + 1], free)

    def solve_from(self, state: np.ndarray) -> MathematicalProgramResult:
        """Solves the program as it is linearised, from `state` (6,)."""
        scaled = state / self.units
        self._start.evaluator().set_bounds(scaled, scaled)
        return self.solver.Solve(self.program, None, self.options)

    def controls_of(self, result: MathematicalProgramResult) -> np.ndarray:
        """Forces over the limit (N, 3)."""
        up_down = result.GetSolution(self.u)
        return up_down[:, :3] - up_down[:, 3:]

    def plan_of(
        self,
        result: MathematicalProgramResult,
        target: np.ndarray,
        duration: float,
        cost: float,
        iterations: int,
        started: float,
    ) -> Plan:
        """The plan that a solution is; `started` is of `time.perf_counter`."""
        return Plan(
            times=duration * self.fractions,
            states=result.GetSolution(self.x) * self.units,
            forces=self.controls_of(result) * self.limits.thrust,
            target=target,
            cost=cost,
            slack=float(np.sum(result.GetSolution(self.slacks))),
            status=0,
            iterations=iterations,
            solve_time=time.perf_counter() - started,
        )

    def fits(self, plan: Plan, age: float, state: np.ndarray, target: np.ndarray) -> bool:
        """Whether a plan made `age` s ago is so close that one linearisation about it will do."""
        away = np.abs(np.stack([plan.states_at(np.array([age]))[0] - state, plan.target - target]))
        return bool((away < _CLOSE * self.units).all())
