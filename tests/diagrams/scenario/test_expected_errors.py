"""What the navigation is told of its own errors: as given, as the dispersions say, or as usual."""

import dataclasses as dc
import math
from pathlib import Path

import numpy as np
import pytest
from scripts import load_script
from short_flights import kleopatra

from proxops.diagrams.scenario import (
    LidarNavigationConfig,
    TrueStateConfig,
    believed,
    draw_world,
    filter_tuning,
    load_dispersions,
    load_scenario,
    of_transit,
)
from proxops.diagrams.scenario.distributions import (
    Choice,
    Distribution,
    Fixed,
    HalfNormal,
    LogUniform,
    Normal,
    Uniform,
)
from proxops.systems import ExpectedErrors, InputError

LIDAR = "navigation=!LidarNavigation {}"
# What the lidar is told from the scenario, what it finds by itself, and what nobody tells it.
NOT_TOLD = {
    "truth.lidar.dropout", "truth.lidar.false_returns", "truth.lidar.frame_loss",
}  # fmt: skip


def told(folder: Path, text: str, *changes: str) -> ExpectedErrors:
    """What the navigation of a drawn world expects."""
    (folder / "mine.yaml").write_text(text)
    scenario = load_scenario(None, [LIDAR, f"dispersions={folder / 'mine.yaml'}", *changes])
    return filter_tuning(believed(draw_world(scenario, kleopatra())), kleopatra())


def test_the_two_kinds_of_navigation() -> None:
    assert load_scenario(None, [LIDAR]).navigation == LidarNavigationConfig()
    assert load_scenario(None, ["navigation=!TrueState {}"]).navigation == TrueStateConfig()
    set_one = load_scenario(None, ["navigation.expected.gravity=0.2"]).navigation
    assert isinstance(set_one, LidarNavigationConfig)
    assert set_one.expected is not None
    assert (set_one.expected.gravity, set_one.expected.attitude_deg) == (0.2, 1.0)
    with pytest.raises(InputError, match="navigation cannot be !Stars; choose from !LidarNav"):
        load_scenario(None, ["navigation=!Stars {}"])
    with pytest.raises(InputError, match="navigation: TrueStateConfig has no keys, got 'expected'"):
        load_scenario(None, ["navigation=!TrueState {expected: null}"])


def test_no_errors_are_expected_of_the_truth() -> None:
    with pytest.raises(InputError, match="TrueState"):
        filter_tuning(load_scenario(None, ["navigation=!TrueState {}"]), kleopatra())


# --- what is told ---------------------------------------------------------------------------------


def test_usual_errors_are_the_defaults_at_kleopatra() -> None:
    found = dc.asdict(filter_tuning(load_scenario(None, [LIDAR]), kleopatra()))
    assert found == pytest.approx(dc.asdict(ExpectedErrors()), rel=1e-5)


def test_what_is_given_is_told_as_it_is() -> None:
    given = "{attitude_deg: 2.0, pole_deg: 1.0, acceleration_m_s2: 3.0e-4, beam_width_rad: 0.002}"
    scenario = load_scenario(None, [f"navigation.expected={given}", "dispersions=before_survey"])
    found = filter_tuning(draw_world(scenario, kleopatra()), kleopatra())
    assert found == ExpectedErrors(
        attitude_deg=2.0, pole_deg=1.0, acceleration_m_s2=3e-4, beam_width_rad=0.002
    )


@pytest.mark.parametrize("name", ["after_survey", "before_survey", "first_look"])
def test_the_dispersions_are_told_and_never_the_draw(name: str) -> None:
    scenario = load_scenario(None, [LIDAR, f"dispersions={name}"])
    worlds = [draw_world(of_transit(scenario, 7, index), kleopatra()) for index in range(3)]
    assert worlds[0].truth != worlds[1].truth
    assert worlds[0].spacecraft != worlds[1].spacecraft
    assert worlds[0].navigation == worlds[1].navigation == worlds[2].navigation
    first = filter_tuning(worlds[0], kleopatra())
    assert first == filter_tuning(believed(worlds[1]), kleopatra())
    # And the scenario that was drawn from is as before.
    assert scenario.navigation == LidarNavigationConfig()


def test_numbers_of_before_survey() -> None:
    """By hand from the file: a third of three sigma, in the units of the fields."""
    scenario = load_scenario(None, [LIDAR, "dispersions=before_survey"])
    found = filter_tuning(draw_world(scenario, kleopatra()), kleopatra())
    size = 218864.0
    by_hand = {
        "attitude_deg": 1.0,
        "attitude_varying_deg": 0.02 / 3.0,
        "attitude_correlation_s": 3600.0,
        "attitude_noise_deg": 0.0,
        "attitude_noise_correlation_s": 10.0,
        "pole_deg": 1.0 / 3.0,
        "spin": 1e-5 / 3.0,
        "gravity": 0.11 / 3.0,
        "thrust": 0.05 / 3.0,
        "thrust_varying": 0.0,
        "thruster": 0.0,
        "thruster_direction_deg": 0.0,
        "propellant_s_per_m": 1.0 / (9.80665 * 220.0),
        "thrust_direction_deg": 1.0 / 3.0,
        "least_impulse_n_s": 0.05,
        "acceleration_m_s2": 1.43e-3 * 0.07 / 3.0,
        "acceleration_varying_m_s2": 4.76e-4 * 0.07,
        "acceleration_correlation_s": 600.0,
        "surface_rms_m": 0.002 * size,  # The roughest that may be drawn.
        "surface_correlation_m": 0.07 * size,
        "size": 0.005 / 3.0,
        "lidar_bias_m": 10.0 / 3.0,
        "lidar_scale": 1e-4,
        "beam_width_rad": 1e-3,
        "relief_rms_m": 0.0,
        "relief_correlation_m": 3e3,
    }
    values = dc.asdict(found)
    # Of the lobes, +- 10 % move it by 5.9 km; a surface that is off by 110 m moves it by 80 m.
    moved = math.hypot(5.9e3 / 3.0, 80.0 / 110.0 * 0.002 * size)
    assert values.pop("centre_of_mass_m") == pytest.approx(moved, rel=0.01)
    assert values == pytest.approx(by_hand, rel=1e-3)


def test_every_shipped_quantity_is_told_or_known_not_to_be() -> None:
    """Of each quantity alone: the navigation expects something else than usual."""
    scenario = load_scenario(None, [LIDAR])
    usual = filter_tuning(scenario, kleopatra())
    not_told = set()
    worlds = load_script("benchmarks/_worlds.py")
    for each in worlds.quantities(load_dispersions("before_survey")):
        world = worlds.far_out_world(scenario, kleopatra(), each, 1.0)
        if filter_tuning(world, kleopatra()) == usual:
            not_told.add(each.main.key)
    not_told -= {"lidar.noise_std_m", "spacecraft.mass_kg"}  # Known on the day.
    # The attitude is expected to be 1 degree off, in any case.
    assert not_told - {"truth.attitude.constant_deg", "truth.phase_deg"} == NOT_TOLD


def test_large_errors_of_attitude_add_up_within_limits(tmp_path: Path) -> None:
    text = (
        "truth.attitude.constant_deg: {normal: 0.0, three_sigma: 9.0}\n"
        "truth.phase_deg: {normal: 0.0, three_sigma: 12.0}\n"
    )
    assert told(tmp_path, text).attitude_deg == pytest.approx(5.0)
    small = "truth.attitude.constant_deg: {normal: 0.0, three_sigma: 0.1}\n"
    assert told(tmp_path, small).attitude_deg == 1.0
    # Of a star tracker, that is taken as it is told.
    rigid = told(tmp_path, small, "spacecraft=!RigidBody {}")
    assert rigid.attitude_deg == pytest.approx(0.1 / 3.0)
    text = "truth.attitude.constant_deg: {normal: 0.0, three_sigma: 90.0}\n"
    with pytest.raises(InputError, match=r"attitude_deg of 30, and can expect at most 11"):
        told(tmp_path, text)


def test_what_disturbs_the_command_is_an_acceleration_that_varies(tmp_path: Path) -> None:
    """By hand: Gauss-Markov processes add up in variance, and in variance times correlation."""
    noise = ["force_noise={std_n: 0.5, correlation_time_s: 60}"]
    found = filter_tuning(load_scenario(None, [LIDAR, *noise]), kleopatra())
    assert found.acceleration_varying_m_s2 == pytest.approx(0.005)
    assert found.acceleration_correlation_s == pytest.approx(60.0)
    white = ["force_noise={std_n: 0.5, correlation_time_s: 0}"]
    found = filter_tuning(load_scenario(None, [LIDAR, *white]), kleopatra())
    assert found.acceleration_correlation_s == 5.0  # Of steps of 10 s.
    # Pushes of 2 m/s every 900 s change the velocity by 2 m/s sqrt(t / 900 s).
    found = filter_tuning(load_scenario(None, [LIDAR, "kicks={}"]), kleopatra())
    growth = 2.0 * found.acceleration_varying_m_s2**2 * found.acceleration_correlation_s
    assert growth == pytest.approx(2.0**2 / 900.0)
    text = "truth.acceleration.varying_std_m_s2: 0.001\n"
    both = told(tmp_path, text, *noise)
    assert both.acceleration_varying_m_s2 == pytest.approx(math.hypot(0.005, 0.001))
    assert both.acceleration_correlation_s == pytest.approx((25.0 * 60.0 + 600.0) / 26.0)


def test_sunlight_is_an_acceleration_that_goes_round(tmp_path: Path) -> None:
    """By hand: 100 m^2 on 100 kg at 1 au, correlated while Kleopatra turns by a radian."""
    sun = ["sunlight={area_m2: 100, distance_au: 1, reflectivity: 1}"]
    found = filter_tuning(load_scenario(None, [LIDAR, *sun]), kleopatra())
    assert found.acceleration_varying_m_s2 == pytest.approx(4.54e-6, rel=5e-3)
    assert found.acceleration_correlation_s == pytest.approx(1.0 / kleopatra().spin_rate)
    assert found.acceleration_m_s2 == 0.0
    both = told(tmp_path, "truth.acceleration.varying_std_m_s2: 4.54e-6\n", *sun)
    assert both.acceleration_varying_m_s2 == pytest.approx(math.hypot(4.54e-6, 4.54e-6), rel=5e-3)


def test_a_disturbance_that_is_drawn_is_told_in_the_mean() -> None:
    """Of the paper's flights three in four are disturbed; nobody tells which."""
    scenario = load_scenario(None, [LIDAR, "dispersions=paper"])
    worlds = [draw_world(of_transit(scenario, 7, index), kleopatra()) for index in range(9)]
    drawn = {world.disturbance.max_relative_magnitude for world in worlds if world.disturbance}
    assert drawn == {0.0, 2.0}
    expected = [filter_tuning(world, kleopatra()) for world in worlds]
    assert all(each == expected[0] for each in expected)
    always = filter_tuning(load_scenario(None, [LIDAR, "disturbance={}"]), kleopatra())
    assert expected[0].acceleration_varying_m_s2 == pytest.approx(
        math.sqrt(0.75) * always.acceleration_varying_m_s2
    )


def test_a_world_of_its_own_is_not_told(tmp_path: Path) -> None:
    """Without dispersions, nobody knows how the world differs."""
    scenario = load_scenario(None, [LIDAR, "truth.gravity=1.3", "truth.surface_rms_m=400.0"])
    same = filter_tuning(load_scenario(None, [LIDAR]), kleopatra())
    assert filter_tuning(draw_world(scenario, kleopatra()), kleopatra()) == same


# --- root mean squares ----------------------------------------------------------------------------

UNIFORMS = (np.arange(100_000) + 0.5) / 100_000


@pytest.mark.parametrize(
    ("distribution", "within"),
    [
        # Their values are cut at three standard deviations, and the figures are not.
        (Normal(2.0, 0.6), 0.015),
        (HalfNormal(0.0, 0.6), 0.015),
        (HalfNormal(1.5, 0.6), 0.015),
        (Uniform(-1.0, 3.0), 1e-6),
        (LogUniform(0.5, 2.0), 1e-6),
        (LogUniform(2.0, 2.0), 1e-12),
        (Choice((1.0, 2.0, 5)), 1e-4),
        (Fixed((3,)), 1e-12),
    ],
)
@pytest.mark.parametrize("about", [0.0, 2.0])
def test_rms_is_that_of_the_values(distribution: Distribution, within: float, about: float) -> None:
    values = np.array([distribution.value(u) for u in UNIFORMS])
    assert distribution.rms(about) == pytest.approx(
        np.sqrt(np.mean((values - about) ** 2)), rel=within, abs=1e-9
    )


def test_texts_have_no_rms() -> None:
    assert Choice(("x", "y")).rms(0.0) is None
    assert Fixed(("x",)).rms(0.0) is None
