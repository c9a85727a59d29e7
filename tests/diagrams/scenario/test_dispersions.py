"""Dispersions: what is drawn, from which numbers, within which bounds; what is refused."""

from pathlib import Path

import numpy as np
import pytest
from scipy import stats
from short_flights import kleopatra

from proxops.assets import ASSETS
from proxops.diagrams.scenario.dispersions import load_dispersions
from proxops.diagrams.scenario.distributions import (
    Distribution,
    Fixed,
    HalfNormal,
    LogUniform,
    Normal,
    Uniform,
)
from proxops.diagrams.scenario.scenario import load_scenario
from proxops.diagrams.scenario.scenario_checks import check_scenario
from proxops.diagrams.scenario.transits import of_transit
from proxops.diagrams.scenario.world import dispersed_values, draw_world
from proxops.systems.common.errors import InputError

SHIPPED = sorted(path.stem for path in (ASSETS / "dispersions").glob("*.yaml"))


def write(folder: Path, text: str) -> str:
    path = folder / "mine.yaml"
    path.write_text(text)
    return str(path)


def drawn(name: str, index: int = 0, seed: int = 7, **changes):
    scenario = load_scenario(None, {"dispersions": name, **changes})
    return draw_world(of_transit(scenario, seed, index), kleopatra())


# --- distributions --------------------------------------------------------------------------------

UNIFORMS = np.random.default_rng(1).random(20_000)


@pytest.mark.parametrize(
    ("distribution", "reference"),
    [
        (Normal(2.0, 0.6), stats.truncnorm(-3.0, 3.0, loc=2.0, scale=0.2)),
        (HalfNormal(1.0, 0.6), stats.truncnorm(0.0, 3.0, loc=1.0, scale=0.2)),
        (Uniform(-1.0, 3.0), stats.uniform(-1.0, 4.0)),
        (LogUniform(0.5, 2.0), stats.loguniform(0.5, 2.0)),
    ],
)
def test_values_have_the_distribution(distribution: Distribution, reference) -> None:
    values = [distribution.value(u) for u in UNIFORMS]
    assert stats.kstest(values, reference.cdf).pvalue > 1e-3


# --- draws ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", SHIPPED)
def test_shipped_dispersions_give_sound_scenarios(name: str) -> None:
    for index in range(5):
        scenario = drawn(name, index)
        check_scenario(scenario)
        assert scenario.dispersions is None
        assert scenario.dispersed
        assert dispersed_values(scenario).keys() == set(scenario.dispersed)


def test_a_file_may_change_dispersions_that_ship(tmp_path: Path) -> None:
    """Only what it says itself differs; draws of other keys do not move."""
    key = "truth.surface_rms_m"
    twice = "{half_normal: 0.0, three_sigma: 0.001, times: size}"  # It ships with half of that.
    mine = write(tmp_path, f"based_on: after_survey\n{key}: {twice}\ntruth.gravity: 1.0\n")
    before, after = (dispersed_values(drawn(name)) for name in ("after_survey", mine))
    assert after[key] == pytest.approx(2.0 * before[key], rel=1e-12)
    assert after.keys() == before.keys() - {"truth.gravity"}
    assert {k: v for k, v in after.items() if k != key} == {
        k: v for k, v in before.items() if k not in (key, "truth.gravity")
    }


@pytest.mark.parametrize("name", SHIPPED)
def test_every_shipped_number_has_a_source(name: str) -> None:
    assert all(each.source for each in load_dispersions(name))


def test_a_draw_depends_on_seed_transit_and_key_alone(tmp_path: Path) -> None:
    one = "truth.gravity: {normal: 1.0, three_sigma: 0.3}\n"
    both = "truth.mass: {uniform: [0.9, 1.1]}\n" + one
    alone = drawn(write(tmp_path, one)).truth.gravity
    (tmp_path / "other").mkdir()
    assert drawn(write(tmp_path / "other", both), noise_seed=5).truth.gravity == alone
    assert drawn(write(tmp_path, one), index=1).truth.gravity != alone
    assert drawn(write(tmp_path, one), seed=8).truth.gravity != alone


def test_draws_of_many_transits_have_the_distribution(tmp_path: Path) -> None:
    name = write(
        tmp_path,
        "truth.gravity: {normal: 1.0, three_sigma: 0.3}\n"
        "truth.attitude.constant_deg: {normal: 0.0, three_sigma: 3.0}\n",
    )
    scenario = load_scenario(None, {"dispersions": name})
    worlds = [draw_world(of_transit(scenario, 7, k), kleopatra()).truth for k in range(200)]
    gravity = np.array([world.gravity for world in worlds])
    axes = np.array([world.attitude.constant_deg for world in worlds])
    cut = stats.truncnorm(-3.0, 3.0)
    for values in ((gravity - 1.0) / 0.1, *axes.T):
        assert stats.kstest(values, cut.cdf).pvalue > 1e-3
    together = np.corrcoef(np.column_stack([gravity, axes]).T)
    assert np.abs(together - np.eye(4)).max() < 0.28  # Four standard deviations.


def test_units(tmp_path: Path) -> None:
    size = kleopatra().shape.extents.max()
    scenario = drawn(
        write(
            tmp_path,
            "truth.surface_rms_m: {fixed: 0.001, times: size}\n"
            "truth.acceleration.varying_std_m_s2: {fixed: 0.1, times: thrust_acceleration}\n"
            "spacecraft.mass_kg: {fixed: 1.5, times: value}\n"
            "truth.lidar.latency_steps: {uniform: [2, 2]}\n",
        )
    )
    assert scenario.truth.surface_rms_m == pytest.approx(0.001 * size)
    assert scenario.truth.acceleration.varying_std_m_s2 == pytest.approx(0.1 * 7.0 / 100.0)
    assert scenario.spacecraft.mass_kg == pytest.approx(150.0)
    assert scenario.truth.lidar.latency_steps == 2
    assert scenario.dispersed == ["truth.lidar.latency_steps"]


def test_a_mesh_lies_beside_its_file(tmp_path: Path) -> None:
    """Workers, and whoever flies a log again, may be in another folder."""
    name = write(tmp_path, "truth.mesh: {choice: [a.obj, null, /b/c.obj]}\n")
    found = {
        drawn(name, index, **{"truth.mesh_of_any_size": True}).truth.mesh for index in range(30)
    }
    assert found == {str(tmp_path / "a.obj"), None, "/b/c.obj"}
    [fixed] = load_dispersions(write(tmp_path, "truth.mesh: a.obj\n"))
    assert fixed.distribution == Fixed((str(tmp_path / "a.obj"),))


# --- bad input ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("based_on: after_surveys", r"based_on must name .* after_survey, .*before_survey"),
        ("based_on: ../dispersions/after_survey", "based_on must name"),
        ("truth.gravty: {normal: 1.0, three_sigma: 0.1}", "no key 'truth.gravty'.* truth.gravity"),
        ("mpc.fuel_weight: {uniform: [0, 1]}", "mpc.fuel_weight cannot be dispersed"),
        ("truth.gravity: {normal: 1.0, three_sigma: -0.1}", "truth.gravity three_sigma must not"),
        ("truth.gravity: {normal: 1.0}", "needs three_sigma"),
        ("truth.gravity: {normal: 1.0, uniform: [0, 1], three_sigma: 1}", "exactly one of"),
        ("truth.gravity: {uniform: [0.9, 1.1], three_sigma: 1}", "which uniform does not take"),
        ("truth.gravity: {uniform: [1.1, 0.9]}", "its lower end first"),
        ("truth.gravity: {uniform: 1.1}", "needs two numbers"),
        ("truth.gravity: {normal: 1.0, three_sigma: 0.1, sigma: 3}", "has 'sigma'"),
        ("truth.gravity: .nan", "needs a finite number for its value, got nan"),
        ("truth.gravity: {log_uniform: [0, 1]}", "positive ends"),
        ("truth.gravity: {choice: []}", "at least one value"),
        ("truth.gravity: {normal: 1.0, three_sigma: 0.1, times: mass}", "must be one of value"),
        ("truth.thrusters.scale: {uniform: [1, 2], times: value}", "is a list"),
        ("truth.thrusters.scale: [1.0, 1.0, 0.98]", "a number for each number of the list"),
        ("truth.spin: {choice: [1.0, slow]}", "needs a number, got 'slow'"),
        (f"truth.spin: {{uniform: [1, {10**400}]}}", "a number has 401 digits"),
        ("truth.surface_rms_m: {normal: 1, three_sigma: 0.3, times: value}", "its value is 0"),
        ("truth.mass: {normal: 1.0, three_sigma: 1.5}", "truth.mass may be drawn as -0.5"),
        ("truth.phase_deg: {uniform: [0.5, 1.5], times: value}", "phase_deg may be drawn as -225"),
    ],
)
def test_senseless_dispersions(text: str, complaint: str, tmp_path: Path) -> None:
    name = write(tmp_path, text + "\n")
    with pytest.raises(InputError, match=complaint) as caught:
        drawn(name, truth={"phase_deg": -150.0})
    assert "mine.yaml" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_unknown_dispersions() -> None:
    with pytest.raises(
        InputError, match=r"after_survey, .*first_look, mission, paper, touch_and_go do"
    ):
        drawn("after_lunch")
    with pytest.raises(InputError, match="cannot be read"):
        drawn("nowhere.yaml")
