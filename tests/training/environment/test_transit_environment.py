"""Transits as environments of Gymnasium: the same flights as `fly`, and Gymnasium's own checks."""

import dataclasses as dc
import functools
import inspect

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from pydrake.systems.analysis import Simulator
from short_flights import Scripted

from proxops.diagrams.flight import fly, make_mpc
from proxops.diagrams.scenario import (
    believed,
    change_scenario,
    load_body,
    load_scenario,
    of_transit,
)
from proxops.systems import InputError
from proxops.training.environment import FUEL, VIOLATION, TransitBatch, TransitEnvironment

# With a limit of 8 N, forces over the limit are exact.
SHORT = {"spacecraft.thrust_limit_n": 8.0, "arrival.deadline_s": 200.0, "arrival.dwell_s": 10.0}
PERIOD = 10.0
SEED = 10000


def made(**options) -> TransitEnvironment:
    options = {"transit_seed": SEED, "changes": SHORT} | options
    env = gymnasium.make("proxops/Transit-v0", **options).unwrapped
    assert isinstance(env, TransitEnvironment)
    return env


@functools.cache
def mpc_episode(transit: int) -> tuple[TransitEnvironment, list[float], dict]:
    """An episode that the MPC flies from outside, its rewards, and the last info."""
    env = made()
    seen, told = env.reset(options={"transit": transit})
    assert told == {"transit": transit}
    scenario = believed(of_transit(env.scenario, SEED, transit))
    mpc = make_mpc(scenario, load_body(scenario.body))
    simulator = Simulator(mpc)
    context, rewards = simulator.get_mutable_context(), []
    mpc.GetInputPort("target").FixValue(context, np.r_[seen["goal"], np.zeros(3)])
    mpc.GetInputPort("state").FixValue(context, seen["state"])
    simulator.Initialize()
    while True:
        force = mpc.GetOutputPort("force").Eval(context)
        seen, reward, terminated, truncated, info = env.step(force / 8.0)
        rewards.append(reward)
        if terminated or truncated:
            return env, rewards, info
        simulator.AdvanceTo(len(rewards) * PERIOD)
        mpc.GetInputPort("state").FixValue(context, seen["state"])


def test_the_mpc_flies_as_in_fly_bit_for_bit() -> None:
    env, rewards, info = mpc_episode(1)
    scenario = change_scenario(load_scenario(), SHORT | {"log_ranges": False})
    log = fly(of_transit(scenario, SEED, 1), "mpc")
    assert env.log is not None
    assert len(rewards) == 21
    for name in ("time", "state", "navigation_state", "navigation_covariance"):
        assert np.array_equal(log.dataset[name], env.log.dataset[name], equal_nan=True), name
    # Of the last row no force acts.
    assert np.array_equal(log.dataset["force"][:-1], env.log.dataset["force"][:-1])
    assert info["summary"]["delta_v_m_s"] == log.summary["delta_v_m_s"]
    assert not info["summary"]["success"]


@pytest.mark.filterwarnings("ignore:the scenario may exceed assurance.bounds")
def test_the_log_has_what_acted() -> None:
    """Thrust, disturbance and assurance are those of the same actions in `fly`."""
    acting = {
        "disturbance": {},
        "truth.thrusters.scale": [0.5, 1.0, 0.8],
        "assurance": {"bounds": {}},
        "arrival.deadline_s": 60.0,
        "transit.start_m": [0.0, 0.0, 65.02e3],
        "transit.goal_m": [150e3, 0.0, 0.0],
    }
    env = made(changes=SHORT | acting)
    # Near the pole of the ellipsoid, and inwards, so that assurance changes commands.
    actions = np.random.default_rng(3).uniform(-0.9, [0.9, 0.9, 0.0], (7, 3))
    env.reset(options={"transit": 1})
    for action in actions:
        env.step(action)
    assert env.log is not None
    scenario = dc.replace(env.scenario, transit=dc.replace(env.scenario.transit, index=1))
    played = Scripted(lambda time: 8.0 * actions[min(round(time / PERIOD), 6)], [("state", 6)])
    log = fly(scenario, played)
    names = ("force", "thrust", "disturbance", "intervention", "assurance_margin")
    for name in names:
        flown = log.dataset[name].values[:-1]
        assert np.nanstd(flown) > 0.0, name
        assert np.array_equal(flown, env.log.dataset[name].values[:-1], equal_nan=True), name
    assert env.log.summary["delta_v_m_s"] == log.summary["delta_v_m_s"]


def test_rewards_are_progress_less_fuel() -> None:
    env, rewards, info = mpc_episode(1)
    assert env.log is not None
    data = env.log.dataset
    way = np.linalg.norm(data["state"].values[:, :3] - data["target"].values[:, :3], axis=1)
    fuel = FUEL * info["summary"]["delta_v_m_s"] / 40.0
    assert sum(rewards) == pytest.approx(1.0 - way[-1] / way[0] - fuel, rel=1e-3)


@pytest.mark.parametrize("observation", ["state", "lidar"])
def test_gymnasiums_own_checks(observation: str) -> None:
    check_env(made(observation=observation))


def test_a_collision_ends_the_episode() -> None:
    """Without a force, a spacecraft at rest above the middle of the body falls on it."""
    near = {"transit.start_m": [0.0, 0.0, 68e3], "transit.goal_m": [150e3, 0.0, 0.0]}
    env = TransitEnvironment(changes=near | {"navigation": {"_tag": "!TrueState"}})
    env.reset()
    rewards, info = [], {}
    while not info:
        _, reward, terminated, truncated, info = env.step(np.zeros(3))
        assert not truncated
        assert terminated == bool(info)
        rewards.append(reward)
    assert info["summary"]["collided"]
    assert min(rewards) < 0.9 * VIOLATION


@pytest.mark.parametrize("kind", [TransitEnvironment, TransitBatch])
def test_nobody_learns_on_transits_of_evaluation_unless_asked_to(kind: type) -> None:
    """Those of seeds from 10,000 on."""
    assert 0 <= inspect.signature(kind).parameters["transit_seed"].default < 10_000


def test_a_step_needs_a_reset() -> None:
    with pytest.raises(gymnasium.error.ResetNeeded, match="reset"):
        TransitEnvironment(changes=SHORT).step(np.zeros(3))


@pytest.mark.parametrize(
    ("options", "complaint"),
    [
        ({"transits": 4}, "no option 'transits'; there is 'transit'"),
        ({"transit": -1}, "whole numbers from 0 to below 2147483648, one; got -1"),
        ({"transit": 1.5}, "whole numbers"),
        ({"transit": [1, 2]}, "whole numbers"),
    ],
)
def test_wrong_options_are_refused(options: dict, complaint: str) -> None:
    with pytest.raises(InputError, match=complaint):
        TransitEnvironment(changes=SHORT).reset(options=options)


def test_pictures_of_an_episode() -> None:
    """They show where the transit is; to draw them changes nothing of it."""
    env, plain = made(render_mode="rgb_array"), made()
    with pytest.raises(gymnasium.error.ResetNeeded, match="reset"):
        env.render()
    ends, shown = [], []
    for each in (env, plain):
        each.reset(options={"transit": 4})
        for _ in range(5):
            shown.append(each.render())
            ends.append(each.step(np.ones(3))[0]["state"])
    assert [picture is None for picture in shown] == [False] * 5 + [True] * 5
    assert shown[0].shape == (540, 960, 3)
    assert (shown[0] != shown[4]).any()
    np.testing.assert_array_equal(ends[:5], ends[5:])
