"""What a mission hands over: where the spacecraft is, in the frame of its map, and the world."""

import dataclasses as dc
import shutil
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from short_flights import kleopatra
from synthetic_log import synthetic_log

from proxops import assets
from proxops.diagrams.flight import fly
from proxops.diagrams.scenario import (
    MissionConfig,
    Scenario,
    SurveyConfig,
    draw_transit,
    load_body,
    load_scenario,
)
from proxops.diagrams.surveys import begin_mission, mission, whole_log
from proxops.diagrams.surveys.mission import onward, parts_of
from proxops.diagrams.surveys.survey_files import (
    NewMap,
    Placed,
    true_attitude,
    true_in,
    visit_scenario,
)
from proxops.diagrams.surveys.survey_flight import around_of, survey_world
from proxops.systems.common import InputError
from proxops.systems.lidar import ray_directions
from proxops.systems.shapes import Polyhedron
from proxops.systems.vehicle import SunlightConfig, sun_direction

TIME, END = 50_000.0, np.array([500.0, -300.0, 400.0, 0.1, 0.2, -0.05])
AHEAD_DEG, DELTA_V, LIGHT = 0.02, 3.0, [0.3, -0.9, 0.2]


@dc.dataclass
class HandedOver:
    world: Any
    placed: Placed
    surveyed: Any
    after: Scenario


@pytest.fixture(scope="module")
def handed_over() -> HandedOver:
    """A map that is turned and moved against the body, and a phase that is believed a bit ahead."""
    body = load_body("bennu")
    sunlight = SunlightConfig(direction=LIGHT)
    asked = {"transit.seed": 3, "task.survey.reach_m": 9000.0}
    scenario = dc.replace(load_scenario("bennu_mission", asked), sunlight=sunlight)
    surveying, visiting = parts_of(scenario)
    world = survey_world(surveying, body)
    turn = Rotation.from_rotvec([0.0, 0.0, 0.4]).as_matrix()
    centre = np.array([3.0, -2.0, 1.0])
    turned = Polyhedron((body.shape.vertices - centre) @ turn.T, body.shape.facets)
    made = NewMap(turned, turn, centre, np.zeros((len(turned.vertices), 1)))
    first: Any = SimpleNamespace(body_attitudes=lambda times: true_attitude(world, 0.0)[None])
    placed = true_in(made, first, world, 0.0)

    def believed(times: np.ndarray) -> np.ndarray:
        ahead = Rotation.from_rotvec([0.0, 0.0, AHEAD_DEG], degrees=True).as_matrix()
        return np.array([true_attitude(world, t) @ placed.turn.T @ ahead @ turn for t in times])

    returns: Any = SimpleNamespace(times=np.array([0.0, TIME]))
    flight: Any = SimpleNamespace(world=world, states=END[None], returns=returns, delta_v=DELTA_V)
    surveyed: Any = SimpleNamespace(
        flight=flight, placed=placed, made=made,
        found=SimpleNamespace(survey=SimpleNamespace(body_attitudes=believed)),
        visit=visit_scenario(visiting, flight, placed, body),
    )  # fmt: skip
    return HandedOver(world, placed, surveyed, onward(surveyed))


def test_it_goes_on_where_the_survey_ended(handed_over: HandedOver) -> None:
    """Seen from the true surface, the spacecraft is where it was and moves as it did."""
    before = handed_over.world.true_body.shape.vertices[:200]
    now, transit = handed_over.placed.shape.vertices[:200], handed_over.after.transit
    assert transit.start_m is not None
    assert transit.start_velocity_m_s is not None
    assert np.abs(now - before).max() > 1.0
    np.testing.assert_allclose(
        np.linalg.norm(now - transit.start_m, axis=1),
        np.linalg.norm(before - END[:3], axis=1),
        rtol=1e-9,
    )
    sides = [np.diff(each, axis=0) for each in (before, now)]
    np.testing.assert_allclose(sides[1] @ transit.start_velocity_m_s, sides[0] @ END[3:], atol=1e-9)


def test_its_log_has_the_survey_in_the_frame_of_the_map(handed_over: HandedOver) -> None:
    """Returns are as far from the true surface as they were; the last row is where it goes on."""
    surveyed, count = handed_over.surveyed, 7
    random = np.random.default_rng(1)
    states = np.vstack([random.normal(size=(count - 1, 6)) * np.repeat([900.0, 0.1], 3), END])
    attitudes = Rotation.random(count, rng=random)
    frames, rays = np.array([0, 0, 2, 4]), np.array([5, 900, 17, 4319])
    returns: Any = SimpleNamespace(
        times=np.linspace(0.0, TIME, count)[2:], frames=frames, ranges=random.uniform(5e2, 1e3, 4)
    )
    flight = SimpleNamespace(
        **vars(surveyed.flight) | {"returns": returns, "states": states, "rays": rays},
        times=np.linspace(0.0, TIME, count), forces=random.normal(size=(count, 3)),
        attitudes=attitudes.as_quat(scalar_first=True),
    )  # fmt: skip
    own: Any = SimpleNamespace(**vars(surveyed) | {"flight": flight})
    data = whole_log(own, synthetic_log(3, ranges=False)).dataset

    def places(states: np.ndarray, turns: np.ndarray) -> np.ndarray:
        row = frames + 2
        along = np.einsum("kij,kj->ki", turns[row], ray_directions()[rays])
        return states[row, :3] + returns.ranges[:, None] * along

    turns = Rotation.from_quat(data["survey_attitude"].values, scalar_first=True).as_matrix()
    now, shape = places(data["survey_state"].values, turns), handed_over.placed.shape
    before = places(states, attitudes.as_matrix())
    np.testing.assert_array_equal(data["survey_frame"], frames + 2)
    np.testing.assert_allclose(
        np.linalg.norm(now[:, None] - shape.vertices[:50], axis=2),
        np.linalg.norm(before[:, None] - handed_over.world.true_body.shape.vertices[:50], axis=2),
    )
    transit = handed_over.after.transit
    start = [*(transit.start_m or []), *(transit.start_velocity_m_s or [])]
    np.testing.assert_allclose(data["survey_state"].values[-1], start)
    assert data["survey_time"].values[[0, -1]].tolist() == [-TIME, 0.0]


def test_the_sun_shines_on_from_the_same_side(handed_over: HandedOver) -> None:
    world, sunlight = handed_over.world, handed_over.after.sunlight
    assert sunlight is not None
    before = np.diff(world.true_body.shape.vertices[:200], axis=0)
    now = np.diff(handed_over.placed.shape.vertices[:200], axis=0)
    sun = sun_direction(TIME, world.scenario.sunlight)
    np.testing.assert_allclose(
        now @ sun_direction(0.0, sunlight), before @ true_attitude(world, TIME).T @ sun, atol=1e-6
    )


def test_belief_is_ahead_and_propellant_is_gone(handed_over: HandedOver) -> None:
    after, drawn = handed_over.after, handed_over.world.scenario
    assert after.truth.phase_deg == pytest.approx(AHEAD_DEG, abs=1e-6)
    burnt = DELTA_V / (9.80665 * drawn.truth.specific_impulse_s)
    assert after.spacecraft.mass_kg == pytest.approx(
        drawn.spacecraft.mass_kg * np.exp(-burnt), rel=1e-9
    )
    assert after.lidar.noise_std_m == drawn.lidar.noise_std_m
    assert after.lidar.max_range_m == drawn.lidar.max_range_m == 9000.0
    assert after.truth.rigid_body == drawn.truth.rigid_body
    assert after.truth.thrusters == drawn.truth.thrusters


def test_who_flies_a_mission() -> None:
    scenario = load_scenario("bennu_mission")
    assert isinstance(scenario.task, MissionConfig)
    with pytest.raises(InputError, match="a mission by run_mission or proxops fly"):
        fly(scenario)
    with pytest.raises(InputError, match="no mission: set task"):
        parts_of(load_scenario("bennu"))
    with pytest.raises(InputError, match="set spacecraft: !RigidBody"):
        parts_of(load_scenario("bennu", {"task": {"_tag": "!Mission"}}))


def test_a_mission_may_end_with_a_transit(
    handed_over: HandedOver, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By a point, too; its goal is one of the transits that are drawn about the new map."""
    scenario = load_scenario("kleopatra_mission")
    surveying, visiting = parts_of(scenario)
    assert isinstance(surveying.task, SurveyConfig)
    assert visiting == dc.replace(scenario, task=Scenario().task)
    surveyed = SimpleNamespace(**{**vars(handed_over.surveyed), "visit": visiting})

    def survey(*_: object) -> Any:
        shutil.copytree(Path(assets.__file__).parent / "kleopatra", tmp_path, dirs_exist_ok=True)
        (tmp_path / "kleopatra.yaml").rename(tmp_path / "body.yaml")
        return surveyed

    monkeypatch.setattr(mission, "run_survey", survey)
    _, after = begin_mission(scenario, load_body("kleopatra"), tmp_path)
    drawn = draw_transit(after.transit.seed, after.transit.index, after, kleopatra())
    assert after.transit.goal_m is not None
    np.testing.assert_allclose(after.transit.goal_m, drawn.goal)
    assert after.transit.start_m == handed_over.after.transit.start_m


def test_a_mission_may_park_in_the_end(
    handed_over: HandedOver, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In an orbit as high as the survey's, which leads by the ellipsoid that is known."""
    phases = ["survey", "transit", "touch_and_go", "park"]
    scenario, given = load_scenario("bennu_mission", {"task.phases": phases}), []

    def survey(*asked: Any) -> Any:
        given.append(asked[-1])
        raise InputError("enough")

    monkeypatch.setattr(mission, "run_survey", survey)
    body = load_body("bennu")
    with pytest.raises(InputError, match="enough"):
        begin_mission(scenario, body, tmp_path)
    assert given[0].task.away.park_m == around_of(parts_of(scenario)[0], body).radius
    assert isinstance(scenario.task, MissionConfig)
    assert scenario.task.touch.away.park_m is None


def test_phases_that_no_mission_has() -> None:
    with pytest.raises(InputError, match=r"must be \[survey, transit\] or .*, got \['survey'\]"):
        load_scenario("kleopatra_mission", {"task.phases": ["survey"]})


@pytest.mark.parametrize(
    ("key", "value", "words"),
    [
        ("spacecraft.speed_limit_m_s", 0.2, r"speed_limit_m_s is 0\.2: set it higher"),
        ("mpc.keep_out_margin_m", 129.0, r"mpc\.keep_out_margin_m, 129 m, .*: set it lower"),
        ("spacecraft.mass", 0.01, r"set task\.arm_m lower: a head of 15 kg at 2\.84 m"),
    ],
)
def test_what_cannot_follow_is_refused_before_the_survey(
    key: str, value: float, words: str, tmp_path: Path
) -> None:
    scenario = load_scenario("bennu_mission", {key: value})
    with pytest.raises(InputError, match=words):
        begin_mission(scenario, load_body("bennu"), tmp_path)
    assert not list(tmp_path.iterdir())
