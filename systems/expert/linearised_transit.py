"""`LinearisedTransit`: what all convex programs of a plan share: motion, limits and keep-out.

The program is linearised about an earlier plan. Its variables are z and slacks s. z holds u, the
forces over the thrust limit, and the stretch, the relative change of the plan's length, if that is
free. The states are not variables: they are affine in z (`condensed_motion`), and so are the limits
along the path (`path_limits`)::

    minimise    mean of |u|_2^2  +  price . s  +  an added cost of z
    subject to  |u| <= 1,  s >= 0,  rows (z, s) >= bounds
                with x_k / units = motion_k z + drift_k,  k = 1 ... N

Every limit except that of thrust has an exactly penalised slack, so that every state is feasible.
The limits that the last plan is far from are left out at first. If the solution breaks one of them,
the program is solved again with it (constraint generation). So the result is always the solution of
the whole program.
"""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np
from pydrake.solvers import ClarabelSolver, MathematicalProgram, SolverOptions

from proxops.systems.common import SolverFailure
from proxops.systems.expert.condensed_motion import condensed_motion
from proxops.systems.expert.initial_guess import initial_paths
from proxops.systems.expert.path_limits import PathLimits, path_limits
from proxops.systems.expert.plan import Horizon, Plan, TransitLimits
from proxops.systems.gravity import Field

# Prices of one scaled unit of slack, against an effort of 0 to 3. They are above every multiplier,
# so that slack is used only where nothing else is feasible (an exact penalty). Staying out of the
# keep-out ellipsoid has priority over everything else.
KEEP_OUT_PRICE, SLACK_PRICE = 1000.0, 100.0
# A plan is close if its state now and its target are within this many units: 0.5 km and 0.5 m/s.
_CLOSE = 0.05
# Limits that the last plan is this near to, in units (1 km, 1 m/s), are in the program at first.
_NEAR = 0.1
# The others are added if the solution breaks them by more than this, in units (0.1 mm, 0.1 um/s).
_TOLERANCE = 1e-8


@dataclass(frozen=True)
class TransitSolution:
    """A solution of one linearisation."""

    states: np.ndarray
    """(N + 1, 6) at the knots, in m and m/s."""
    controls: np.ndarray
    """(N, 3), forces over the limit."""
    stretch: float
    """Relative change of the plan's length."""
    slack: float
    """Sum of all slacks, in scaled units."""


class LinearisedTransit:
    """A MathematicalProgram over the controls of a plan; other classes add their costs.

    Attributes:
      program: has the mean square of u over the plan and the price of slack as costs already.
      u (3 N,), stretch (1,) or (), moved: variables; `moved` is z, that is u and the stretch.
      size: (3 N,) variables that are at least |u|, for costs of the 1-norm, or ().
      end_slacks: further slacks, not negative and with a price.
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
        """Builds the program.

        Args:
          field: the assumed gravity.
          spin: the assumed spin in rad/s about z.
          limits: of the spacecraft and its path.
          horizon: how a plan is divided into intervals.
          free_time: whether `stretch` is a variable.
          one_norm: whether `size` exists.
          end_slacks: number of further slacks.
        """
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
        # One block of variables and few bindings are fast: at each solve Drake looks up each
        # variable of each binding.
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
        # The number of rows changes from solve to solve.
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
        """Plans to linearise about, which depend on state and target alone; the likeliest is first.

        Args:
          state, target: (6,) in K, in m and m/s.
          duration: length in s of a plan straight to the target.
          free_time: whether plans round the body take longer than that: by the square root of the
            ratio of the paths' lengths, as from rest to rest at one acceleration, and at most three
            times as long.
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
        """The rest of a plan `age` s old, over the next `duration` s.

        Returns:
          States (N + 1, 6) at the knots and controls (N, 3) of the intervals.
        """
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
        """Linearises the motion and its limits about a plan.

        Args:
          start: (6,) the first state, in K, in m and m/s.
          states, controls: (N + 1, 6) and (N, 3) of the plan to linearise about.
          duration: its length in s.
          push: (3,) in m/s^2, an acceleration that the field does not explain.
        """
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
        """Solves the program about the plan that was linearised last.

        Raises:
          SolverFailure: the solver finds no solution.
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
        """The values of all variables at the optimum; raises `SolverFailure` if there is none."""
        # Iterative refinement of the linear solves takes a third of the time and gives digits
        # beyond the tolerance. So it is used only if the solve fails without it.
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
        """The plan of a solution; `started` is the value of `time.perf_counter` at its start."""
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
        """Whether a plan made `age` s ago is so close that one linearisation about it is enough."""
        away = np.abs(np.stack([plan.states_at(np.array([age]))[0] - state, plan.target - target]))
        return bool((away < _CLOSE * self.units).all())
