"""Fallbacks when no plan could be solved: the last plan is continued, or the spacecraft brakes."""

from __future__ import annotations

import dataclasses

import numpy as np

from proxops.systems.common import State
from proxops.systems.expert.plan import Horizon, Plan, PlanStatus, empty_plan
from proxops.systems.gravity import Field
from proxops.systems.rotation import SpinModel
from proxops.systems.vehicle import FlightLimits, believed_acceleration


def continued_plan(last: Plan, age: float, horizon: Horizon, least: float) -> Plan:
    """The rest of the last plan after `age` s, divided in the same proportions.

    Args:
      last: the last plan that was solved.
      age: time in s since its start.
      horizon: gives the proportions of the intervals.
      least: the least length of the result in s. Past the last plan's end its last force is kept.
    """
    times = horizon.fractions() * max(last.times[-1] - age, least)
    forces = last.forces_at(age + 0.5 * (times[1:] + times[:-1]))
    # The first force is the one that is due now, not the one at the middle of the new interval.
    forces[0] = last.forces_at(np.array([age]))[0]
    states = last.states_at(age + times)
    return dataclasses.replace(
        last, times=times, states=states, forces=forces, status=PlanStatus.LAST_PLAN_CONTINUED
    )


def braking(
    state: State,
    field: Field,
    spin: SpinModel,
    limits: FlightLimits,
    horizon: Horizon,
    period: float,
    time: float,
) -> Plan:
    """A plan of hover thrust and of braking to rest in K within `period` s, as far as limits allow.

    It begins at a time in s.
    If the state (6,) is not finite, the plan has no thrust.
    """
    intervals = horizon.intervals
    if not np.isfinite(state).all():
        return empty_plan(intervals)
    gravity = field.evaluate(state[None, :3]).acceleration[0]
    apparent = believed_acceleration(state, gravity, np.zeros(3), limits.mass, spin, time)
    force = -limits.mass * (apparent + state[3:] / period)
    force = np.clip(force, -limits.thrust, limits.thrust)
    return dataclasses.replace(
        empty_plan(intervals),
        times=horizon.fractions() * horizon.minimum,
        states=np.tile(state, (intervals + 1, 1)),
        forces=np.tile(force, (intervals, 1)),
    )
