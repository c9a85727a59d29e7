"""A flight log without a flight: a smooth path round the body, for tests of what reads logs."""

from functools import cache

import numpy as np

from proxops.diagrams.logs.flight_log import FlightLog, make_dataset, with_survey
from proxops.diagrams.scenario import Scenario, load_body
from proxops.systems.lidar import ray_directions
from proxops.systems.shapes.ray_casting import RayCaster

APPROACH = 3
"""Rows of a survey before its first frame."""


@cache
def synthetic_log(steps: int = 480, ranges: bool = True) -> FlightLog:
    """A hybrid's flight of `steps` 10 s steps, round one end of Kleopatra, then 600 s of holding.

    The path and its derivatives are consistent, the forces are those of a point mass without
    gravity; the frames are the noiseless lidar's; the MPC flies every third 200 s.
    """
    scenario, body = Scenario(), load_body("kleopatra")
    times = 10.0 * np.arange(steps + 1)
    moving = np.clip(times / max(10.0, times[-1] - 600.0), 0.0, 1.0)
    s = moving**3 * (10.0 - 15.0 * moving + 6.0 * moving**2)
    angle = np.radians(-115.0 + 75.0 * s)
    positions = np.stack(
        [155e3 * np.cos(angle), 118e3 * np.sin(angle), 40e3 - 75e3 * s + 25e3 * np.sin(4 * s)],
        axis=1,
    )
    velocities = np.gradient(positions, 10.0, axis=0) if steps else np.zeros((1, 3))
    accelerations = np.gradient(velocities, 10.0, axis=0) if steps else np.zeros((1, 3))
    limit = scenario.spacecraft.thrust_limit_n
    force = np.clip(100.0 * accelerations + [1.2, -0.8, 0.5], -limit, limit)
    goal = np.concatenate([positions[-1], np.zeros(3)])
    by_mpc = (np.arange(steps + 1) // 20) % 3 == 0
    asked = np.where(by_mpc, 0.003, np.nan)
    columns = {
        "state": np.concatenate([positions, velocities], axis=1),
        "target": np.tile(goal, (steps + 1, 1)),
        "force": force,
        "mpc_force": np.where(by_mpc[:, None], force, np.nan),
        "policy_force": force,
        "disturbance": np.zeros_like(force),
        "decision": np.where(by_mpc, 1, 2).astype(np.int8),
        "solve_time": asked,
        "solve_status": np.where(by_mpc, 0.0, np.nan),
        "solve_reason": np.where(by_mpc, 0.0, np.nan),
    }
    if ranges:
        caster, directions = RayCaster(body.shape), ray_directions()
        frames = [
            caster.distances(np.tile(position, (len(directions), 1)), directions)
            for position in positions
        ]
        columns["ranges"] = np.stack(frames).reshape(-1, 12, 360)
    attributes = {
        "controller": "hybrid",
        "arrival_time_s": times[-1] - 600.0,
        "collided": 0,
        "keep_out_violations": 0,
        "wall_s": 1.0,
    }
    return FlightLog(make_dataset(columns, times, scenario, body, attributes), body)


def surveyed_log() -> FlightLog:
    """The synthetic flight after half a round at twice its distance, whose frames see a point."""
    flight = synthetic_log(60)
    times = np.linspace(-36_000.0, 0.0, 1200)
    turn = np.linspace(0.0, np.pi, len(times))
    positions = 300e3 * np.stack([np.cos(turn), np.sin(turn), 0.0 * turn], axis=1)
    # Each is turned about z so that the ray along x looks at the origin.
    half = 0.5 * (turn + np.pi)
    attitude = np.stack([np.cos(half), 0.0 * turn, 0.0 * turn, np.sin(half)], axis=1)
    directions = flight.scenario.lidar_geometry.directions
    frames = np.arange(APPROACH, len(times))
    columns = {
        "survey_time": times,
        "survey_state": np.hstack([positions, np.zeros_like(positions)]),
        "survey_attitude": attitude,
        "survey_force": np.full_like(positions, 0.5),
        "survey_frame": frames,
        "survey_ray": np.full(len(frames), int(np.argmax(directions[:, 0]))),
        "survey_range": np.full(len(frames), 200e3),
    }
    return with_survey(flight, columns)
