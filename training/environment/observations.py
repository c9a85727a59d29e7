"""What a pilot sees of a transit and what it may do, as spaces of Gymnasium."""

from __future__ import annotations

import typing

import numpy as np
from gymnasium import spaces

from proxops.diagrams.scenario import Scenario, load_dispersions
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


def check_known_dispersions(scenario: Scenario) -> None:
    """Raises `InputError` if a scenario names dispersions that do not exist."""
    if scenario.dispersions is not None:
        load_dispersions(scenario.dispersions)


def asked_transits(
    options: typing.Mapping[str, typing.Any] | None, shape: tuple[int, ...]
) -> np.ndarray | None:
    """The numbers of transits, of a shape, that the options of `reset` ask for; None: any.

    Raises:
      InputError: an option has another name, or its value is not of whole numbers of this shape.
    """
    options = dict(options or {})
    numbers = options.pop("transit", None)
    if options:
        raise InputError(f"reset: no option {', '.join(map(repr, options))}; there is 'transit'")
    if numbers is None:
        return None
    found = np.asarray(numbers)
    whole = found.dtype.kind in "iu" and ((found >= 0) & (found < LARGEST_TRANSIT)).all()
    if not whole or found.shape not in ((), shape):
        wanted = f"of shape {shape}" if shape else "one"
        raise InputError(
            f"reset: 'transit' takes whole numbers from 0 to below {LARGEST_TRANSIT}, {wanted}; "
            f"got {numbers}"
        )
    return np.broadcast_to(found, shape)


def taken_action(action: typing.Any, shape: tuple[int, ...]) -> np.ndarray:
    """An action as floats, cut off at -1 and 1.

    Raises:
      InputError: it has another shape, or is not a number.
    """
    found = np.asarray(action, dtype=np.float64)
    if found.shape != shape or np.isnan(found).any():
        raise InputError(f"step: an action has shape {shape} and is no NaN; got {action}")
    return np.clip(found, -1.0, 1.0)


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
