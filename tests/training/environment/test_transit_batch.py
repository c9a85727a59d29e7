"""Many transits at once, against the same transits flown by the diagram, one after the other."""

import dataclasses as dc
import functools

import gymnasium
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hn

from proxops.diagrams.scenario import TrueStateConfig, change_scenario, load_body, load_scenario
from proxops.systems import InputError
from proxops.systems.vehicle import NEVER, FlightEvents, FlownPath
from proxops.training.environment import TransitBatch, TransitEnvironment

# The table takes a while to make.
EXACT = {"gravity": "exact"}
TRUE = dc.replace(load_scenario(), navigation=TrueStateConfig())
SEED = 10000


def batch(number: int = 2, **options) -> TransitBatch:
    options.setdefault("changes", EXACT)
    options.setdefault("transit_seed", SEED)
    mode = "vector_entry_point"
    made = gymnasium.make_vec("proxops/Transit-v0", number, vectorization_mode=mode, **options)
    assert isinstance(made, TransitBatch)
    return made


def single(**options) -> TransitEnvironment:
    made = gymnasium.make("proxops/Transit-v0", transit_seed=SEED, **options).unwrapped
    assert isinstance(made, TransitEnvironment)
    return made


def pulled(seen: dict[str, np.ndarray]) -> np.ndarray:
    """Forces (..., 3) over the limit, towards the goal."""
    way, velocity = seen["goal"] - seen["state"][..., :3], seen["state"][..., 3:]
    return np.clip(2e-4 * way - 0.15 * velocity, -1.0, 1.0)


def test_a_transit_as_the_diagram_flies_it() -> None:
    """From start to arrival, with the same forces."""
    brief = {"arrival.dwell_s": 100.0}
    many, one = batch(3, changes=EXACT | brief), single(scenario=change_scenario(TRUE, brief))
    seen, told = many.reset(options={"transit": [0, 8, 11]})
    assert told["transit"].tolist() == [0, 8, 11]
    alone, _ = one.reset(options={"transit": 8})
    steps = 0
    while True:
        forces = pulled(seen)
        seen, rewards, terminated, truncated, info = many.step(forces)
        alone, reward, arrived, late, told = one.step(forces[1])
        steps += 1
        assert np.linalg.norm(seen["state"][1, :3] - alone["state"][:3]) < 0.01
        assert np.linalg.norm(seen["state"][1, 3:] - alone["state"][3:]) < 1e-4
        assert rewards[1] == pytest.approx(reward, abs=1e-6)
        assert (terminated[1], truncated[1]) == (arrived, late)
        if arrived or late:
            break
    summary = told["summary"]
    assert steps > 100
    assert summary["success"]
    assert info["arrived"][1]
    assert info["time_s"][1] == 10.0 * steps
    assert info["delta_v_m_s"][1] == pytest.approx(summary["delta_v_m_s"], rel=1e-3)
    assert info["violations"][1] == summary["keep_out_violations"] == 0


def test_who_begins_at_the_goal_has_arrived_then() -> None:
    """As in the diagram: the dwell counts from the start."""
    wide = {"arrival.radius_m": 1e6, "arrival.dwell_s": 30.0}
    many = batch(1, changes=EXACT | wide)
    one = single(scenario=change_scenario(TRUE, wide))
    many.reset(options={"transit": [0]})
    one.reset(options={"transit": 0})
    for number in range(1, 4):
        _, _, over, _, _ = many.step(np.zeros((1, 3)))
        _, _, over_alone, _, _ = one.step(np.zeros(3))
        assert bool(over[0]) == over_alone == (number == 3)


def test_into_the_body_as_the_diagram_flies_it() -> None:
    many, one = batch(1), single(scenario=TRUE)
    seen, _ = many.reset(options={"transit": [3]})
    one.reset(options={"transit": 3})
    while True:
        down = -seen["state"][:, :3] / np.abs(seen["state"][:, :3]).max()
        seen, rewards, terminated, _, info = many.step(down)
        _, reward, collided, late, told = one.step(down[0])
        assert bool(terminated[0]) == collided
        assert rewards[0] == pytest.approx(reward, abs=0.01)
        if collided or late:
            break
    assert told["summary"]["collided"]
    assert told["summary"]["keep_out_violations"] == info["violations"][0] == 1
    assert not info["arrived"][0]


def test_frames_are_those_of_the_diagram() -> None:
    many, one = batch(observation="lidar"), single(changes=EXACT, observation="lidar")
    seen, _ = many.reset(options={"transit": [7, 8]})
    alone, _ = one.reset(options={"transit": 8})
    assert seen["ranges"].shape == (2, 12, 360)
    for _ in range(2):
        assert np.count_nonzero(alone["ranges"]) > 10
        np.testing.assert_allclose(seen["ranges"][1], alone["ranges"], rtol=1e-6)
        seen = many.step(np.full((2, 3), 0.3))[0]
        alone = one.step(np.full(3, 0.3))[0]


def test_a_limit_of_steps_cuts_as_that_of_one_does() -> None:
    many = batch(2, max_episode_steps=3)
    one = gymnasium.make("proxops/Transit-v0", max_episode_steps=3, changes=EXACT)
    many.reset(options={"transit": [0, 1]})
    one.reset(options={"transit": 1})
    assert [one.step(np.zeros(3))[3] for _ in range(3)] == [False, False, True]
    cuts = []
    for _ in range(7):
        _, _, terminated, truncated, info = many.step(np.zeros((2, 3)))
        assert not terminated.any()
        cuts.append(truncated.all())
        if truncated.any():
            assert info["time_s"].tolist() == [30.0, 30.0]
    # In the step after it, a transit begins anew.
    assert cuts == [False, False, True, False, False, False, True]
    with pytest.raises(InputError, match="max_episode_steps above 0"):
        TransitBatch(2, changes=EXACT, max_episode_steps=0)


def test_wrong_options_and_actions_are_refused() -> None:
    many = batch()
    with pytest.raises(InputError, match=r"of shape \(2,\); got \[1, 2, 3\]"):
        many.reset(options={"transit": [1, 2, 3]})
    many.reset(options={"transit": 1})
    with pytest.raises(InputError, match=r"an action has shape \(2, 3\)"):
        many.step(np.zeros(3))
    with pytest.raises(InputError, match="no dispersions; use vectorization_mode"):
        TransitBatch(2, dispersions="after_survey")


@pytest.mark.parametrize(
    "changes",
    [
        {"dispersions": "after_survey"},
        {"truth.mass": 1.01},
        {"kicks": {}},
        {"sunlight": {}},
        {"transit.start_m": [2e5, 0.0, 0.0], "transit.goal_m": [0.0, 2e5, 0.0]},
    ],
)
def test_what_it_leaves_out_is_refused(changes: dict) -> None:
    with pytest.raises(InputError, match="as believed"):
        batch(changes=EXACT | changes)


# --- which paths need no closer look ------------------------------------------------------------


@functools.cache
def events() -> tuple[FlightEvents, np.ndarray]:
    """Kleopatra's, and the semi-axes (3,) of its keep-out ellipsoid."""
    body = load_body(load_scenario().body)
    axes = body.keep_out_semi_axes
    return FlightEvents(body.gravity_field, axes, radius=1e3, speed=1.0, dwell=600.0), axes


@given(
    start=hn.arrays(float, 6, elements=st.floats(-1.0, 1.0)),
    near=st.floats(1.0, 2.0),
    pace=st.sampled_from([1.0, 30.0, 3e3]),
)
def test_where_nothing_happens_the_outcome_stays(start: np.ndarray, near: float, pace: float):
    """Starts near the ellipsoid; where it says nothing happens, a closer look agrees."""
    watch, axes = events()
    direction = start[:3] + [1e-3, 0.0, 0.0]
    begins = np.r_[near * direction / np.linalg.norm(direction / axes), pace * start[3:]]
    ends = np.r_[begins[:3] + 10.0 * begins[3:], begins[3:]]
    goal = np.r_[ends[:3] + 900.0, np.zeros(3)]
    calm = watch.nothing_happens(begins[None], ends[None], goal[None], 10.0)
    before = np.array([NEVER, 0.0, 0.0, 0.0])
    path, goals = np.stack([begins, ends]), np.stack([goal, goal])
    if calm[0]:
        np.testing.assert_array_equal(
            watch.after(before, FlownPath(path, goals, 0.0, 10.0)), before
        )
