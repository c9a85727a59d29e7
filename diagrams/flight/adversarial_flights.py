"""Flights by adversaries: controllers that try to do harm, with runtime assurance or without it.

These are plain functions; no Diagram is made.

The motion is integrated by `predicted_state` with polyhedral gravity, which shares nothing with the
assurance's own prediction.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from proxops.diagrams.flight.scenario_systems import make_backup
from proxops.diagrams.logs import dense_positions
from proxops.diagrams.scenario import AssuranceConfig, Body, Scenario
from proxops.systems.assurance import BackupBraking
from proxops.systems.shapes import clearances
from proxops.systems.vehicle import predicted_state

# The adversary along the surface holds its course for so many steps at most.
_LONGEST_COURSE = 60
# Share of the sets' starts that are this near to the ellipsoid (m).
_NEAR_SHARE, _NEAR = 0.5, 8e3

Adversary = Callable[[np.ndarray], np.ndarray]
"""Gives a force (3,) in N for a state (6,)."""


def _at_the_body(backup: BackupBraking, random: np.random.Generator) -> Adversary:
    """Full thrust towards the body's centre."""
    limit = backup.limits.thrust
    return lambda state: -limit * state[:3] / np.abs(state[:3]).max()


def _random(backup: BackupBraking, random: np.random.Generator) -> Adversary:
    """Any force at each step."""
    limit = backup.limits.thrust
    return lambda state: random.uniform(-limit, limit, 3)


def _sign_flipped(backup: BackupBraking, random: np.random.Generator) -> Adversary:
    """A controller that would leave the body at the speed limit, its force with the wrong sign."""
    limits = backup.limits

    def force(state: np.ndarray) -> np.ndarray:
        leaving = limits.speed * state[:3] / np.abs(state[:3]).max()
        wanted = limits.mass / backup.period * (leaving - state[3:])
        return -np.clip(wanted, -limits.thrust, limits.thrust)

    return force


def _along_the_surface(backup: BackupBraking, random: np.random.Generator) -> Adversary:
    """Full thrust on all axes along the surface and a little inwards, now this way, now that."""
    limit, left, course = backup.limits.thrust, 0, np.zeros(3)

    def force(state: np.ndarray) -> np.ndarray:
        nonlocal left, course
        if left == 0:
            left, course = int(random.integers(1, _LONGEST_COURSE)), random.normal(size=3)
        left -= 1
        normal = state[:3] / backup.limits.keep_out_semi_axes**2
        normal /= np.linalg.norm(normal)
        along = course - (course @ normal) * normal
        return limit * np.sign(along / np.linalg.norm(along) - 0.3 * normal)

    return force


ADVERSARIES: dict[str, Callable[[BackupBraking, np.random.Generator], Adversary]] = {
    "at the body": _at_the_body,
    "random": _random,
    "sign flipped": _sign_flipped,
    "along the surface": _along_the_surface,
}


@dataclass(frozen=True)
class AdversarialFlight:
    """What became of one flight."""

    states: np.ndarray
    """(N + 1, 6) at the steps."""
    forces: np.ndarray
    """(N, 3) in N, as flown."""
    commands: np.ndarray
    """(N, 3) in N, as the adversary commanded."""
    clearance: float
    """The least, in m, along the whole path."""
    speed: float
    """The greatest along an axis, in m/s."""
    step_seconds: np.ndarray
    """(N,) of processor time that the assurance took; zeros without it."""


def random_admitted_state(
    backup: BackupBraking, cube: float, random: np.random.Generator
) -> np.ndarray:
    """A state (6,) in a cube of that edge, half of the time close to the ellipsoid."""
    axes, speed = backup.limits.keep_out_semi_axes, backup.limits.speed
    while True:
        position = random.uniform(-0.5 * cube, 0.5 * cube, 3)
        if random.random() < _NEAR_SHARE:
            position *= 1.0 / np.linalg.norm(position / axes)
            normal = position / axes**2
            position += random.uniform(0.0, _NEAR) * normal / np.linalg.norm(normal)
        state = np.concatenate([position, random.uniform(-speed, speed, 3)])
        if backup.admitted(state):
            return state


def adversarial_flight(
    scenario: Scenario,
    body: Body,
    name: str,
    seed: int,
    steps: int = 600,
    assured: bool = True,
) -> AdversarialFlight:
    """Flies one adversary from a random admitted state; a function of its arguments.

    Args:
      name: one of `ADVERSARIES`.
      seed: of the start and of what the adversary draws.
    """
    backup = make_backup(scenario, body, scenario.assurance or AssuranceConfig())
    random = np.random.default_rng(seed)
    state = random_admitted_state(backup, scenario.transit.cube_m, random)
    adversary = ADVERSARIES[name](backup, random)
    period, limits = scenario.control_period_s, backup.limits
    states, forces, commands, seconds = [state], [], [], np.zeros(steps)
    speed = 0.0
    for step in range(steps):
        command = adversary(state)
        force = command
        if assured:
            started = time.thread_time()
            force = backup.assure(state, command).force
            seconds[step] = time.thread_time() - started
        # In two halves, for the speed in between.
        for _ in range(2):
            state = predicted_state(
                state, force, 0.5 * period, body.gravity_field, limits.mass, body.spin_rate
            )
            speed = max(speed, float(np.abs(state[3:]).max()))
        states.append(state)
        forces.append(force)
        commands.append(command)
    path = dense_positions(period * np.arange(steps + 1), np.array(states))
    clearance = float(clearances(limits.keep_out_semi_axes, path).min())
    return AdversarialFlight(
        np.array(states), np.array(forces), np.array(commands), clearance, speed, seconds
    )
