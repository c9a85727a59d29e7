"""The expert's optimal control problem, solved by successive convexification.

A plan takes a free time T, in intervals of constant force whose lengths keep their ratio. With u
the force over the thrust limit, the program minimises::

    integral over T of  w + |u|_2^2 + c |u|_1

subject to

* the motion in K, with gravity linearised about the previous plan and the step linear in T,
* the thrust limit per axis,
* the speed limit per axis, the half-space that touches the keep-out ellipsoid where the line from
  its centre to a knot leaves it, for each knot, and the target at the last knot. Each of these has
  an exactly penalised slack, so that every state is feasible.

T is chosen by the same cost. So the rest of an optimal plan is the optimal plan from there on
(Bellman), while T is above three times its least value: no clock is needed to keep the plan's end
where it is during the flight.
`Horizon.nominal_acceleration` sets w. `Horizon.fuel_weight`, c, trades smoothness for fuel. Close
to the target T reaches its least value, and from then on the horizon recedes. There c falls to
zero, because 1-norm effort over a receding horizon postpones thrust for ever.

The program knows no particular body and no Drake system.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from pydrake.solvers import SolutionResult

from proxops.systems.common import SolverFailure, State, Vector3, kernel
from proxops.systems.expert.linearised_transit import KEEP_OUT_PRICE, LinearisedTransit
from proxops.systems.expert.plan import Horizon, Plan
from proxops.systems.gravity import Field
from proxops.systems.rotation import Spin, spin_model
from proxops.systems.vehicle import FlightLimits

# T changes by at most this share in one linearisation.
_TRUSTED_STRETCH = 0.1
# Curvature of the cost in T over its slope. The linearised program has only two thirds of it by
# itself; without the rest T would jump to and fro across its best value. From rest to rest, with
# c = 0, the cost is w T + K / T^3, least where 3 K = w T^4. In the relative change of T the true
# curvature there is 4 w T; linearised motion gives 8 w T / 3.
_STRETCH_CURVATURE = 1.0
# Without a plan: linearisations of all initial guesses; after them only the best is improved. A
# guess is better than an earlier one if its plan costs less than this share of the other's.
_TRIED, _CLEARLY_LESS = 5, 0.999


class _Task(NamedTuple):
    """What a plan is for: see `TransitProgram.solve`."""

    state: np.ndarray
    target: np.ndarray
    disturbance: np.ndarray
    longest: float
    time: float


class TransitProgram:
    """The convex program of one linearisation, built once and updated at every call."""

    def __init__(self, field: Field, spin: Spin, limits: FlightLimits, horizon: Horizon):
        """Takes the assumed field and spin, the limits and the horizon.

        A spin that is a number is in rad/s about z.
        """
        spin = spin_model(spin)
        self.transit = LinearisedTransit(
            field, spin, limits, horizon, free_time=True, one_norm=True, meets_target=True
        )
        self.field, self.spin, self.limits, self.horizon = field, spin, limits, horizon
        # Without gravity, and with quadratic effort, the mean of |u|^2 from rest to rest over d is
        # 12 (m d / F)^2 / T^4. With this w the best time is then sqrt(4 d / a).
        share = limits.mass * horizon.nominal_acceleration / limits.thrust
        self.time_price = 2.25 * share**2
        program, transit = self.transit.program, self.transit
        self._fuel_shares = np.repeat(transit.shares, 3)
        self._fuel = program.AddLinearCost(np.zeros(transit.size.size), 0.0, transit.size)
        self._time = program.AddQuadraticCost(
            np.eye(1), np.zeros(1), transit.stretch, is_convex=True
        )
        transit.share_cost(self._fuel)
        transit.share_cost(self._time)

    def solve(
        self,
        state: State,
        target: State,
        previous: Plan | None = None,
        age: float = 0.0,
        iterations: int = 1,
        disturbance: Vector3 | None = None,
        longest: float = np.inf,
        time: float = 0.0,
    ) -> Plan:
        """The plan from `state` (6,) to `target` (6,).

        Args:
          state, target: in K, in m and m/s.
          previous: the plan to linearise about first, made `age` seconds ago; None: initial guesses
            that depend on state and target alone, either way round the keep-out ellipsoid.
          age: in s.
          iterations: number of linearisations.
          disturbance: (3,) in m/s^2, an acceleration that the field does not explain; None: none.
          longest: length in s that a plan should not exceed. A longer one is shortened by up to a
            tenth in each iteration.
          time: of `state` in s.

        Raises:
          SolverFailure: the state or the target is not finite, or the solver fails.
        """
        if not (np.isfinite(state).all() and np.isfinite(target).all()):
            raise SolverFailure(SolutionResult.kInvalidInput)  # Drake would end the process.
        task = _Task(
            state, target, np.zeros(3) if disturbance is None else disturbance, longest, time
        )
        last, done = previous, 0
        if last is None:
            done = min(iterations, _TRIED)
            last, age = self._best_start(task, done), 0.0
        for iteration in range(done + 1, iterations + 1):
            last = self._improved(task, last, age, iteration)
            age = 0.0
        return last

    def _best_start(self, task: _Task, iterations: int) -> Plan:
        """The best plan after a number of iterations from each of the initial guesses.

        Raises:
          SolverFailure: no guess leads to a plan; the failure is that of the last guess.
        """
        best, failure = None, None
        duration = self.horizon.time_to_go(task.state, task.target)
        for plan in self.transit.initial_plans(task.state, task.target, duration):
            try:
                for k in range(1, iterations + 1):
                    plan = self._improved(task, plan, 0.0, k, k > 1)
            except SolverFailure as error:
                failure = error
                continue
            if best is None or _total_cost(plan) < _CLEARLY_LESS * _total_cost(best):
                best = plan
        if best is None:
            assert failure is not None
            raise failure
        return best

    def fits(self, plan: Plan, age: float, state: np.ndarray, target: np.ndarray) -> bool:
        """Whether a plan made `age` s ago is so close that one linearisation about it is enough."""
        return self.transit.fits(plan, age, state, target)

    def _improved(
        self, task: _Task, last: Plan, age: float, iteration: int, free_time: bool = True
    ) -> Plan:
        """The solution of the program linearised about `last`, `age` s old."""
        least = self.horizon.minimum
        duration = max(last.times[-1] - age, least)
        states, controls = self.transit.remaining_plan(last, age, duration)
        transit = self.transit
        transit.linearise(task.state, states, controls, duration, task.disturbance, task.time)
        transit.aim(task.target)
        self._fuel.evaluator().UpdateCoefficients(self.fuel_weight(duration) * self._fuel_shares)
        price = np.array([self.time_price + self._mean_effort(controls, duration)])
        self._time.evaluator().UpdateCoefficients(_STRETCH_CURVATURE * price[None], price)
        shorter = max(-_TRUSTED_STRETCH, least / duration - 1.0) if free_time else 0.0
        longer = (
            min(_TRUSTED_STRETCH, max(shorter, task.longest / duration - 1.0)) if free_time else 0.0
        )
        transit.stretch_bounds.evaluator().set_bounds([shorter], [longer])
        found = transit.solve()
        duration *= 1.0 + found.stretch
        cost = duration * (self.time_price + self._mean_effort(found.controls, duration))
        return transit.plan_of(found, task.target, duration, cost, iteration)

    def fuel_weight(self, duration: float) -> float:
        """The weight c for a plan of this length: 0 for the shortest, full from 3 times that on."""
        beyond = 0.5 * (duration / self.horizon.minimum - 1.0)
        return self.horizon.fuel_weight * min(max(beyond, 0.0), 1.0)

    def _mean_effort(self, controls: np.ndarray, duration: float) -> float:
        """Mean of |u|_2^2 + c |u|_1 over a plan, for controls u (N, 3)."""
        return _mean_effort(controls, self.transit.shares, self.fuel_weight(duration))


@kernel(error_model="numpy")
def _mean_effort(controls, shares, fuel_weight):
    mean = 0.0
    for k in range(shares.size):
        for i in range(3):
            size = abs(controls[k, i])
            mean += shares[k] * size * (size + fuel_weight)
    return mean


def _total_cost(plan: Plan) -> float:
    """The cost of a plan, with the highest price for its slack."""
    return plan.cost + KEEP_OUT_PRICE * plan.slack * float(plan.times[-1])
