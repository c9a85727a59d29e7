"""Flights by adversaries: controllers that try to hit the body, with or without runtime assurance.

These are plain functions; they make no Diagram. `predicted_state` integrates the motion with
polyhedral gravity. It shares no code with the prediction that runtime assurance makes.
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

# The adversary along the surface keeps its course for at most this many steps.
_LONGEST_COURSE = 60
# This share of the starts is within this distance (m) of the keep-out ellipsoid.
_NEAR_SHARE, _NEAR = 0.5, 8e3

Adversary = Callable[[np.ndarray], np.ndarray]
"""Gives a force (3,) in N for a state (6,)."""


def _at_the_body(backup: BackupBraking, random: np.random.Generator) -> Adversary:
    """Thrusts fully towards the body's centre."""
    limit = backup.limits.thrust
    return lambda state: -limit * state[:3] / np.abs(state[:3]).max()


def _random(backup: BackupBraking, random: np.random.Generator) -> Adversary:
    """Draws any force within the limits at each step."""
    limit = backup.limits.thrust
    return lambda state: random.uniform(-limit, limit, 3)


def _sign_flipped(backup: BackupBraking, random: np.random.Generator) -> Adversary:
    """Commands the opposite of the force that would leave the body at the speed limit."""
    limits = backup.limits

    def force(state: np.ndarray) -> np.ndarray:
        leaving = limits.speed * state[:3] / np.abs(state[:3]).max()
        wanted = limits.mass / backup.period * (leaving - state[3:])
        return -np.clip(wanted, -limits.thrust, limits.thrust)

    return force


def _along_the_surface(backup: BackupBraking, random: np.random.Generator) -> Adversary:
    """Thrusts fully along the surface and slightly inwards, and changes its course at random."""
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
    """The record of one flight; all vectors are in K."""

    states: np.ndarray
    """States (N + 1, 6) at the steps, in m and m/s."""
    forces: np.ndarray
    """Forces (N, 3) that acted, in N."""
    commands: np.ndarray
    """Forces (N, 3) that the adversary commanded, in N."""
    clearance: float
    """Least clearance along the whole path, in m."""
    speed: float
    """Greatest speed along an axis, in m/s."""
    step_seconds: np.ndarray
    """Processor time (N,) of runtime assurance at each step, in s; zeros without it."""


def random_admitted_state(
    backup: BackupBraking, cube: float, random: np.random.Generator
) -> np.ndarray:
    """Draws an admitted state (6,) in a cube, half of the time close to the keep-out ellipsoid.

    Args:
      backup: decides which states are admitted.
      cube: edge of the cube in m.
      random: source of the draws.
    """
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
    """Flies one adversary from a random admitted state; the result depends on the arguments alone.

    Args:
      scenario: gives the spacecraft, the control period and the settings of runtime assurance.
      body: the body.
      name: one of `ADVERSARIES`.
      seed: seed of the start and of the adversary's draws.
      steps: number of control steps.
      assured: whether runtime assurance filters the commands.
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
        # Two half steps, so that the speed between the steps is seen too.
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
