"""A plan of the expert, what bounds it, and how long it is."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Plan:
    """A plan from now to the target, in K."""

    times: np.ndarray
    """(N + 1,) knots in s from the plan's own start."""
    states: np.ndarray
    """(N + 1, 6) in m and m/s."""
    forces: np.ndarray
    """(N, 3) in N, constant between knots."""
    cost: float
    """Mean of |force / limit|^2, plus the price of slack."""
    slack: float
    """Sum of all slacks in scaled units; 0 if the plan keeps every limit and reaches the target."""
    status: int
    """0: solved; 1: an older plan, flown on; 2: braking, for want of any plan."""
    iterations: int
    """Linearisations this plan took."""
    solve_time: float
    """Wall time in s."""

    def positions_at(self, times: np.ndarray) -> np.ndarray:
        """Positions (M, 3) at times (M,), straight between knots, held past the last."""
        return np.stack([np.interp(times, self.times, p) for p in self.states[:, :3].T], axis=1)


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
    """How long a plan is, and how it is divided."""

    knots: int = 30
    """Number of intervals."""
    knot_growth: float = 4.0
    """Length of the last interval over that of the first."""
    nominal_acceleration: float = 0.025
    """m/s^2, a in the time to go below."""
    closing_speed_weight: float = 0.6
    """c in the time to go below."""
    minimum: float = 300.0
    """s."""

    def time_to_go(self, state: np.ndarray, target: np.ndarray) -> float:
        """T = max(minimum, sqrt(4 d / a) - c v_c / a), d the distance, v_c the closing speed.

        sqrt(4 d / a) is the time from rest to rest over d at the acceleration a; a speed towards
        the target shortens it. It depends on the state and the target alone.
        """
        away = target[:3] - state[:3]
        distance = float(np.linalg.norm(away))
        closing = float(away @ (state[3:] - target[3:])) / distance if distance > 0.0 else 0.0
        a = self.nominal_acceleration
        from_rest = np.sqrt(4.0 * distance / a)
        return max(self.minimum, from_rest - self.closing_speed_weight * closing / a)

    def fractions(self) -> np.ndarray:
        """Knots (N + 1,) as shares of T."""
        lengths = np.linspace(1.0, self.knot_growth, self.knots)
        return np.concatenate([[0.0], np.cumsum(lengths) / lengths.sum()])
