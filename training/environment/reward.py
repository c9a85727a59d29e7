"""What a step of a transit earns: progress, less fuel, and the outcome."""

from __future__ import annotations

from typing import Any

ARRIVAL, VIOLATION = 1.0, -1.0
"""Earned by arriving, and by each entry of the keep-out ellipsoid and a collision."""
FUEL = 0.1
"""Lost for a Δv as large as the speed limit."""


def step_reward(
    closer: Any, way: Any, delta_v: Any, speed_limit: float, arrived: Any, violations: Any
) -> Any:
    """Gives the reward of one step; of many, if the arguments but the limit are arrays (N,).

    Progress adds up to 1 over a transit that ends at its goal. Kleopatra's transits take some three
    times the speed limit of Δv, so they lose some 0.3 for fuel.

    Args:
      closer: what the distance to the goal has shrunk by, in m.
      way: the distance to the goal at the start, in m.
      delta_v: spent in the step, in m/s. speed_limit: in m/s.
      arrived: whether the transit ends in this step, in the goal region.
      violations: entries of the keep-out ellipsoid and collisions in this step.
    """
    outcome = ARRIVAL * arrived + VIOLATION * violations
    return closer / way - FUEL * delta_v / speed_limit + outcome
