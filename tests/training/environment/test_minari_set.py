"""Flights as a data set of Minari: read by Minari, and held against the environment's own steps."""

from pathlib import Path

import minari
import numpy as np
import pytest
from minari import EpisodeData
from short_flights import falling_flight

from proxops.diagrams.flight import fly
from proxops.diagrams.scenario import change_scenario, load_scenario, of_transit
from proxops.systems import InputError
from proxops.training.environment import TransitEnvironment, check_minari_name, write_minari

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
