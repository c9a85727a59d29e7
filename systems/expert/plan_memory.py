"""A plan as a vector, so that Drake's discrete state can hold it."""

from __future__ import annotations

import dataclasses

import numpy as np

from proxops.systems.expert.plan import Horizon, Plan, empty_plan

# The first nine numbers: whether there is a plan, when it begins, its length, its target (6). Then
# come states, forces and disturbance.
_HEAD = 9


def memory_size(intervals: int) -> int:
    """Length of the vector that holds a plan with a number of intervals."""
    return _HEAD + 6 * (intervals + 1) + 3 * intervals + 3


def packed(plan: Plan, start: float) -> np.ndarray:
    """The vector of a plan that begins at the time `start` in s; zeros mean that there is none."""
    head = [1.0, start, plan.times[-1], *plan.target]
    return np.concatenate([head, plan.states.ravel(), plan.forces.ravel(), plan.disturbance])


def unpacked(memory: np.ndarray, horizon: Horizon) -> tuple[Plan | None, float]:
    """The plan in a vector, or None, and the time in s at which it begins."""
    if memory[0] == 0.0:
        return None, 0.0
    memory = memory.copy()  # The vector may be a view of a Context's state, which changes.
    intervals = horizon.intervals
    split = _HEAD + 6 * (intervals + 1)
    plan = dataclasses.replace(
        empty_plan(intervals),
        times=memory[2] * horizon.fractions(),
        target=memory[3:_HEAD],
        states=memory[_HEAD:split].reshape(intervals + 1, 6),
        forces=memory[split:-3].reshape(intervals, 3),
        disturbance=memory[-3:],
    )
    return plan, float(memory[1])
