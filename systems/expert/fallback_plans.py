"""What is flown when no fresh plan could be solved: the last plan shifted, or braking."""

from __future__ import annotations

import dataclasses

import numpy as np

from proxops.systems.expert.plan import Horizon, Plan, PlanStatus, TransitLimits, empty_plan
from proxops.systems.gravity import Field


def continued_plan(last: Plan, age: float, horizon: Horizon, least: float) -> Plan:
    """What is left of the last plan after `age` s, on the same knots; past its end its last force.

    It is `least` s long or longer.
    """
    times = horizon.fractions() * max(last.times[-1] - age, least)
    forces = last.forces_at(age + 0.5 * (times[1:] + times[:-1]))
    # The force that is due now, not the mean over the first of the new intervals.
    forces[0] = last.forces_at(np.array([age]))[0]
    states = last.states_at(age + times)
    return dataclasses.replace(
        last, times=times, states=states, forces=forces, status=PlanStatus.LAST_PLAN_CONTINUED
    )


def braking(
    state: np.ndarray,
    field: Field,
    spin: float,
    limits: TransitLimits,
    horizon: Horizon,
    period: float,
) -> Plan:
    """Hover thrust, and as much as takes the velocity in K away in `period` s, within limits.

    Of no known state, no thrust.
    """
    intervals = horizon.intervals
    if not np.isfinite(state).all():
        return empty_plan(intervals)
    gravity = field.evaluate(state[None, :3]).acceleration[0]
    apparent = gravity + [spin**2 * state[0], spin**2 * state[1], 0.0]
    apparent += [2.0 * spin * state[4], -2.0 * spin * state[3], 0.0]
    force = -limits.mass * (apparent + state[3:] / period)
    force = np.clip(force, -limits.thrust, limits.thrust)
    return dataclasses.replace(
        empty_plan(intervals),
        times=horizon.fractions() * horizon.minimum,
        states=np.tile(state, (intervals + 1, 1)),
        forces=np.tile(force, (intervals, 1)),
    )
