"""Writes flights as a data set of Minari, as if the environment had flown them."""

from __future__ import annotations

import shutil
import typing
import warnings
from collections.abc import Iterable
from pathlib import Path

import numpy as np
import xarray as xr
from gymnasium.envs.registration import EnvSpec
from scipy.spatial.transform import Rotation

from proxops.diagrams.flight import make_events
from proxops.diagrams.logs import FlightLog
from proxops.diagrams.scenario import Scenario, TrueStateConfig, dump_scenario
from proxops.systems.common import InputError
from proxops.systems.vehicle import (
    COLLIDED,
    ENTERED_GOAL,
    FINISHED,
    NEVER,
    VIOLATIONS,
    FlownPath,
)
from proxops.training.environment.observations import check_observation
from proxops.training.environment.reward import step_reward

if typing.TYPE_CHECKING:
    from minari.data_collector import EpisodeBuffer


def write_minari(
    name: str,
    logs: Iterable[FlightLog],
    scenario: Scenario,
    seed: int,
    observation: str = "state",
) -> Path:
    """Writes logs of flights as episodes of `proxops/Transit-v0`.

    If it fails, or is interrupted by Ctrl-C, nothing is left of the data set. A process that is
    killed leaves a part of it, which has to be deleted: see `check_minari_name`.

    Observations, rewards and ends are those of `TransitEnvironment`; an action is the force that
    the thrusters were to give, over the thrust limit. An episode whose start and goal are those of
    its transit has the number as its option `transit`.

    Args:
      name: of the data set, such as `proxops/expert-v0`. Minari keeps it in its own folder, which
        MINARI_DATASETS_PATH names.
      logs: the flights, read one at a time.
      scenario, seed: those of the environment that the data set names, for `recover_environment`.
      observation: `state` or `lidar`; the latter takes logs that have frames.

    Returns:
      The folder of the data set.

    Raises:
      InputError: see `check_minari_name`; the observation is none of the two; or a log does not
        have it.
    """
    check_observation(observation)
    folder = check_minari_name(name)
    import minari

    spec = EnvSpec(
        id="proxops/Transit-v0",
        entry_point="proxops.training.environment:TransitEnvironment",
        kwargs={
            "scenario": dump_scenario(scenario),
            "observation": observation,
            "transit_seed": seed,
        },
    )
    episodes = (_episode(log, observation) for log in logs)
    try:
        with warnings.catch_warnings():
            # Minari asks for an author, whom only the user knows.
            warnings.simplefilter("ignore", UserWarning)
            minari.create_dataset_from_buffers(
                name,
                typing.cast("list[EpisodeBuffer]", episodes),
                env=spec,
                algorithm_name="proxops",
                description=f"Transits of seed {seed}, flown by proxops.",
                requirements=["proxops[gym]"],
            )
    except BaseException:
        shutil.rmtree(folder, ignore_errors=True)
        raise
    return folder


def check_minari_name(name: str) -> Path:
    """Returns the folder that a new data set of Minari will have.

    Raises:
      InputError: Minari is not installed, takes no such name, or has a data set of this name.
    """
    try:
        from minari.dataset.minari_dataset import parse_dataset_id
        from minari.storage import get_dataset_path
    except ModuleNotFoundError as error:
        raise InputError(
            "the package minari is not installed: run make gym, or pip install 'proxops[gym]'"
        ) from error
    try:
        parse_dataset_id(name)
    except (TypeError, ValueError) as error:
        raise InputError(
            f"{name!r} is no name for a data set of Minari: NAME-v0 or SPACE/NAME-v0"
        ) from error
    folder = Path(get_dataset_path(name))
    if folder.exists():
        raise InputError(
            f"Minari has a data set {name!r} already, in {folder}: choose another name or version, "
            f"or delete it (minari delete {name}); it may be incomplete if a command was killed"
        )
    return folder


def _episode(log: FlightLog, observation: str) -> EpisodeBuffer:
    """The episode of a log."""
    from minari.data_collector import EpisodeBuffer

    data, scenario = log.dataset, log.scenario
    times, forces = data["time"].values, _forces(data)[:-1]
    states, targets = data["state"].values, data["target"].values
    way = np.linalg.norm(states[:, :3] - targets[:, :3], axis=1)
    spans = np.diff(times)
    spent = np.abs(forces).sum(axis=1) / scenario.spacecraft.mass_kg * spans
    finished, broken = _outcomes(log)
    truncations = np.zeros(len(forces), dtype=bool)
    truncations[-1] = not (finished[-1] or data.attrs["collided"])
    return EpisodeBuffer(
        options=_options(scenario),
        observations=_observations(log, observation),
        actions=typing.cast("typing.Any", forces / scenario.spacecraft.thrust_limit_n),
        rewards=step_reward(
            -np.diff(way), way[0], spent, scenario.spacecraft.speed_limit_m_s, finished, broken
        ),
        terminations=[*[False] * (len(forces) - 1), not truncations[-1]],
        truncations=truncations.tolist(),
    )


def _observations(log: FlightLog, observation: str) -> dict[str, np.ndarray]:
    """What the environment would have shown, one row for each row of the log.

    Raises:
      InputError: the log has no frames, or no state of a navigation.
    """
    data = log.dataset
    goal = data["target"].values[:, :3]
    if observation == "lidar":
        if "ranges" not in data:
            raise InputError("a log has no lidar frames: fly with log_ranges: true")
        ranges = data["ranges"].values.astype(np.float64)
        return {"goal": goal, "ranges": np.where(np.isfinite(ranges), ranges, 0.0)}
    plain = isinstance(log.scenario.navigation, TrueStateConfig)
    if not plain and "navigation_state" not in data:
        raise InputError("a log has no navigation: its controller did not read the state")
    states = data["state" if plain else "navigation_state"].values
    known = np.isfinite(states).all(axis=1, keepdims=True)
    told = np.asarray(known, dtype=np.int8)
    return {"goal": goal, "state": np.where(known, states, 0.0), "known": told}


def _forces(data: xr.Dataset) -> np.ndarray:
    """Forces (N, 3) in N along what was believed to be the axes of K."""
    forces = data["force"].values
    if "navigation_attitude" not in data:
        return forces
    attitudes = data["navigation_attitude"].values
    known = np.isfinite(attitudes).all(axis=1)
    turned = forces.copy()
    axes = Rotation.from_quat(attitudes[known], scalar_first=True)
    turned[known] = axes.apply(forces[known])
    return turned


def _outcomes(log: FlightLog) -> tuple[np.ndarray, np.ndarray]:
    """Whether a step (N,) ends the transit in the goal region, and what it breaks (N,)."""
    data = log.dataset
    times, states, targets = (data[name].values for name in ("time", "state", "target"))
    events = make_events(log.scenario, log.body, log.true_body.gravity_field)
    entered = times[0] if events.is_in_region(states[0], targets[0]) else NEVER
    outcome = np.zeros(4)
    outcome[ENTERED_GOAL] = entered
    rows = [outcome]
    for k in range(len(times) - 1):
        two = slice(k, k + 2)
        path = FlownPath(states[two], targets[two], times[k], times[k + 1] - times[k])
        rows.append(events.after(rows[-1], path))
    found = np.array(rows)
    # A flight ends on the surface, which a cast to it may just miss.
    found[-1, COLLIDED] = data.attrs["collided"]
    return found[1:, FINISHED] > 0.0, np.diff(found[:, VIOLATIONS] + found[:, COLLIDED])


def _options(scenario: Scenario) -> dict[str, int] | None:
    """Options that make the environment begin such a flight; None if none do."""
    given = scenario.transit
    if (given.start_m, given.goal_m) != (None, None):
        return None
    return {"transit": given.index}
