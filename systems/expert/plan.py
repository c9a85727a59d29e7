"""A plan of the expert, what bounds it, and how long it is."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import IntEnum
from typing import Protocol

import numpy as np

from proxops.systems.gravity import Field


class PlanStatus(IntEnum):
    """Which of the three a plan is, in the order of fallback."""

    SOLVED = 0
    """A fresh solution."""
    LAST_PLAN_CONTINUED = 1
    """The last plan that was solved, shifted to now."""
    BRAKING = 2
    """For want of any plan."""


class PlanReason(IntEnum):
    """Why a plan was solved the way it was; of a fallback, why nothing could be solved."""

    SOLVED_ABOUT_LAST_PLAN = 0
    """Linearised once, about the last plan."""
    SOLVED_ANEW_NO_PLAN = 1
    """As often as without a recent plan: there is none."""
    SOLVED_ANEW_PLAN_TOO_OLD = 2
    """The last plan is more than a step old: as often as it takes to settle."""
    SOLVED_ANEW_PLAN_ELSEWHERE = 3
    """The state or the target is not where the last plan has it."""
    SOLVED_ANEW_AFTER_FAILURE = 4
    """The solver failed about the last plan, and succeeded from nothing."""
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
    """A plan to the target, in K, from where its first force takes effect."""

    times: np.ndarray
    """(N + 1,) knots in s from the plan's own start."""
    states: np.ndarray
    """(N + 1, 6) in m and m/s."""
    forces: np.ndarray
    """(N, 3) in N, constant between knots."""
    target: np.ndarray
    """(6,) in m and m/s, what the plan aims at; it ends there if `slack` is 0."""
    cost: float
    """In s: the integral that the program minimises, without the price of slack."""
    slack: float
    """Sum of all slacks in scaled units; 0 if the plan keeps every limit and reaches the target."""
    status: int
    """A `PlanStatus`. 0: solved; 1: the last plan, continued; 2: braking, for there is no plan."""
    iterations: int
    """Linearisations this plan took."""
    solve_time: float
    """Wall time in s."""
    reason: int = PlanReason.SOLVED_ANEW_NO_PLAN
    """A `PlanReason`: why this status, and why anew if it was solved anew. Who asks sets it."""
    push: np.ndarray = field(default_factory=lambda: np.zeros(3))
    """(3,) in m/s^2, the acceleration assumed besides gravity and thrust."""

    def states_at(self, times: np.ndarray) -> np.ndarray:
        """States (M, 6) at times (M,), straight between knots, held past the last."""
        return np.stack([np.interp(times, self.times, x) for x in self.states.T], axis=1)

    def forces_at(self, times: np.ndarray) -> np.ndarray:
        """Forces (M, 3) at times (M,); past the plan's ends those of its first or last interval."""
        at = np.searchsorted(self.times, times, side="right") - 1
        return self.forces[np.clip(at, 0, len(self.forces) - 1)]


def empty_plan(intervals: int) -> Plan:
    """Of so many intervals, nowhere, without thrust."""
    return Plan(
        times=np.zeros(intervals + 1),
        states=np.zeros((intervals + 1, 6)),
        forces=np.zeros((intervals, 3)),
        target=np.zeros(6),
        cost=np.nan,
        slack=np.nan,
        status=PlanStatus.BRAKING,
        iterations=0,
        solve_time=0.0,
    )


@dataclass(frozen=True)
class TransitLimits:
    """What the spacecraft can do and where it may be."""

    mass: float
    """kg."""
    thrust: float
    """N per axis."""
    speed: float
    """m/s per axis, in K."""
    keep_out_semi_axes: np.ndarray
    """(3,) in m, any margin included."""


@dataclass(frozen=True)
class Horizon:
    """How long a plan is, by what it trades time for effort, and how it is divided."""

    intervals: int = 16
    """Number of intervals of constant force."""
    interval_growth: float = 4.0
    """Length of the last interval over that of the first."""
    nominal_acceleration: float = 0.03
    """m/s^2, a: sets the price of time. Without gravity and fuel weight, transits from rest to rest
    then take as long as with an acceleration a, one way and then the other."""
    fuel_weight: float = 0.8
    """Of the thrust's 1-norm, which fuel goes by, against its square, both over the limit."""
    minimum: float = 300.0
    """s; no plan is shorter."""

    def time_to_go(self, state: np.ndarray, target: np.ndarray) -> float:
        """A first guess of T, in s, from state (6,) and target (6,) alone.

        Without gravity, least quadratic effort from rest to rest over D in the time
        T_0 = sqrt(4 D / a) passes, at the share s of T_0, the distance to go
        d = D (1 - s)^2 (1 + 2 s) with the closing speed v = 6 D s (1 - s) / T_0. Solved for s,
        with q = v^2 / (a d), this gives the time left on that motion::

            s = (q + sqrt(q^2 + 9 q)) / 9        T = (1 - s) T_0 = sqrt(4 d / (a (1 + 2 s)))

        It falls by one second a second along that motion. For fast arrivals T goes to 3 d / v,
        which braking alone takes; for a speed away from the target it is that from rest. It is
        never less than `minimum`.
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


class PlanProgram(Protocol):
    """What the MPC solves at every step."""

    field: Field
    spin: float
    limits: TransitLimits
    horizon: Horizon

    def solve(
        self,
        state: np.ndarray,
        target: np.ndarray,
        previous: Plan | None = None,
        age: float = 0.0,
        iterations: int = 1,
        push: np.ndarray | None = None,
    ) -> Plan:
        """As `TransitProgram.solve`."""
        ...

    def fits(self, plan: Plan, age: float, state: np.ndarray, target: np.ndarray) -> bool:
        """As `TransitProgram.fits`."""
        ...
