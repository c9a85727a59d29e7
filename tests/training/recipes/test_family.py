"""The family that the pilot for any body learns from: its scenarios and the expert's plans."""

from pathlib import Path

import numpy as np
import pytest
from short_flights import kleopatra

from proxops.diagrams.flight import Workers
from proxops.diagrams.new_body import hover_map
from proxops.diagrams.scenario import Body, Scenario, load_body, load_scenario
from proxops.systems.common import derived_seed
from proxops.systems.shapes import clearances
from proxops.training.data import expert_plans
from proxops.training.recipes import family_plans, write_family
from proxops.training.recipes.family import RANGES, SpacecraftNumbers, member_scenario

SEED = 11


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("family")
    write_family(folder, SEED, 2)
    return folder


def spacecraft_numbers(scenario: Scenario, body: Body) -> SpacecraftNumbers:
    """The numbers without units of a scenario's spacecraft at its body."""
    craft = scenario.spacecraft
    hover = hover_map(body, craft.mass_kg, grow=scenario.transit.end_clearance_m).forces.max()
    length, acceleration = body.keep_out_semi_axes.max(), craft.thrust_limit_n / craft.mass_kg
    return SpacecraftNumbers(
        hover_share=float(hover / craft.thrust_limit_n),
        speed=float(craft.speed_limit_m_s / np.sqrt(length * acceleration)),
        period=float(scenario.control_period_s / np.sqrt(length / acceleration)),
        pace=float(scenario.mpc.nominal_acceleration_m_s2 / acceleration),
    )


def test_kleopatra_is_in_the_middle_of_the_ranges() -> None:
    numbers = spacecraft_numbers(Scenario(), kleopatra())
    low, high = RANGES
    assert numbers.speed == pytest.approx(np.sqrt(low.speed * high.speed), rel=2e-3)
    assert numbers.period == pytest.approx(np.sqrt(low.period * high.period), rel=2e-3)
    assert low.hover_share < numbers.hover_share < high.hover_share
    assert low.pace < numbers.pace < high.pace
    # Again from the values that the design gives: 40 m/s, 7 N, 100 kg, 10 s, 140 km, 0.03 m/s^2.
    assert numbers.speed == pytest.approx(40.0 / np.sqrt(140e3 * 0.07), rel=1e-12)
    assert numbers.period == pytest.approx(10.0 / np.sqrt(140e3 / 0.07), rel=1e-12)
    assert numbers.pace == pytest.approx(0.03 / 0.07, rel=1e-12)


@pytest.mark.parametrize("numbers", [*RANGES, SpacecraftNumbers(0.3, 0.2, 0.02, 0.25)])
def test_a_scenario_has_the_numbers_that_are_asked_for(numbers: SpacecraftNumbers) -> None:
    body = kleopatra()
    scenario = member_scenario(body, "kleopatra", numbers)
    assert spacecraft_numbers(scenario, body) == pytest.approx(numbers, rel=1e-3)
    # Hovering anywhere over the ellipsoid takes at most this share: here at random places.
    random = np.random.default_rng(3)
    places = random.standard_normal((400, 3))
    places /= np.linalg.norm(places, axis=1, keepdims=True)
    places *= body.keep_out_semi_axes + scenario.transit.end_clearance_m
    apparent = body.gravity_field.evaluate(places).acceleration.copy()
    apparent += body.spin_rate**2 * places * [1.0, 1.0, 0.0]
    force = scenario.spacecraft.mass_kg * np.abs(apparent).max()
    share = force / scenario.spacecraft.thrust_limit_n
    assert 0.9 * numbers.hover_share < share < 1.01 * numbers.hover_share
    # The hybrid's own numbers keep their proportion to the thrust.
    given, craft = Scenario(), scenario.spacecraft
    factor = craft.thrust_limit_n / given.spacecraft.thrust_limit_n
    assert scenario.hybrid.epsilon_magnitude_n / 1.0 == pytest.approx(factor, rel=0.05)
    # Times are in proportion to 1 / sqrt(acceleration), as those of flights at that pace.
    faster = scenario.mpc.nominal_acceleration_m_s2 / 0.03
    assert (scenario.mpc.min_horizon_s / 300.0) ** 2 == pytest.approx(1.0 / faster, rel=0.1)


def test_members_are_written_once_and_alike(folder: Path) -> None:
    paths = [folder / f"{SEED}-{number:05d}" / "scenario.yaml" for number in range(2)]
    written = [path.stat().st_mtime_ns for path in paths]
    before = {path.name: path.read_bytes() for path in paths[1].parent.iterdir()}
    paths[1].unlink()
    assert write_family(folder, SEED, 2) == paths
    assert paths[0].stat().st_mtime_ns == written[0]
    after = {path.name: path.read_bytes() for path in paths[1].parent.iterdir()}
    assert after == before
    assert set(after) == {"body.obj", "body.yaml", "scenario.yaml"}


def test_plans_of_all_members(folder: Path, tmp_path: Path) -> None:
    scenarios = [load_scenario(path) for path in write_family(folder, SEED, 2)]
    told: list[str] = []
    workers = Workers(1, progress=lambda _, text: told.append(text))
    labels = family_plans(scenarios, 2, 4, tmp_path / "plans", workers)
    assert told[-1] == "plans of transits, 4 of 4"
    assert set(labels["member"].tolist()) == {0, 1}
    for number, scenario in enumerate(scenarios):
        own = labels["member"] == number
        limit = scenario.spacecraft.thrust_limit_n
        assert 0.5 * limit < np.abs(labels["force"][own]).max() <= limit * (1.0 + 1e-4)
        axes = load_body(scenario.body).keep_out_semi_axes
        depths = -clearances(axes, labels["state"][own, :3])
        assert (depths < 0.0).mean() > 0.9
        assert depths.max() < 0.02 * axes.max()
    alone = expert_plans(scenarios[1], derived_seed(4, 1), 2, tmp_path / "alone", Workers(1))
    for key, values in alone.items():
        np.testing.assert_array_equal(labels[key][labels["member"] == 1], values)
    # Of fewer members nothing is computed again.
    told.clear()
    one = family_plans(scenarios[:1], 2, 4, tmp_path / "plans", workers)
    assert told == ["plans of transits, 2 of 2"]
    for key, values in one.items():
        np.testing.assert_array_equal(labels[key][labels["member"] == 0], values)
