"""What every convex program of a plan has: motion, limits and keep-out about an earlier plan.

The variables are z and slacks s: z is u, the forces over the thrust limit, and the change of the
plan's length over its length, if that is free. The states are no variables; they are affine in z
(`condensed_motion`), and so are a cost and the limits of the path (`path_limits`) on them::

    minimise    mean of |u|_2^2  +  price . s  +  what is added, a cost of z
    subject to  |u| <= 1,  s >= 0,  rows (z, s) >= bounds
                with x_k / units = motion_k z + drift_k,  k = 1 ... N

Each limit but that of thrust has an exactly penalised slack, so that no state is infeasible.
Limits of the path that the last plan is far from are left out at first; a solution that breaks one
of them is solved for again with it (constraint generation). So the answer is always that of the
whole program.
"""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np
from pydrake.solvers import ClarabelSolver, MathematicalProgram, SolverOptions

from proxops.systems.common import InputError, SolverFailure
from proxops.systems.expert.condensed_motion import condensed_motion
from proxops.systems.expert.initial_guess import initial_paths
from proxops.systems.expert.path_limits import PathLimits, path_limits
from proxops.systems.expert.plan import Horizon, Plan, TransitLimits
from proxops.systems.gravity import Field

# Prices of one scaled unit of slack, against an effort of 0 to 3: above every multiplier, so that
# slack is used only where there is no other way (an exact penalty). Staying out of the keep-out
# ellipsoid goes before all else.
KEEP_OUT_PRICE, SLACK_PRICE = 1000.0, 100.0
# A plan is close whose state now and target are within this many units: 0.5 km and 0.5 m/s.
_CLOSE = 0.05
# Limits that the last plan is this near to, in units (1 km, 1 m/s), are in the program at once.
_NEAR = 0.1
# The others join it if its solution breaks them by more than this, in units (0.1 mm, 0.1 um/s).
_TOLERANCE = 1e-8


@dataclass(frozen=True)
class TransitSolution:
    """A solution of one linearisation."""

    states: np.ndarray
    """(N + 1, 6) at the knots, in m and m/s."""
    controls: np.ndarray
    """(N, 3), forces over the limit."""
    stretch: float
    """Change of the plan's length over its length."""
    slack: float
    """Sum of all slacks, in scaled units."""


class LinearisedTransit:
    """A MathematicalProgram over the controls of a plan, to which costs are added.

    Attributes:
      program: has the mean square of u over the plan and the price of slack as costs already.
      u (3 N,), stretch (1,) or (), moved: variables; `moved` is z, both of them.
      size: (3 N,) no less than |u|, for costs of the 1-norm, or ().
      end_slacks: variables that are not negative and have a price.
      stretch_bounds: the constraint that bounds the stretch, if it is free.
      fractions: (N + 1,) knots as shares of the plan's length; shares: (N,) of the intervals.
      units: (6,) in m and m/s.
      motion (N, 6, M), drift (N, 6): the states at the knots after the first, as linearised last.
    """

    def __init__(
        self,
        field: Field,
        spin: float,
        limits: TransitLimits,
        horizon: Horizon,
        free_time: bool,
        one_norm: bool = False,
        end_slacks: int = 0,
    ):
        """Takes the field and spin (rad/s about z) that the plan believes in.

        Args:
          free_time: whether `stretch` is a variable.
          one_norm: whether to make `size`.
          end_slacks: how many further slacks to make.

        Raises:
          InputError: the horizon has no length or fewer than two intervals.
        """
        if horizon.intervals < 2 or not horizon.minimum > 0.0:
            raise InputError("a plan needs at least 2 intervals and a horizon of positive length")
        self.field, self.spin, self.limits, self.horizon = field, spin, limits, horizon
        self.fractions = horizon.fractions()
        self.shares = np.diff(self.fractions)
        # Scaled to numbers of order one.
        speed_unit = limits.speed / 4.0
        length_unit = float(np.min(limits.keep_out_semi_axes)) / 7.0
        self.units = np.repeat([length_unit, speed_unit], 3)
        self.program = MathematicalProgram()
        self._build(int(free_time), int(one_norm), end_slacks)
        self.solver = ClarabelSolver()
        self.options = SolverOptions()

    def _build(self, free_time: int, one_norm: int, end_slacks: int) -> None:
        n, program = self.horizon.intervals, self.program
        # One block with few bindings: Drake looks up each variable of each binding at each solve.
        sizes = [3 * n, free_time, n, n, end_slacks, 3 * n * one_norm]
        variables = program.NewContinuousVariables(sum(sizes), "z")
        parts = np.split(variables, np.cumsum(sizes)[:-1])
        self.u, self.stretch, keep_out_slack, speed_slack, self.end_slacks, self.size = parts
        self.moved = variables[: 3 * n + free_time]
        slacks = np.concatenate([keep_out_slack, speed_slack, self.end_slacks])
        self._slacks = slice(self.moved.size, self.moved.size + slacks.size)
        self._limited = slice(self.moved.size + 2 * n)
        if one_norm:
            eye = np.eye(3 * n)
            program.AddLinearConstraint(
                np.block([[eye, eye], [-eye, eye]]),
                np.zeros(6 * n),
                np.full(6 * n, np.inf),
                np.concatenate([self.u, self.size]),
            )
            program.AddBoundingBoxConstraint(-np.inf, 1.0, self.size)
        else:
            program.AddBoundingBoxConstraint(-1.0, 1.0, self.u)
        if free_time:
            self.stretch_bounds = program.AddBoundingBoxConstraint(0.0, 0.0, self.stretch)
        program.AddBoundingBoxConstraint(0.0, np.inf, slacks)
        # How many rows there are, changes from solve to solve.
        limited = variables[self._limited]
        self._path = program.AddLinearConstraint(
            np.zeros((1, limited.size)), np.zeros(1), np.full(1, np.inf), limited
        )
        weights = 2.0 * np.diag(np.repeat(self.shares, 3))
        program.AddQuadraticCost(weights, np.zeros(3 * n), self.u, is_convex=True)
        price = np.full(slacks.size, SLACK_PRICE)
        price[:n] = KEEP_OUT_PRICE
        program.AddLinearCost(price, 0.0, slacks)

    def initial_plans(
        self, state: np.ndarray, target: np.ndarray, duration: float, free_time: bool
    ) -> list[Plan]:
        """Plans to linearise about that depend on state and target alone, the likeliest first.

        Args:
          duration: of a plan, in s.
          free_time: whether it is of one straight to the target, and those that go round take
            longer, by the root of how much longer their paths are (but never thrice as long): so it
            is from rest to rest at one acceleration.
        """
        plans, axes = [], self.limits.keep_out_semi_axes
        for positions in initial_paths(self.fractions, state[:3], target[:3], axes):
            length = np.linalg.norm(np.diff(positions, axis=0), axis=1).sum()
            straight = np.linalg.norm(target[:3] - state[:3])
            longer = np.sqrt(np.clip(length / max(straight, 1e-9 * length, 1e-9), 1.0, 9.0))
            times = (longer if free_time else 1.0) * duration * self.fractions
            states = np.hstack([positions, np.gradient(positions, times, axis=0)])
            forces = np.zeros((self.horizon.intervals, 3))
            plans.append(Plan(times, states, forces, target, 0.0, 0.0, 0, 0, 0.0))
        return plans

    def remaining_plan(
        self, last: Plan, age: float, duration: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """States (N + 1, 6) and controls (N, 3) of a plan `age` s old, on knots over `duration`."""
        times = age + duration * self.fractions
        controls = last.forces_at(0.5 * (times[1:] + times[:-1])) / self.limits.thrust
        return last.states_at(times), controls

    def linearise(
        self,
        start: np.ndarray,
        states: np.ndarray,
        controls: np.ndarray,
        duration: float,
        push: np.ndarray,
    ) -> None:
        """Motion from `start` (6,) about states (N + 1, 6) and controls (N, 3), and its limits."""
        rows = condensed_motion(
            self.field, self.spin, start, states, controls, duration * self.shares,
            self.limits.thrust / self.limits.mass, push,
        )  # fmt: skip
        rows /= self.units[:, None]
        self._start = start
        self.motion, self.drift = rows[:, :, : self.moved.size], rows[:, :, -1]
        self._limits: PathLimits = path_limits(
            self.limits, self.units, self.motion, self.drift, states[1:]
        )

    def solve(self) -> TransitSolution:
        """Solves the program as it is linearised.

        Raises:
          SolverFailure: the solver fails.
        """
        rows, bounds, room = self._limits
        included = room < _NEAR
        while True:
            free = np.full(np.count_nonzero(included), np.inf)
            self._path.evaluator().UpdateCoefficients(rows[included], bounds[included], free)
            values = self._minimum()
            missed = ~included & (rows @ values[self._limited] < bounds - _TOLERANCE)
            if not missed.any():
                break
            included |= missed
        moved = values[: self.moved.size]
        forces = self.u.size
        ends = (self.motion @ moved + self.drift) * self.units
        return TransitSolution(
            states=np.vstack([self._start, ends]),
            controls=moved[:forces].reshape(-1, 3),
            stretch=float(np.sum(moved[forces:])),
            slack=float(np.sum(values[self._slacks])),
        )

    def _minimum(self) -> np.ndarray:
        """All variables at the optimum, or SolverFailure."""
        # Refinement of the linear solves takes a third of the time, for digits beyond the
        # tolerance; a solve that fails without it gets it.
        for refined in (False, True):
            self.options.SetOption(ClarabelSolver.id(), "iterative_refinement_enable", refined)
            result = self.solver.Solve(self.program, None, self.options)
            if result.is_success():
                return result.get_x_val()
        raise SolverFailure(result.get_solution_result())

    def plan_of(
        self,
        solution: TransitSolution,
        target: np.ndarray,
        duration: float,
        cost: float,
        iterations: int,
        started: float,
    ) -> Plan:
        """The plan that a solution is; `started` is of `time.perf_counter`."""
        return Plan(
            times=duration * self.fractions,
            states=solution.states,
            forces=solution.controls * self.limits.thrust,
            target=target,
            cost=cost,
            slack=solution.slack,
            status=0,
            iterations=iterations,
            solve_time=time.perf_counter() - started,
        )

    def fits(self, plan: Plan, age: float, state: np.ndarray, target: np.ndarray) -> bool:
        """Whether a plan made `age` s ago is so close that one linearisation about it will do."""
        away = np.abs(np.stack([plan.states_at(np.array([age]))[0] - state, plan.target - target]))
        return bool((away < _CLOSE * self.units).all())
