"""What a pilot sees of a transit and what it may do, as spaces of Gymnasium."""

from __future__ import annotations

import numpy as np
from gymnasium import spaces

from proxops.diagrams.scenario import Scenario
from proxops.systems.common import InputError

OBSERVATIONS = ("state", "lidar")
LARGEST_TRANSIT = 2**31
"""Numbers of transits that a seed draws are less than this."""
# Bounds of the observations, over the size of the cube, the speed limit and the range.
_FAR = 100.0


def check_observation(observation: str) -> None:
    """Raises `InputError` if an observation is neither `state` nor `lidar`."""
    if observation not in OBSERVATIONS:
        raise InputError(f"observation: one of {', '.join(OBSERVATIONS)}, not {observation!r}")


def observation_space(scenario: Scenario, observation: str) -> spaces.Dict:
    """The space of `state` or `lidar` observations; nothing comes near its bounds."""
    place = np.full(3, _FAR * scenario.transit.cube_m)
    state = np.concatenate([place, np.full(3, _FAR * scenario.spacecraft.speed_limit_m_s)])
    seen: dict[str, spaces.Space] = {"goal": spaces.Box(-place, place, dtype=np.float64)}
    if observation == "state":
        known = spaces.MultiBinary(1)
        return spaces.Dict(
            seen | {"state": spaces.Box(-state, state, dtype=np.float64), "known": known}
        )
    farthest, frame = _FAR * scenario.lidar.max_range_m, _frame_shape(scenario)
    return spaces.Dict(seen | {"ranges": spaces.Box(0.0, farthest, frame, np.float64)})


def action_space() -> spaces.Box:
    """Forces along each axis over the thrust limit."""
    return spaces.Box(-1.0, 1.0, (3,), np.float64)


def _frame_shape(scenario: Scenario) -> tuple[int, int]:
    return scenario.lidar.planes, scenario.lidar.rays
