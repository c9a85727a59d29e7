"""The expert's optimal control problem as one MathematicalProgram, convexified step by step.

A plan takes the time T, which is free, in intervals of constant force whose lengths keep their
ratio. With u the force over the thrust limit, minimise::

    integral over T of  w + |u|_2^2 + c |u|_1

subject to

* the motion in K, with gravity linearised about the previous plan and the step linear in T,
* the thrust limit per axis,
* and, each with an exactly penalised slack so that no state is infeasible: the speed limit per
  axis, the half-space that touches the keep-out ellipsoid below each knot, and the target at the
  last knot.

As T is chosen by the same cost, what is left of an optimal plan is the optimal plan of what is
left (Bellman): no clock is needed for the end of the plan to stay where it is while it is flown.
w is set by `Horizon.nominal_acceleration`; c, `Horizon.fuel_weight`, trades smoothness for fuel.
Close to the target T comes to its least value; it is then a receding horizon, and c falls to zero
there, for 1-norm effort over a receding horizon puts thrust off for ever.

It knows nothing of a particular body, and nothing of Drake's systems.
"""

from __future__ import annotations

import time

import numpy as np
from pydrake.solvers import (
    ClarabelSolver,
    MathematicalProgram,
    MathematicalProgramResult,
    SolutionResult,
    SolverOptions,
)

from proxops.systems.ellipsoid import tangent_half_spaces
from proxops.systems.errors import InputError, SolverFailure
from proxops.systems.first_guess import first_positions
from proxops.systems.gravity_field import Field
from proxops.systems.plan import Horizon, Plan, TransitLimits

# Terms of the exponential's series for one interval; |A| dt is at most about 0.3.
_EXPONENTIAL_TERMS = 9
# Prices of one scaled unit of slack, against an effort of 0 to 3: above every multiplier, so that
# slack is used only where there is no other way (an exact penalty). Staying out of the keep-out
# ellipsoid goes before speed and arrival.
_KEEP_OUT_PRICE, _SLACK_PRICE = 1000.0, 100.0
# A plan is close whose state now and target are within this many units: 0.5 km and 0.5 m/s.
_CLOSE = 0.05
# T changes by no more than this share in one linearisation.
_TRUSTED_STRETCH = 0.1
# Curvature of the cost in T over its slope; the program sees only two thirds of it by itself, and
# would jump to and fro across the best T without the rest.
_STRETCH_CURVATURE = 1.0


class TransitProgram:
    """The convex program of one linearisation, built once and updated at every call."""

    def __init__(self, field: Field, spin: float, limits: TransitLimits, horizon: Horizon):
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
        # Without gravity, the best time from rest to rest over d is sqrt(4 d / a) for this w and
        # quadratic effort: the mean of |u|^2 is then 12 (m d / F)^2 / T^4.
        share = limits.mass * horizon.nominal_acceleration / limits.thrust
        self._time_price = 2.25 * share**2
        self._build()

    def _build(self) -> None:
        n = self.horizon.knots
        program = MathematicalProgram()
        self._x = program.NewContinuousVariables(n + 1, 6, "x")
        # Force over its limit along +x, +y, +z, -x, -y, -z, none negative: linear cost of the sum
        # is then the 1-norm.
        self._u = program.NewContinuousVariables(n, 6, "u")
        self._stretch = program.NewContinuousVariables(1, "stretch")  # Change of T over T.
        keep_out_slack = program.NewContinuousVariables(n, "keep_out_slack")
        speed_slack = program.NewContinuousVariables(n, "speed_slack")
        target_slack = program.NewContinuousVariables(6, "target_slack")
        self._slacks = np.concatenate([keep_out_slack, speed_slack, target_slack])
        zero, free, eye = np.zeros(6), np.full(6, np.inf), np.eye(6)

        self._start = program.AddBoundingBoxConstraint(zero, zero, self._x[0])
        self._motion = [
            program.AddLinearEqualityConstraint(
                np.zeros((6, 19)),
                zero,
                np.concatenate([self._x[k], self._u[k], self._x[k + 1], self._stretch]),
            )
            for k in range(n)
        ]
        program.AddBoundingBoxConstraint(0.0, 1.0, self._u)
        self._stretch_bounds = program.AddBoundingBoxConstraint(0.0, 0.0, self._stretch)
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
            program.AddQuadraticCost(2.0 * share * np.eye(6), np.zeros(6), force, is_convex=True)
        self._fuel = program.AddLinearCost(np.zeros(6 * n), 0.0, self._u.ravel())
        self._time = program.AddQuadraticCost(np.eye(1), np.zeros(1), self._stretch, is_convex=True)
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
        push: np.ndarray | None = None,
    ) -> Plan:
        """The plan from `state` (6,) to `target` (6,).

        Args:
          previous: the plan to linearise about first, made `age` seconds ago; None: a guess that
            depends on state and target alone.
          iterations: how often to linearise and solve.
          push: (3,) in m/s^2, an acceleration that the field does not explain; None: none.

        Raises:
          SolverFailure: the state or the target is not finite, or the solver fails.
        """
        started = time.perf_counter()
        if not (np.isfinite(state).all() and np.isfinite(target).all()):
            raise SolverFailure(SolutionResult.kInvalidInput)  # Drake would end the process.
        last = self._first_plan(state, target) if previous is None else previous
        cold = previous is None
        self._push = np.zeros(3) if push is None else push
        for iteration in range(1, iterations + 1):
            result, duration = self._improve(state, target, last, age, cold and iteration == 1)
            if not result.is_success():
                raise SolverFailure(result.get_solution_result())
            up_down = result.GetSolution(self._u)
            controls = up_down[:, :3] - up_down[:, 3:]
            duration *= 1.0 + float(result.GetSolution(self._stretch)[0])
            last = Plan(
                times=duration * self._fractions,
                states=result.GetSolution(self._x) * self._units,
                forces=controls * self.limits.thrust,
                target=target,
                cost=duration * (self._time_price + self._mean_effort(controls, duration)),
                slack=float(np.sum(result.GetSolution(self._slacks))),
                status=0,
                iterations=iteration,
                solve_time=time.perf_counter() - started,
            )
            age = 0.0
        return last

    def fits(self, plan: Plan, age: float, state: np.ndarray, target: np.ndarray) -> bool:
        """Whether a plan made `age` s ago is so close that one linearisation about it will do."""
        away = np.abs(np.stack([plan.states_at(np.array([age]))[0] - state, plan.target - target]))
        return bool((away < _CLOSE * self._units).all())

    def _first_plan(self, state: np.ndarray, target: np.ndarray) -> Plan:
        """Something to linearise about that depends on state and target alone."""
        times = self.horizon.time_to_go(state, target) * self._fractions
        axes = self.limits.keep_out_semi_axes
        positions = first_positions(self._fractions, state[:3], target[:3], axes)
        states = np.hstack([positions, np.gradient(positions, times, axis=0)])
        return Plan(times, states, np.zeros((len(times) - 1, 3)), target, 0.0, 0.0, 0, 0, 0.0)

    def _improve(
        self, state: np.ndarray, target: np.ndarray, last: Plan, age: float, fixed_time: bool
    ) -> tuple[MathematicalProgramResult, float]:
        """Solves the program linearised about `last`, `age` s old; returns its T before stretch."""
        least = self.horizon.minimum
        duration = max(last.times[-1] - age, least)
        times = age + duration * self._fractions
        states = last.states_at(times)
        controls = last.forces_at(0.5 * (times[1:] + times[:-1])) / self.limits.thrust

        self._linearise(states, controls, duration)
        scaled = state / self._units
        self._start.evaluator().set_bounds(scaled, scaled)
        scaled = target / self._units
        self._target.evaluator().set_bounds(np.concatenate([scaled, -scaled]), np.full(12, np.inf))
        shares = np.repeat(np.diff(self._fractions), 6)
        self._fuel.evaluator().UpdateCoefficients(self._fuel_weight(duration) * shares)
        price = np.array([self._time_price + self._mean_effort(controls, duration)])
        self._time.evaluator().UpdateCoefficients(_STRETCH_CURVATURE * price[None], price)
        shorter = 0.0 if fixed_time else max(-_TRUSTED_STRETCH, least / duration - 1.0)
        longer = 0.0 if fixed_time else _TRUSTED_STRETCH
        self._stretch_bounds.evaluator().set_bounds([shorter], [longer])
        return self._solver.Solve(self._program, None, self._options), duration

    def _fuel_weight(self, duration: float) -> float:
        """c for a plan of this length: none at the shortest, all from three times that on."""
        beyond = 0.5 * (duration / self.horizon.minimum - 1.0)
        return self.horizon.fuel_weight * min(max(beyond, 0.0), 1.0)

    def _mean_effort(self, controls: np.ndarray, duration: float) -> float:
        """Mean of |u|_2^2 + c |u|_1 over a plan, for controls u (N, 3)."""
        effort = controls**2 + self._fuel_weight(duration) * np.abs(controls)
        return float(np.diff(self._fractions) @ np.sum(effort, axis=1))

    def _linearise(self, states: np.ndarray, controls: np.ndarray, duration: float) -> None:
        """Motion and keep-out about states (N + 1, 6) at the knots and controls (N, 3) between."""
        n = self.horizon.knots
        positions = states[:, :3]
        middle = 0.5 * (positions[1:] + positions[:-1])
        gravity = self.field.evaluate(middle)
        gradient = gravity.gradient.copy()
        constant = gravity.acceleration - np.einsum("nij,nj->ni", gradient, middle) + self._push
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

        motion = np.empty((n, 6, 19))
        motion[:, :, :9] = step[:, :6, :9]
        motion[:, :, 9:12] = -step[:, :6, 6:9]
        motion[:, :, 12:18] = -np.eye(6)
        # A longer T makes each step longer: d exp(A) / dT along the plan.
        flown = np.concatenate([states[:-1] / self._units, controls, np.ones((n, 1))], axis=1)
        motion[:, :, 18] = np.einsum("nij,nj->ni", rates, np.einsum("nij,nj->ni", step, flown))[
            :, :6
        ]
        normals, offsets = tangent_half_spaces(self.limits.keep_out_semi_axes, positions[1:])
        rows = np.ones((n, 1, 4))
        rows[:, 0, :3] = normals
        bounds = offsets / self._length_unit
        free = [np.inf]
        for k in range(n):
            self._motion[k].evaluator().UpdateCoefficients(motion[k], -step[k, :6, 9])
            self._keep_out[k].evaluator().UpdateCoefficients(rows[k], bounds[k : k + 1], free)
