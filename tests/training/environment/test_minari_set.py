"""Flights as a data set of Minari: read by Minari, and held against the environment's own steps."""

import subprocess
import sys
from pathlib import Path

import minari
import numpy as np
import pytest
from minari import EpisodeData
from short_flights import falling_flight, short_scenario

from proxops.diagrams.flight import fly
from proxops.diagrams.scenario import change_scenario, load_scenario, of_transit
from proxops.systems import InputError
from proxops.training.environment import (
    VIOLATION,
    TransitEnvironment,
    check_minari_name,
    write_minari,
)

# With a limit of 8 N, forces over the limit are exact.
SHORT = {"spacecraft.thrust_limit_n": 8.0, "arrival.deadline_s": 150.0, "arrival.dwell_s": 10.0}


@pytest.fixture(autouse=True)
def _own_sets(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path / "sets"))


@pytest.mark.parametrize("observation", ["state", "lidar"])
def test_an_episode_as_the_environment_gives_it(observation: str) -> None:
    given = load_scenario(on_true_state=observation == "lidar")
    env = TransitEnvironment(given, observation, transit_seed=10000, changes=SHORT)
    kept = change_scenario(env.scenario, {"log_ranges": observation == "lidar"})
    log = fly(of_transit(kept, 10000, 5), "pd")
    write_minari("proxops/one-v0", [log, log], env.scenario, 10000, observation)
    found = minari.load_dataset("proxops/one-v0")
    assert (found.total_episodes, found.total_steps) == (2, 32)
    again = found.recover_environment().unwrapped
    assert isinstance(again, TransitEnvironment)
    options = next(iter(found.storage.get_episode_metadata([0])))["options"]
    (seen, _), over = again.reset(options=options), False
    episode = found[1]
    for k, action in enumerate(episode.actions):
        row = _row(episode, k)
        assert env.observation_space.contains(row)
        for name, value in seen.items():
            # Logs keep ranges in single precision, and actions have been turned back and forth.
            np.testing.assert_allclose(row[name], value, rtol=1e-6)
        seen, reward, terminated, over, _ = again.step(action)
        assert (episode.terminations[k], episode.truncations[k]) == (terminated, over)
        assert episode.rewards[k] == pytest.approx(reward, rel=1e-4)
    assert over
    assert _row(episode, 16).keys() == seen.keys()


def test_actions_are_along_the_axes_of_the_body() -> None:
    """Of those that the environment was given, whatever the axes of the spacecraft are."""
    env = TransitEnvironment(changes=SHORT, dispersions="after_survey", transit_seed=10000)
    env.reset(options={"transit": 5})
    actions, over = np.random.default_rng(2).uniform(-1.0, 1.0, (16, 3)), False
    for action in actions:
        *_, over, _ = env.step(action)
    assert over
    assert env.log is not None
    write_minari("turned-v0", [env.log], env.scenario, 10000)
    episode = minari.load_dataset("turned-v0")[0]
    # The navigation knows nothing in the first step, and its attitude is logged before it is used.
    np.testing.assert_allclose(episode.actions[1:], actions[1:], rtol=0, atol=1e-5)
    forces = env.log.dataset["force"].values[:-1] / 8.0
    assert np.abs(forces - actions).max() > 1e-4


def _row(episode: EpisodeData, index: int) -> dict[str, np.ndarray]:
    """One of the observations of an episode."""
    assert isinstance(episode.observations, dict)
    return {name: value[index] for name, value in episode.observations.items()}


def test_arrival_collision_and_what_is_unknown() -> None:
    arrives = fly(short_scenario(log_ranges=False))
    scenario = arrives.scenario
    # Nothing returns from so far away.
    changes = {"navigation": {}, "lidar__max_range_m": 10e3, "arrival__deadline_s": 50.0}
    unknown = fly(short_scenario(log_ranges=False, **changes), "pd")
    write_minari("three-v2", [arrives, falling_flight(), unknown], scenario, 3)
    good, fallen, first = minari.load_dataset("three-v2").iterate_episodes()
    assert arrives.summary["success"]
    assert good.terminations.tolist()[-2:] == [False, True]
    assert good.rewards[-1] > 0.9
    assert np.sum(good.rewards[:-1] > 0.9) == 0
    assert falling_flight().summary["collided"]
    assert fallen.terminations[-1]
    # It enters the keep-out ellipsoid, and later it collides, a step before the end of its log.
    broken = np.flatnonzero(fallen.rewards < 0.9 * VIOLATION)
    assert len(broken) == 2
    assert broken[-1] == len(fallen.rewards) - 1
    assert isinstance(first.observations, dict)
    known = first.observations["known"][:, 0]
    assert len(known) == len(unknown.dataset["time"])
    assert not known.any()
    assert not first.observations["state"].any()
    none = next(iter(minari.load_dataset("three-v2").storage.get_episode_metadata([0])))
    assert "options" not in none


def test_nothing_half_written_stays() -> None:
    log = falling_flight()

    def logs():
        yield log
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_minari("half-v0", logs(), log.scenario, 0)
    write_minari("half-v0", [log], log.scenario, 0)
    with pytest.raises(InputError, match=r"has a data set 'half-v0' already, in .*: choose"):
        check_minari_name("half-v0")


@pytest.mark.slow
def test_gymnasium_alone_is_enough_to_fly() -> None:
    """Without Minari there are transits, but no data sets."""
    code = """
import sys
sys.modules["minari"] = None
import gymnasium
name = "proxops.training.environment:proxops/Transit-v0"
gymnasium.make_vec(name, num_envs=2, changes={"gravity": "exact"}).reset(seed=1)
from proxops.systems import InputError
from proxops.training.environment import check_minari_name
try:
    check_minari_name("proxops/one-v0")
except InputError as error:
    print(error)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120)
    assert (done.returncode, done.stderr) == (0, "")
    complaint = "the package minari is not installed: run make gym, or pip install 'proxops[gym]'"
    assert done.stdout == f"{complaint}\n"
