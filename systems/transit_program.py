"""The expert's optimal control problem as one MathematicalProgram, convexified step by step.

Over the time to go T, split into intervals of constant force that grow with time, minimise the
mean of |u|^2 (u the force over the thrust limit) subject to

* the motion in K, with gravity linearised about the previous plan,
* the thrust limit per axis,
* and, each with an exactly penalised slack so that no state is infeasible: the speed limit per
  axis, the half-space that touches the keep-out ellipsoid below each knot, and the target at the
  last knot.

It knows nothing of a particular body, and nothing of Drake's systems.
"""

from __future__ import annotations

import time

import numpy as np
from pydrake.solvers import ClarabelSolver, MathematicalProgram, SolverOptions

from proxops.systems.ellipsoid import blocks_segment, tangent_half_spaces
from proxops.systems.errors import InputError
from proxops.systems.gravity_field import GravityField
from proxops.systems.plan import Horizon, Plan, TransitLimits

# Terms of the exponential's series for one interval; |A| dt is at most about 0.3.
_EXPONENTIAL_TERMS = 9
# Prices of one scaled unit of slack, against an effort of 0 to 3: above every multiplier, so that
# slack is used only where there is no other way (an exact penalty). Staying out of the keep-out
# ellipsoid goes before speed and arrival.
_KEEP_OUT_PRICE, _SLACK_PRICE = 1000.0, 100.0


class TransitProgram:
    """The convex program of one linearisation, built once and updated at every call."""

    def __init__(self, field: GravityField, spin: float, limits: TransitLimits, horizon: Horizon):
        """Takes the field and spin (rad/s about z) that the plan believes in.

        Raises:
          InputError: the horizon has no length or fewer than two intervals.
        """
        if horizon.knots < 2 or not horizon.minimum > 0.0:
            raise InputError("a plan needs at least 2 knots and a horizon of positive length")
        self.field, self.spin, self.limits, self.horizon = field, spin, limits, horizon
        self._fractions = horizon.fractions()
        # Scaled to numbers of order one.
        self._speed_unit = limits.speed / 4.0
        self._length_unit = float(np.min(limits.keep_out_semi_axes)) / 7.0
        self._units = np.repeat([self._length_unit, self._speed_unit], 3)
        self._build()

    def _build(self) -> None:
        n = self.horizon.knots
        program = MathematicalProgram()
        self._x = program.NewContinuousVariables(n + 1, 6, "x")
        self._u = program.NewContinuousVariables(n, 3, "u")
        keep_out_slack = program.NewContinuousVariables(n, "keep_out_slack")
        speed_slack = program.NewContinuousVariables(n, "speed_slack")
        target_slack = program.NewContinuousVariables(6, "target_slack")
        self._slacks = np.concatenate([keep_out_slack, speed_slack, target_slack])
        zero, free, eye = np.zeros(6), np.full(6, np.inf), np.eye(6)

        self._start = program.AddBoundingBoxConstraint(zero, zero, self._x[0])
        self._motion = [
            program.AddLinearEqualityConstraint(
                np.zeros((6, 15)), zero, np.concatenate([self._x[k], self._u[k], self._x[k + 1]])
            )
            for k in range(n)
        ]
        program.AddBoundingBoxConstraint(-1.0, 1.0, self._u)
        program.AddBoundingBoxConstraint(0.0, np.inf, self._slacks)
        limit = self.limits.speed / self._speed_unit
        both_ways = np.hstack([np.vstack([np.eye(3), -np.eye(3)]), -np.ones((6, 1))])
        for k in range(n):
            velocity = np.append(self._x[k + 1, 3:], speed_slack[k])
            program.AddLinearConstraint(both_ways, -free, np.full(6, limit), velocity)
        self._keep_out = [
            program.AddLinearConstraint(
                np.zeros((1, 4)), [0.0], [np.inf], np.append(self._x[k + 1, :3], keep_out_slack[k])
            )
            for k in range(n)
        ]
        self._target = program.AddLinearConstraint(
            np.block([[eye, eye], [-eye, eye]]),
            np.zeros(12),
            np.full(12, np.inf),
            np.concatenate([self._x[n], target_slack]),
        )
        for share, force in zip(np.diff(self._fractions), self._u, strict=True):
            program.AddQuadraticCost(2.0 * share * np.eye(3), np.zeros(3), force, is_convex=True)
        price = np.full(self._slacks.size, _SLACK_PRICE)
        price[: keep_out_slack.size] = _KEEP_OUT_PRICE
        program.AddLinearCost(price, 0.0, self._slacks)
        self._program = program
        self._solver = ClarabelSolver()
        self._options = SolverOptions()

    def solve(
        self,
        state: np.ndarray,
        target: np.ndarray,
        previous: Plan | None = None,
        age: float = 0.0,
        iterations: int = 1,
    ) -> Plan | None:
        """The plan from `state` (6,) to `target` (6,), or None if the solver fails.

        Args:
          previous: the plan to linearise about first, made `age` seconds ago; None: a guess that
            depends on state and target alone.
          iterations: how often to linearise and solve.
        """
        started = time.perf_counter()
        if not (np.isfinite(state).all() and np.isfinite(target).all()):
            return None  # Drake would end the process.
        duration = self.horizon.time_to_go(state, target)
        if previous is None:
            positions = self._guess(state, target)
        else:
            # The old plan's remaining time and T differ a little: stretch it.
            remaining = max(previous.times[-1] - age, 0.0)
            positions = previous.positions_at(age + self._fractions * remaining)
        plan = None
        for iteration in range(1, iterations + 1):
            self._linearise(positions, duration)
            self._set_ends(state, target)
            result = self._solver.Solve(self._program, None, self._options)
            if not result.is_success():
                return None
            states = result.GetSolution(self._x) * self._units
            plan = Plan(
                times=duration * self._fractions,
                states=states,
                forces=result.GetSolution(self._u) * self.limits.thrust,
                cost=float(result.get_optimal_cost()),
                slack=float(np.sum(result.GetSolution(self._slacks))),
                status=0,
                iterations=iteration,
                solve_time=time.perf_counter() - started,
            )
            positions = states[:, :3]
        return plan

    def _guess(self, state: np.ndarray, target: np.ndarray) -> np.ndarray:
        """Positions (N + 1, 3) at the knots from state and target alone.

        A straight line; where the keep-out ellipsoid is in the way, an arc over it instead: in
        coordinates that make it a sphere, the great circle from start to target, by the shortest
        axis where they are opposite, at the radius interpolated between the ends' and no less
        than the sphere's.
        """
        share = (self._fractions**2 * (3.0 - 2.0 * self._fractions))[:, None]
        axes = self.limits.keep_out_semi_axes
        start, end = state[:3], target[:3]
        if not blocks_segment(axes, start, end):
            return start + share * (end - start)
        a, b = start / axes, end / axes
        radius_a, radius_b = np.linalg.norm(a), np.linalg.norm(b)
        over = np.zeros(3)
        over[np.argmin(axes)] = 1.0
        unit_a = a / radius_a if radius_a > 1e-9 else over
        unit_b = b / radius_b if radius_b > 1e-9 else over
        middle = unit_a + unit_b
        # The less the ends' directions say which way round, the more the fixed axis says.
        middle = middle + over * max(0.0, 0.2 - float(np.linalg.norm(middle)))
        middle /= max(float(np.linalg.norm(middle)), 1e-9)
        arc = (1.0 - share) ** 2 * unit_a + 2.0 * share * (1.0 - share) * middle + share**2 * unit_b
        arc /= np.linalg.norm(arc, axis=1, keepdims=True)
        radius = np.maximum((1.0 - share) * radius_a + share * radius_b, 1.0)
        return arc * radius * axes

    def _linearise(self, positions: np.ndarray, duration: float) -> None:
        """Motion and keep-out about positions (N + 1, 3) at the knots."""
        n = self.horizon.knots
        middle = 0.5 * (positions[1:] + positions[:-1])
        gravity = self.field.evaluate(middle)
        gradient = gravity.gradient.copy()
        constant = gravity.acceleration - np.einsum("nij,nj->ni", gradient, middle)
        gradient[:, [0, 1], [0, 1]] += self.spin**2

        # d/dt (x, u, 1), scaled: exact for this linear motion by the exponential's series.
        rates = np.zeros((n, 10, 10))
        rates[:, [0, 1, 2], [3, 4, 5]] = self._speed_unit / self._length_unit
        rates[:, 3:6, 0:3] = gradient * (self._length_unit / self._speed_unit)
        rates[:, 3, 4], rates[:, 4, 3] = 2.0 * self.spin, -2.0 * self.spin
        force_unit = self.limits.thrust / self.limits.mass / self._speed_unit
        rates[:, [3, 4, 5], [6, 7, 8]] = force_unit
        rates[:, 3:6, 9] = constant / self._speed_unit
        rates *= (duration * np.diff(self._fractions))[:, None, None]
        term = rates
        step = np.eye(10) + rates
        for k in range(2, _EXPONENTIAL_TERMS):
            term = term @ rates / k
            step += term

        coefficients = np.empty((n, 6, 15))
        coefficients[:, :, :9] = step[:, :6, :9]
        coefficients[:, :, 9:] = -np.eye(6)
        normals, offsets = tangent_half_spaces(self.limits.keep_out_semi_axes, positions[1:])
        rows = np.ones((n, 1, 4))
        rows[:, 0, :3] = normals
        bounds = offsets / self._length_unit
        free = [np.inf]
        for k in range(n):
            self._motion[k].evaluator().UpdateCoefficients(coefficients[k], -step[k, :6, 9])
            self._keep_out[k].evaluator().UpdateCoefficients(rows[k], bounds[k : k + 1], free)

    def _set_ends(self, state: np.ndarray, target: np.ndarray) -> None:
        scaled = state / self._units
        self._start.evaluator().set_bounds(scaled, scaled)
        scaled = target / self._units
        self._target.evaluator().set_bounds(np.concatenate([scaled, -scaled]), np.full(12, np.inf))
