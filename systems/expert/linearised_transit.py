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

The slacks are left out at first, too. What that smaller program finds is accepted if the multiplier
of each limit is below its price: these are the conditions of optimality (Karush, Kuhn and Tucker)
of the program with slack, at no slack. Otherwise, and if there is no solution without slack, the
program is solved with it.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np
from pydrake.solvers import (
    Binding,
    ClarabelSolver,
    Cost,
    EvaluatorBase,
    MathematicalProgram,
    MathematicalProgramResult,
    SolverOptions,
)

from proxops.systems.common import SolverFailure, State, States, Vector3, Vectors3
from proxops.systems.expert.condensing import Reference, condensed_motion
from proxops.systems.expert.initial_guess import initial_paths
from proxops.systems.expert.path_limits import PathLimits, slack_of_limits
from proxops.systems.expert.plan import Horizon, Plan, PlanStatus, empty_plan
from proxops.systems.gravity import Field
from proxops.systems.rotation import SpinModel
from proxops.systems.vehicle import FlightLimits

# Prices of one scaled unit of slack, against an effort of 0 to 3. They are meant to be above every
# multiplier, so that slack is used only where nothing else is feasible (an exact penalty). Staying
# out of the keep-out ellipsoid has priority over everything else.
KEEP_OUT_PRICE, SLACK_PRICE = 1000.0, 100.0
# A plan is close if its state now and its target are within this many units: at Kleopatra 0.5 km
# and 0.5 m/s.
_CLOSE = 0.05
# Limits that the last plan is this near to, in units (1 km, 1 m/s there), are in the program at
# first.
_NEAR = 0.1
# The others are added if the solution breaks them by more than this, in units (0.1 mm, 0.1 um/s
# there).
_TOLERANCE = 1e-8


@dataclass(frozen=True)
class TransitSolution:
    """A solution of one linearisation."""

    states: States
    """(N + 1, 6) at the knots, in m and m/s."""
    controls: Vectors3
    """(N, 3), forces over the limit."""
    stretch: float
    """Relative change of the plan's length."""
    slack: float
    """Sum of all slacks, in scaled units."""


class LinearisedTransit:
    """A MathematicalProgram over the controls of a plan; other classes add their costs.

    Attributes:
      program: has the mean square of u over the plan and the price of slack as costs already.
      bare: the same program without slack. It shares the costs that are given to `share_cost`.
      u (3 N,), stretch (1,) or (), moved: variables; `moved` is z, that is u and the stretch.
      size: (3 N,) variables that are at least |u|, for costs of the 1-norm, or ().
      stretch_bounds: the constraint that bounds the stretch, if it is free.
      fractions: (N + 1,) knots as shares of the plan's length; shares: (N,) of the intervals.
      units: (6,) in m and m/s.
      motion (N, 6, M), drift (N, 6): the states at the knots after the first, as linearised last.
    """

    def __init__(
        self,
        field: Field,
        spin: SpinModel,
        limits: FlightLimits,
        horizon: Horizon,
        free_time: bool,
        one_norm: bool = False,
        meets_target: bool = False,
    ):
        """Builds the program.

        Args:
          field: the assumed gravity.
          spin: of the body, as assumed.
          limits: of the spacecraft and its path.
          horizon: how a plan is divided into intervals.
          free_time: whether `stretch` is a variable.
          one_norm: whether `size` exists.
          meets_target: whether the plan ends at the target of `aim`.
        """
        self.field, self.spin, self.limits, self.horizon = field, spin, limits, horizon
        self.fractions = horizon.fractions()
        self.shares = np.diff(self.fractions)
        # Scaled to numbers of order one: some 10 m/s and 10 km at Kleopatra.
        speed_unit = limits.speed / 4.0
        length_unit = float(np.min(limits.keep_out_semi_axes)) / 7.0
        self.units = np.repeat([length_unit, speed_unit], 3)
        self.program, self.bare = MathematicalProgram(), MathematicalProgram()
        self._build(int(free_time), int(one_norm), 12 * meets_target)
        self.solver = ClarabelSolver()
        self.options = [_solver_options(refined) for refined in (False, True)]

    def _build(self, free_time: int, one_norm: int, end_slacks: int) -> None:
        n, program, bare = self.horizon.intervals, self.program, self.bare
        # One block of variables and few bindings are fast: at each solve Drake looks up each
        # variable of each binding.
        sizes = [3 * n, free_time, n, n, end_slacks, 3 * n * one_norm]
        variables = program.NewContinuousVariables(sum(sizes), "z")
        parts = np.split(variables, np.cumsum(sizes)[:-1])
        self.u, self.stretch, keep_out_slack, speed_slack, end_slack, self.size = parts
        self.moved = variables[: 3 * n + free_time]
        slacks = np.concatenate([keep_out_slack, speed_slack, end_slack])
        self._slacks = slice(self.moved.size, self.moved.size + slacks.size)
        bare.AddDecisionVariables(np.concatenate([self.moved, self.size]))
        if one_norm:
            eye = np.eye(3 * n)
            self._share_constraint(
                program.AddLinearConstraint(
                    np.block([[eye, eye], [-eye, eye]]),
                    np.zeros(6 * n),
                    np.full(6 * n, np.inf),
                    np.concatenate([self.u, self.size]),
                )
            )
            self._share_constraint(program.AddBoundingBoxConstraint(-np.inf, 1.0, self.size))
        else:
            self._share_constraint(program.AddBoundingBoxConstraint(-1.0, 1.0, self.u))
        if free_time:
            self.stretch_bounds = program.AddBoundingBoxConstraint(0.0, 0.0, self.stretch)
            self._share_constraint(self.stretch_bounds)
        program.AddBoundingBoxConstraint(0.0, np.inf, slacks)
        weights = 2.0 * np.diag(np.repeat(self.shares, 3))
        self.share_cost(program.AddQuadraticCost(weights, np.zeros(3 * n), self.u, is_convex=True))
        price = np.full(slacks.size, SLACK_PRICE)
        price[:n] = KEEP_OUT_PRICE
        program.AddLinearCost(price, 0.0, slacks)
        limited = np.concatenate([self.moved, keep_out_slack, speed_slack])
        self._path, self._bare_path = _no_rows(program, limited), _no_rows(bare, self.moved)
        self._path_key = _key(self._bare_path)
        self._end = self._bare_end = None
        if end_slacks:
            end = np.concatenate([self.moved, end_slack])
            # Slacks to either side of each of the target's coordinates.
            self._end, self._bare_end = _no_end(program, end), _no_end(bare, self.moved)
            self._end_key = _key(self._bare_end)

    def share_cost(self, cost: Binding[Cost]) -> None:
        """Adds a cost of `program`, of `moved` and `size` alone, to `bare` too."""
        self.bare.AddCost(cost)

    def _share_constraint(self, constraint: Binding) -> None:
        self.bare.AddConstraint(constraint)

    def initial_plans(self, state: State, target: State, duration: float) -> list[Plan]:
        """Plans to linearise about, which depend on state and target alone; the likeliest is first.

        Args:
          state, target: (6,) in K, in m and m/s.
          duration: length in s of a plan straight to the target. If time is free, plans round the
            body take longer: by the square root of the ratio of the paths' lengths, as from rest to
            rest at one acceleration, and at most three times as long.
        """
        plans, axes = [], self.limits.keep_out_semi_axes
        for positions in initial_paths(self.fractions, state[:3], target[:3], axes):
            length = np.linalg.norm(np.diff(positions, axis=0), axis=1).sum()
            straight = np.linalg.norm(target[:3] - state[:3])
            longer = np.sqrt(np.clip(length / max(straight, 1e-9 * length, 1e-9), 1.0, 9.0))
            times = (longer if self.stretch.size else 1.0) * duration * self.fractions
            states = np.hstack([positions, np.gradient(positions, times, axis=0)])
            blank = empty_plan(self.horizon.intervals)
            plans.append(dataclasses.replace(blank, times=times, states=states, target=target))
        return plans

    def remaining_plan(
        self, last: Plan, age: float, duration: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """The rest of a plan `age` s old, over the next `duration` s.

        Returns:
          States (N + 1, 6) at the knots and controls (N, 3) of the intervals.
        """
        states, forces = last.rest(age, duration, self.fractions)
        return states, forces / self.limits.thrust

    def linearise(
        self,
        start: State,
        states: States,
        controls: np.ndarray,
        duration: float,
        disturbance: Vector3,
        time: float,
    ) -> None:
        """Linearises the motion and its limits about a plan.

        Args:
          start: (6,) the first state, in K, in m and m/s.
          states, controls: (N + 1, 6) and (N, 3) of the plan to linearise about.
          duration: its length in s.
          disturbance: (3,) in m/s^2, an acceleration that the field does not explain.
          time: of the first state in s.
        """
        rows = condensed_motion(
            self.field,
            self.spin,
            start,
            Reference(states, controls, duration * self.shares),
            self.limits.thrust / self.limits.mass,
            disturbance,
            time,
        )
        rows /= self.units[:, None]
        self._start, self._affine = start, rows
        self.motion, self.drift = rows[:, :, : self.moved.size], rows[:, :, -1]
        self._limits = PathLimits(self.limits, self.units, states[1:])
        self._room = self._limits.room(states[1:] / self.units)

    def aim(self, target: State) -> None:
        """Makes the plan that was linearised last end at the target (6,)."""
        assert self._bare_end is not None
        self._to_go = target / self.units - self.drift[-1]
        self._bare_end.evaluator().UpdateCoefficients(self.motion[-1], self._to_go)

    def solve(self) -> TransitSolution:
        """Solves the program about the plan that was linearised last.

        Raises:
          SolverFailure: the solver finds no solution.
        """
        included, bare = self._room < _NEAR, True
        while True:
            rows = self._limits.rows(self._affine, self.moved.size, included)
            found = self._without_slack(rows, included) if bare else None
            if found is None:
                bare, found = False, self._with_slack(rows)
            moved, slacks = found
            ends = self._ends(moved)
            room = self._limits.room(ends)
            if not bare:
                room += slack_of_limits(slacks[: 2 * self.horizon.intervals])
            missed = ~included & (room < -_TOLERANCE)
            if not missed.any():
                break
            included |= missed
        forces = self.u.size
        return TransitSolution(
            states=np.vstack([self._start, ends * self.units]),
            controls=moved[:forces].reshape(-1, 3),
            stretch=float(np.sum(moved[forces:])),
            slack=float(np.sum(slacks)),
        )

    def _ends(self, moved: np.ndarray) -> np.ndarray:
        """The scaled states (N, 6) at the knots after the first, from the values of z."""
        values = np.zeros(self._affine.shape[2])
        values[: moved.size], values[-1] = moved, 1.0
        return (self._affine.reshape(-1, values.size) @ values).reshape(-1, 6)

    def _without_slack(
        self, rows: np.ndarray, included: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray] | None:
        """z at the optimum and no slacks; None if slack would pay or is needed."""
        _set_rows(self._bare_path, rows[:, : self.moved.size], rows[:, -1])
        result = self._solved(self.bare, False)
        if not (result.is_success() and self._keeps_prices(result, included)):
            return None
        return result.get_x_val()[: self.moved.size], np.zeros(0)

    def _keeps_prices(self, result: MathematicalProgramResult, included: np.ndarray) -> bool:
        """Whether the multipliers of what has slack are below its price."""
        if self._bare_end is not None:
            ends = result.GetDualSolution(self._end_key)
            if not -SLACK_PRICE <= ends.min() <= ends.max() <= SLACK_PRICE:
                return False
        if not included.any():
            return True
        # The slacks of speed are each shared by six limits.
        n, of_limits = self.horizon.intervals, np.zeros(included.size)
        of_limits[included] = np.abs(result.GetDualSolution(self._path_key))
        of_speed = of_limits[n:].reshape(2, n, 3).sum(axis=(0, 2))
        return bool(of_limits[:n].max() <= KEEP_OUT_PRICE and of_speed.max() <= SLACK_PRICE)

    def _with_slack(self, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """z and the slacks at the optimum; raises `SolverFailure` if there is none."""
        _set_rows(self._path, rows[:, :-1], rows[:, -1])
        if self._end is not None:
            eye = np.eye(6)
            matrix = np.hstack([self.motion[-1], eye, -eye])
            self._end.evaluator().UpdateCoefficients(matrix, self._to_go)
        # Iterative refinement of the linear solves takes a third of the time and gives digits
        # beyond the tolerance. So it is used only if the solve fails without it.
        for refined in (False, True):
            result = self._solved(self.program, refined)
            if result.is_success():
                values = result.get_x_val()
                return values[: self.moved.size], values[self._slacks]
        raise SolverFailure(result.get_solution_result())

    def _solved(self, program: MathematicalProgram, refined: bool) -> MathematicalProgramResult:
        return self.solver.Solve(program, None, self.options[refined])

    def plan_of(
        self,
        solution: TransitSolution,
        target: np.ndarray,
        duration: float,
        cost: float,
        iterations: int,
    ) -> Plan:
        """The plan of a solution, `duration` s long, after a number of linearisations."""
        return Plan(
            times=duration * self.fractions,
            states=solution.states,
            forces=solution.controls * self.limits.thrust,
            target=target,
            cost=cost,
            slack=solution.slack,
            status=PlanStatus.SOLVED,
            iterations=iterations,
        )

    def fits(self, plan: Plan, age: float, state: np.ndarray, target: np.ndarray) -> bool:
        """Whether a plan made `age` s ago is so close that one linearisation about it is enough."""
        away = np.abs(np.stack([plan.states_at(np.array([age]))[0] - state, plan.target - target]))
        return bool((away < _CLOSE * self.units).all())


def _solver_options(refined: bool) -> SolverOptions:
    """Clarabel's options, with or without iterative refinement of the linear solves."""
    options = SolverOptions()
    options.SetOption(ClarabelSolver.id(), "iterative_refinement_enable", refined)
    # It finds nothing to leave out.
    options.SetOption(ClarabelSolver.id(), "presolve_enable", False)
    return options


def _no_rows(program: MathematicalProgram, variables: np.ndarray) -> Binding:
    """A constraint for `_set_rows`."""
    empty = np.zeros((1, variables.size))
    return program.AddLinearConstraint(empty, np.zeros(1), np.full(1, np.inf), variables)


def _set_rows(constraint: Binding, rows: np.ndarray, bounds: np.ndarray) -> None:
    """Makes a constraint rows @ variables >= bounds; the number of rows may differ."""
    evaluator = constraint.evaluator()
    if len(bounds) or evaluator.num_constraints():
        evaluator.UpdateCoefficients(rows, bounds, np.full(len(bounds), np.inf))


def _no_end(program: MathematicalProgram, variables: np.ndarray) -> Binding:
    """An equation of six rows that is yet to be set."""
    return program.AddLinearEqualityConstraint(
        np.zeros((6, variables.size)), np.zeros(6), variables
    )


def _key(constraint: Binding) -> Binding:
    """What `GetDualSolution` takes; converting a constraint to it at each call takes 30 us."""
    return Binding[EvaluatorBase](constraint.evaluator(), constraint.variables())
