"""The paper's optimal control problem: weighted state error against weighted effort.

A plan always takes the same time, in intervals of constant force whose lengths keep their ratio.
With e the difference of state and target, in units of `ErrorWeights`, and u the force over the
thrust limit, the program minimises::

    mean over the plan of  |e_position|_2^2 + |e_velocity|_2^2 + |u|_2^2

The errors are those at the end of each interval. Motion and limits are those of
`LinearisedTransit`. There is no terminal constraint: the spacecraft comes to rest beside the
target, where error and hover thrust together cost least. The shorter the horizon is, the greater is
that distance.

The interface is that of `TransitProgram`, which flies better. This program is for comparison.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from pydrake.solvers import SolutionResult

from proxops.systems.common import FAR, LONG, SolverFailure, check_positive, config, number
from proxops.systems.expert.linearised_transit import LinearisedTransit, TransitSolution
from proxops.systems.expert.plan import Horizon, Plan
from proxops.systems.gravity import Field
from proxops.systems.rotation import Spin, spin_model
from proxops.systems.vehicle import FlightLimits


@config
class WeightedCostConfig:
    """The paper's cost; see `proxops.systems.WeightedProgram`."""

    # Length of every plan in time.
    horizon_s: float = number(3000.0, at_least=1e-2, at_most=LONG, unit="s")
    # These errors cost as much as full thrust along one axis.
    position_error_m: float = number(10.0e3, at_least=1e-3, at_most=FAR, unit="m")
    speed_error_m_s: float = number(20.0, at_least=1e-6, at_most=1e5, unit="m/s")


@dataclass(frozen=True)
class ErrorWeights:
    """Errors in m and m/s that cost as much as full thrust along one axis (Bryson's rule)."""

    position: float
    speed: float


class WeightedProgram:
    """The convex program of one linearisation, built once and updated at every call."""

    def __init__(
        self,
        field: Field,
        spin: Spin,
        limits: FlightLimits,
        horizon: Horizon,
        weights: ErrorWeights,
    ):
        """Takes the assumed field and spin, limits, horizon and weights.

        A spin that is a number is in rad/s about z.
        Every plan is `horizon.minimum` long. Of the horizon's other values only `intervals` and
        `interval_growth` are used.
        """
        check_positive("ErrorWeights", position=weights.position, speed=weights.speed)
        spin = spin_model(spin)
        self.transit = LinearisedTransit(field, spin, limits, horizon, free_time=False)
        self.field, self.spin, self.limits, self.horizon = field, spin, limits, horizon
        units = self.transit.units
        # Weights of the squared errors of the scaled states.
        self._weights = (units / np.repeat([weights.position, weights.speed], 3)) ** 2
        u = self.transit.u
        self._error = self.transit.program.AddQuadraticCost(
            np.zeros((u.size, u.size)), np.zeros(u.size), u, is_convex=True
        )
        self.transit.share_cost(self._error)

    def solve(
        self,
        state: np.ndarray,
        target: np.ndarray,
        previous: Plan | None = None,
        age: float = 0.0,
        iterations: int = 1,
        disturbance: np.ndarray | None = None,
        longest: float = np.inf,
        time: float = 0.0,
    ) -> Plan:
        """Solves for a plan: see `TransitProgram.solve`.

        `Plan.cost` is the minimised mean times the plan's length, which is fixed: `longest` changes
        nothing.
        """
        if not (np.isfinite(state).all() and np.isfinite(target).all()):
            raise SolverFailure(SolutionResult.kInvalidInput)  # Drake would end the process.
        duration = self.horizon.minimum
        last = previous or self.transit.initial_plans(state, target, duration)[0]
        disturbance = np.zeros(3) if disturbance is None else disturbance
        for iteration in range(1, iterations + 1):
            states, controls = self.transit.remaining_plan(last, age, duration)
            self.transit.linearise(state, states, controls, duration, disturbance, time)
            self._weigh_errors(target)
            found = self.transit.solve()
            cost = duration * self._mean_cost(found, target)
            last = self.transit.plan_of(found, target, duration, cost, iteration)
            age = 0.0
        return last

    def fits(self, plan: Plan, age: float, state: np.ndarray, target: np.ndarray) -> bool:
        """Whether a plan made `age` s ago is so close that one linearisation about it is enough."""
        return self.transit.fits(plan, age, state, target)

    def _weigh_errors(self, target: np.ndarray) -> None:
        """Sets the cost of u to the mean of |e|^2, without its constant term."""
        motion, wanted = self.transit.motion, target / self.transit.units - self.transit.drift
        weighted = motion * (self.transit.shares[:, None] * self._weights)[:, :, None]
        curvature = 2.0 * np.sum(weighted.transpose(0, 2, 1) @ motion, axis=0)
        linear = -2.0 * np.sum(wanted[:, None] @ weighted, axis=(0, 1))
        self._error.evaluator().UpdateCoefficients(curvature, linear, 0.0, is_convex=True)

    def _mean_cost(self, found: TransitSolution, target: np.ndarray) -> float:
        error = (found.states[1:] - target) / self.transit.units
        weighted = error**2 @ self._weights + np.sum(found.controls**2, axis=1)
        return float(self.transit.shares @ weighted)
