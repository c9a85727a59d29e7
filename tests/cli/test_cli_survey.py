"""`proxops survey`: what it refuses, and what it writes. tests/benchmarks has a whole one."""

import dataclasses as dc
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from commands import proxops
from scipy.spatial.transform import Rotation

from proxops.diagrams.scenario import (
    Scenario,
    SurveyConfig,
    change_scenario,
    load_body,
    load_scenario,
    make_true_body,
)
from proxops.diagrams.surveys import named_estimator, run_survey, survey_run
from proxops.diagrams.surveys.survey_files import NewMap, true_in, visit_scenario
from proxops.diagrams.surveys.survey_flight import Flying, around_of, survey_world
from proxops.systems.common import InputError
from proxops.systems.gravity import moon_position
from proxops.systems.mapping import FEWEST, Returns
from proxops.systems.rotation import SteadySpin, SteadySpinConfig, TorqueFreeSpin


def survey(**task):
    scenario = load_scenario(dispersions="first_look")
    scenario.task = SurveyConfig(**task)
    return scenario


@pytest.mark.parametrize(
    ("scenario", "words"),
    [
        (survey(reach_m=100e3), r"task\.reach_m: the lidar never sees the body"),
        (survey(radius_m=100e3), r"task\.radius_m"),
        (survey(period_s=600.0), "spins too fast for its survey"),
        (load_scenario(), "task: !Survey"),
    ],
)
def test_what_cannot_be_surveyed_is_refused(scenario: Scenario, words: str) -> None:
    with pytest.raises(InputError, match=words):
        around_of(scenario, load_body("kleopatra"))


def test_a_log_that_was_cut_is_refused(tmp_path: Path) -> None:
    (tmp_path / "survey.npz").write_bytes(b"PK\x03\x04 and no more")
    with pytest.raises(InputError, match="no whole log of a survey"):
        run_survey(survey(), load_body("kleopatra"), tmp_path)


def test_frames_of_another_body_are_refused(tmp_path: Path) -> None:
    with (tmp_path / "survey.npz").open("wb") as file:
        names = [*survey_run._FIGURES, *survey_run._HISTORIES, "scenario"]
        names += [f"returns_{name}" for name in Returns._fields]
        empty: dict[str, Any] = dict.fromkeys(names, 0)
        np.savez(file, body=np.array("bennu"), **empty)
    with pytest.raises(InputError, match="frames of another body, bennu, not of kleopatra"):
        run_survey(survey(), load_body("kleopatra"), tmp_path)


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("hybrid", "'hybrid' makes no map: use survey, or MODULE:FUNCTION"),
        ("own_map:nothing", "no function 'nothing'; it should take "),
        ("own_map:short", r"short must take \(returns, around, expected, progress\) and return"),
        ("own_map:empty", r"own_map:empty should take .* and return \(Estimated, MapUncertainty\)"),
        ("own_map:wrong", r"'own_map:wrong': ZeroDivisionError: .* \(own_map\.py, line 10\)"),
    ],
)
def test_estimators_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, words: str
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("own_map.py").write_text(
        "def short(returns):\n    return None\n\n\n"
        "def empty(returns, around, expected, progress):\n    return None\n\n\n"
        "def wrong(returns, around, expected, progress):\n    return 1 / 0\n"
    )
    given: Any = [None] * 4
    with pytest.raises(InputError, match=words):
        named_estimator(name)(*given)


def test_a_map_of_half_a_body_is_refused() -> None:
    survey_run.check_seen(0.95, 20.0)
    with pytest.raises(
        InputError, match=r"saw 51% of the surface in 20 h in orbit: set task\.hours"
    ):
        survey_run.check_seen(0.51, 20.0)


def test_a_body_that_lies_on_its_side_is_refused() -> None:
    body = load_body("bennu")
    config = dc.replace(body.config, rotation=SteadySpinConfig([1.0, 0.0, 1.0]))
    with pytest.raises(InputError, match="turns about another axis than z"):
        around_of(survey(), dc.replace(body, config=config))


def test_a_slow_body_is_surveyed_from_nearby() -> None:
    """At Toutatis an orbit that turns with the body is eight semi-axes out."""
    body = load_body("toutatis")
    around = around_of(survey(), body)
    assert around.radius < 3.0 * around.longest
    np.testing.assert_allclose(around.turn(0.0), np.eye(3), atol=1e-9)
    np.testing.assert_allclose(around.angular_velocity(0.0), body.spin.rate)


def test_an_orbit_is_outside_of_moons_that_are_near() -> None:
    """Or far inside of them, if one says so."""
    body = load_body("didymos")
    [moon] = body.config.moons
    reach = moon.semi_major_axis_m * (1.0 + moon.eccentricity) + moon.radius_m
    around = around_of(survey(), body)
    assert around.keep_out == reach
    assert around.radius > 1.5 * reach
    inside = around_of(survey(radius_m=0.7 * moon.semi_major_axis_m), body)
    assert inside.radius == 0.7 * moon.semi_major_axis_m
    assert inside.keep_out < 0.5 * reach


@pytest.mark.slow
def test_a_body_that_tumbles_is_surveyed(tmp_path: Path) -> None:
    """Also how it turns at the end of the survey, which its file says of the start of a visit."""
    given = load_scenario("toutatis", dispersions="approach")
    given.task, given.transit.seed = SurveyConfig(hours=80.0), 72
    surveyed = run_survey(given, load_body("toutatis"), tmp_path)
    figures = surveyed.figures
    assert figures["map_rms_of_size"] < 5e-4
    assert figures["within_3_sigma"] > 0.99
    assert figures["keep_out_entries"] == 0
    assert abs(figures["gravity_error"]) < 3.0 * figures["gravity_deviation"]
    assert abs(figures["rate_error"]) < 4.0 * figures["rate_deviation"]
    assert figures["pole_error_deg"] < 4.0 * figures["pole_deviation_deg"]
    body = load_body(tmp_path / "body.yaml")
    # Truth and belief tumble alike for a day.
    true = surveyed.placed, make_true_body(body, surveyed.visit.truth, surveyed.placed.shape)
    np.testing.assert_allclose(true[1].spin.rate, true[0].rate, rtol=1e-6, atol=1e-12)
    assert isinstance(body.spin, TorqueFreeSpin)
    first, second = (
        Rotation.from_quat(spin.attitude(86_400.0), scalar_first=True)
        for spin in (body.spin, true[1].spin)
    )
    assert np.degrees((first.inv() * second).magnitude()) < 0.2


@pytest.mark.slow
def test_a_binary_is_surveyed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its moon is neither on the map nor in the mass, and stays where it is among the stars.

    An estimator of one's own takes the same flight, without flying it again.
    """
    given = load_scenario("didymos", dispersions="approach")
    given.task, given.transit.seed = SurveyConfig(hours=60.0), 64
    believed = load_body("didymos")
    surveyed = run_survey(given, believed, tmp_path)
    figures = surveyed.figures
    assert figures["map_rms_of_size"] < 5e-4
    assert abs(figures["gravity_error"]) < 3.0 * figures["gravity_deviation"]
    assert figures["keep_out_entries"] == 0
    body, flight, found = load_body(tmp_path / "body.yaml"), surveyed.flight, surveyed.found
    time = float(flight.returns.times[-1])
    still = SteadySpin(np.zeros(3))
    axes = found.survey.body_attitudes(np.array([time]))[0] @ surveyed.made.rotation.T
    for more in (0.0, 2e4):
        np.testing.assert_allclose(
            axes @ moon_position(body.config.moons[0], more, still),
            moon_position(believed.config.moons[0], time + more, still),
            atol=1e-3,
        )
    assert (body.keep_out_semi_axes >= believed.keep_out_semi_axes).all()
    [moon], [before] = body.moons, believed.moons
    assert moon.shape.volume == pytest.approx(before.shape.volume, rel=1e-6)
    monkeypatch.chdir(tmp_path)
    Path("half_of_it.py").write_text(
        "from proxops.systems.mapping import estimated, map_uncertainty\n\n\n"
        "def estimate(returns, around, expected, progress):\n"
        "    half = returns.chosen(slice(None, None, 2))\n"
        "    found = estimated(half, around, expected, progress)\n"
        "    return found, map_uncertainty(found.survey, found.solution, found.returns)\n"
    )
    flown = (tmp_path / "survey.npz").stat().st_mtime_ns
    half = run_survey(given, believed, tmp_path, estimator="half_of_it:estimate").figures
    assert (tmp_path / "survey.npz").stat().st_mtime_ns == flown
    assert half["returns"] < figures["returns"]  # Many are thinned anyway.
    assert half["map_rms_of_size"] < 6e-4


def test_an_orbit_far_out_is_begun_from_beyond_it() -> None:
    """Falling freely past the body to a lowest point that is nearer than the start."""
    body = load_body("kleopatra")
    for seed in range(20):
        scenario = survey(radius_m=2000e3)
        scenario.transit.seed = seed
        world = survey_world(scenario, body)
        start = np.linalg.norm(world.transit.start)
        assert 4000e3 <= start <= 6000e3
        assert world.scenario.lidar.max_range_m > start


def test_a_flight_is_known_again_by_what_it_read(tmp_path: Path) -> None:
    """Mended settings of what flies after the survey do not fly the survey again."""
    path, body, scenario = tmp_path / "survey.npz", load_body("kleopatra"), survey()
    none = Returns(**dict.fromkeys(Returns._fields, np.zeros(1)))
    figures = dict.fromkeys(survey_run._FIGURES, 0.0)
    histories = dict.fromkeys(survey_run._HISTORIES, np.zeros(1))
    flight: Any = SimpleNamespace(returns=none, **histories, **figures)
    survey_run._keep(path, flight, scenario)
    for key, value, known in (
        ("mpc.keep_out_margin_m", 5.0, True),
        ("navigation", {"_tag": "!TrueState"}, True),
        ("lidar.noise_std_m", 5.0, False),
        ("task.hours", 5.0, False),
        ("transit.seed", 5, False),
    ):
        changed = change_scenario(scenario, {key: value})
        assert (survey_run._kept(path, changed, body) is not None) == known, key


def test_a_flight_goes_on_and_ends_when_it_must() -> None:
    flying = Flying(survey(hours=0.1, approach_hours=0.1), load_body("kleopatra"))
    with pytest.raises(InputError, match=r"task\.approach_hours"):
        flying.fly(0.1)
    flying.close()


def test_a_rigid_spacecraft_keeps_the_body_in_view() -> None:
    """K turns by 33 degrees in that time, a field of view of 20 degrees does not."""
    craft = {"_tag": "!RigidBody", "pointing": {"mode": "body"}}
    lidar = {"field_of_view_deg": 20.0, "planes": 16, "rays": 16}
    task = {"_tag": "!Survey", "hours": 0.1, "approach_hours": 0.4}
    changes = {"spacecraft": craft, "lidar": lidar, "task": task, "dispersions": "first_look"}
    scenario = load_scenario(None, changes)
    flying = Flying(scenario, load_body("kleopatra"))
    with pytest.raises(InputError, match="did not come to its orbit"):
        flying.fly(0.1)
    flying.close()
    seen = [len(rays) >= FEWEST for rays, _ in flying._kept._frames]
    assert np.mean(seen) > 0.95  # A frame in a hundred is lost.


def test_a_lidar_without_a_return_never_saw_the_body() -> None:
    scenario = survey(hours=0.1, approach_hours=0.1)
    scenario.lidar.planes, scenario.lidar.rays = 1, 4
    flying = Flying(scenario, load_body("kleopatra"))
    with pytest.raises(InputError, match="the lidar never saw the body"):
        flying.fly(0.1)
    flying.close()


def test_surveys_start_far_away_and_differ_by_seed() -> None:
    body, starts = load_body("kleopatra"), []
    for seed in (1, 2):
        scenario = survey()
        scenario.transit.seed = seed
        around = around_of(scenario, body)
        starts.append(survey_world(scenario, body).transit.start)
        sizes = np.linalg.norm(starts[-1]) / (2.0 * around.semi_axes.max())
        assert 4.0 <= sizes <= 6.0
        # Known is an ellipsoid, a tenth off at most along each axis.
        assert np.abs(around.semi_axes / (0.5 * body.shape.extents) - 1.0).max() <= 0.1 + 1e-9
    assert not np.allclose(*starts)


def test_visits_at_another_body_are_refused(tmp_path: Path, capsys) -> None:
    code = proxops("survey", "ryugu", "--visits", "bennu_touch_and_go", "--out", tmp_path)
    assert code == 2
    assert "--visits: bennu_touch_and_go is at bennu, not at ryugu" in capsys.readouterr().err


def test_visits_keep_what_they_are_and_take_the_survey_s_world() -> None:
    """A map that is the body itself: the truth stays where it is."""
    body = load_body("bennu")
    world = survey_world(survey(), body)
    flight: Any = SimpleNamespace(world=world)
    made = NewMap(body.shape, np.eye(3), np.zeros(3), np.zeros((len(body.shape.vertices), 1)))
    attitude = np.diag([1.0, 1.0, 1.0])[None]
    found: Any = SimpleNamespace(body_attitudes=lambda times: attitude)
    touch = load_scenario("bennu_touch_and_go")
    placed = true_in(made, found, world, 0.0)
    visit, true = visit_scenario(touch, flight, placed, body), placed.shape
    assert visit.task == touch.task
    assert visit.spacecraft == touch.spacecraft
    assert visit.assurance is None
    assert visit.truth.thrusters == world.scenario.truth.thrusters
    assert visit.truth.gravity == pytest.approx(world.scenario.truth.gravity)
    assert visit.truth.mesh == "truth.obj"
    assert len(true.vertices) == len(world.true_body.shape.vertices)
