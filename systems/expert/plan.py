"""`Plan`, the result of the MPC, with the `Horizon` it is made for."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import IntEnum
from typing import Protocol, runtime_checkable

import numpy as np

from proxops.systems.common import (
    InputError,
    State,
    States,
    Values,
    Vector3,
    Vectors3,
    check_not_negative,
    check_positive,
    kernel,
)
from proxops.systems.gravity import Field
from proxops.systems.rotation import SpinModel
from proxops.systems.vehicle import FlightLimits

_MOST_INTERVALS = 1000


class PlanStatus(IntEnum):
    """How a plan was made. Higher numbers are fallbacks."""

    SOLVED = 0
    """The program was solved."""
    LAST_PLAN_CONTINUED = 1
    """The solver failed: the rest of the last plan that was solved."""
    BRAKING = 2
    """The solver failed and there is no last plan: braking to rest, or no force without a state."""


class PlanReason(IntEnum):
    """How a plan was solved, and why in that way; for a fallback, why the solver failed."""

    SOLVED_ABOUT_LAST_PLAN = 0
    """The program was linearised once, about the last plan."""
    SOLVED_ANEW_NO_PLAN = 1
    """There is no last plan. The program was linearised `cold_iterations` times."""
    SOLVED_ANEW_PLAN_TOO_OLD = 2
    """The last plan is more than one step old. The program was linearised until it settled."""
    SOLVED_ANEW_PLAN_ELSEWHERE = 3
    """The last plan does not fit the state or the target. The program was linearised
    `cold_iterations` times."""
    SOLVED_ANEW_AFTER_FAILURE = 4
    """The solver failed about the last plan and succeeded without it."""
    INPUT_NOT_FINITE = 5
    """The state or the target has infinities or NaN."""
    SOLVER_INFEASIBLE = 6
    """The solver found the program infeasible."""
    SOLVER_ITERATION_LIMIT = 7
    """The solver did not converge in time."""
    SOLVER_ERROR = 8
    """The solver failed otherwise, numerically for instance."""


@dataclass(frozen=True)
class Plan:
    """A plan to the target, in K. It begins when its first force takes effect."""

    times: np.ndarray
    """(N + 1,) knots in s from the plan's own start."""
    states: States
    """(N + 1, 6) in m and m/s."""
    forces: Vectors3
    """(N, 3) in N, constant between knots."""
    target: State
    """(6,) in m and m/s: where the plan should end; it does so if `slack` is 0."""
    cost: float
    """The integral that the program minimises, in s, without the price of slack."""
    slack: float
    """Sum of all slacks in scaled units; 0 if the plan keeps every limit and reaches the target."""
    status: int
    """A `PlanStatus`. 0: solved; 1: the last plan, continued; 2: braking, for there is no plan,
    or no force, for there is no state either."""
    iterations: int
    """Number of linearisations."""
    solve_time: float = 0.0
    """Wall time of the MPC's step in s; the controller sets it."""
    reason: int = PlanReason.SOLVED_ANEW_NO_PLAN
    """A `PlanReason`; the controller sets it."""
    disturbance: Vector3 = field(default_factory=lambda: np.zeros(3))
    """(3,) in m/s^2: the assumed acceleration besides gravity and thrust."""

    def states_at(self, times: Values) -> np.ndarray:
        """States (M, 6) at times (M,): linear between knots, constant past the last knot."""
        return _interpolated(times, self.times, self.states)

    def forces_at(self, times: Values) -> np.ndarray:
        """Forces (M, 3) at times (M,); outside the plan those of its first or last interval."""
        return _of_intervals(times, self.times, self.forces)

    def rest(
        self, start: float, duration: float, fractions: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """States (N + 1, 6) and forces (N, 3) from the time `start` on, for `duration` s.

        Args:
          fractions: (N + 1,) knots as shares of the duration. A force is that at the middle.
        """
        return _rest(self.times, self.states, self.forces, float(start), duration, fractions)


@kernel(error_model="numpy")
def _interpolated(times, knots, values):
    """Values (M, K) at times (M,), linear between knots (N,) and constant beyond them."""
    found = np.empty((times.size, values.shape[1]))
    for m in range(times.size):
        time = min(max(times[m], knots[0]), knots[-1])
        after = min(max(np.searchsorted(knots, time, side="right"), 1), knots.size - 1)
        length = knots[after] - knots[after - 1]
        share = (time - knots[after - 1]) / length if length > 0.0 else 1.0
        for k in range(values.shape[1]):
            before = values[after - 1, k]
            found[m, k] = before + share * (values[after, k] - before)
    return found


@kernel(error_model="numpy")
def _of_intervals(times, knots, values):
    """Values (M, K) at times (M,), constant between knots (N + 1,) and beyond them, of (N, K)."""
    found = np.empty((times.size, values.shape[1]))
    for m in range(times.size):
        at = np.searchsorted(knots, times[m], side="right") - 1
        at = min(max(at, 0), values.shape[0] - 1)
        for k in range(values.shape[1]):  # A slice takes numba seconds to compile.
            found[m, k] = values[at, k]
    return found


@kernel(error_model="numpy")
def _rest(knots, states, forces, start, duration, fractions):
    """See `Plan.rest`."""
    times = start + duration * fractions
    middle = 0.5 * (times[1:] + times[:-1])
    return _interpolated(times, knots, states), _of_intervals(middle, knots, forces)


def empty_plan(intervals: int) -> Plan:
    """A plan without thrust, with a number of intervals: a blank to fill in."""
    return Plan(
        times=np.zeros(intervals + 1),
        states=np.zeros((intervals + 1, 6)),
        forces=np.zeros((intervals, 3)),
        target=np.zeros(6),
        cost=np.nan,
        slack=np.nan,
        status=PlanStatus.BRAKING,
        iterations=0,
    )


@dataclass(frozen=True)
class Horizon:
    """Length of a plan, its trade of time against effort, and its division into intervals.

    `MpcConfig` explains the first four.
    """

    intervals: int = 16
    interval_growth: float = 4.0
    nominal_acceleration: float = 0.03
    """a in m/s^2."""
    fuel_weight: float = 0.8
    minimum: float = 300.0
    """Least length of a plan in s."""

    def __post_init__(self) -> None:
        """Raises `InputError` for a horizon that has no length or fewer than two intervals."""
        if not 2 <= self.intervals <= _MOST_INTERVALS:
            raise InputError(
                f"a plan needs at least 2 intervals and at most {_MOST_INTERVALS}, "
                f"got {self.intervals}"
            )
        check_positive(
            "Horizon",
            interval_growth=self.interval_growth,
            nominal_acceleration=self.nominal_acceleration,
            minimum=self.minimum,
        )
        check_not_negative("Horizon", fuel_weight=self.fuel_weight)

    def time_to_go(self, state: State, target: State) -> float:
        """An initial guess of the plan's length T, in s, from state (6,) and target (6,) alone.

        Without gravity, the motion of least quadratic effort from rest to rest over the distance D
        takes T_0 = sqrt(4 D / a). At the share s of T_0 the distance to go is
        d = D (1 - s)^2 (1 + 2 s) and the closing speed is v = 6 D s (1 - s) / T_0. Solved for s,
        with q = v^2 / (a d), this gives the time left on that motion::

            s = (q + sqrt(q^2 + 9 q)) / 9        T = (1 - s) T_0 = sqrt(4 d / (a (1 + 2 s)))

        Along that motion T falls by one second a second. For fast arrivals it tends to 3 d / v, the
        time that braking takes. For a speed away from the target it is the time from rest. It is
        at least `minimum`.
        """
        away = target[:3] - state[:3]
        distance = float(np.linalg.norm(away))
        if distance == 0.0:
            return self.minimum
        closing = max(0.0, float(away @ (state[3:] - target[3:])) / distance)
        a = self.nominal_acceleration
        q = closing**2 / (a * distance)
        share = (q + np.sqrt(q**2 + 9.0 * q)) / 9.0
        return max(self.minimum, float(np.sqrt(4.0 * distance / (a * (1.0 + 2.0 * share)))))

    def fractions(self) -> np.ndarray:
        """Knots (N + 1,) as shares of T."""
        lengths = np.linspace(1.0, self.interval_growth, self.intervals)
        return np.concatenate([[0.0], np.cumsum(lengths) / lengths.sum()])


@runtime_checkable
class PlanProgram(Protocol):
    """The interface of the programs that the MPC can solve."""

    field: Field
    spin: SpinModel
    limits: FlightLimits
    horizon: Horizon

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
        """Solves for a plan: see `TransitProgram.solve`."""
        ...

    def fits(self, plan: Plan, age: float, state: np.ndarray, target: np.ndarray) -> bool:
        """Whether one linearisation is enough: see `TransitProgram.fits`."""
        ...
