"""The closed-loop studies: their variants are what they are named, their columns right."""

import argparse
import dataclasses
import functools
import re
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from scripts import load_script
from short_flights import kleopatra

from proxops.assets import ASSETS
from proxops.diagrams.scenario.scenario import load_scenario
from proxops.diagrams.scenario.scenario_config import Scenario
from proxops.diagrams.scenario.transits import of_transit
from proxops.diagrams.scenario.world import draw_world
from proxops.studies.campaigns.variants import Variant, variant_flights
from proxops.systems.common import InputError
from proxops.systems.navigation import LidarNavigationConfig

PLAIN = {"log_ranges": False, "transit.seed": 10001}


TOLD = "after_survey"


@pytest.fixture(scope="module")
def studies() -> ModuleType:
    return load_script("benchmarks/closed_loop.py")


@functools.cache
def every_line(studies: ModuleType) -> list[Variant]:
    asked = argparse.Namespace(dispersions=TOLD, controller="zero")
    plain = load_scenario(None, PLAIN, on_true_state=True)
    return [variant for variant, _ in studies.one_at_a_time(asked, plain).lines.values()]


def flown(studies: ModuleType, name: str, count: int) -> list[Scenario]:
    [variant] = [each for each in every_line(studies) if each.name == name]
    plain = load_scenario(None, {"log_ranges": False}, on_true_state=True)
    return [each.scenario for each in variant_flights(variant, plain, 10001, range(count))]


def worlds(studies: ModuleType, name: str, count: int) -> list[Scenario]:
    """As `flown`, but quick: of a line that sets a quantity."""
    [variant] = [each for each in every_line(studies) if each.name == name]
    assert variant.world is not None
    plain = load_scenario(None, PLAIN, on_true_state=True)
    return [variant.world(of_transit(plain, 10001, k), kleopatra()) for k in range(count)]


def changed_keys(scenario: Scenario, plain: Scenario) -> set[str]:
    """The keys in which two scenarios differ, but for the note of what was dispersed."""

    def leaves(value: object, key: str) -> dict[str, object]:
        if dataclasses.is_dataclass(value):
            fields = dataclasses.fields(value)
            found = [leaves(getattr(value, each.name), f"{key}.{each.name}") for each in fields]
            return {name: each for part in found for name, each in part.items()}
        return {key[1:]: value}

    one, other = leaves(scenario, ""), leaves(plain, "")
    return {key for key in one | other if one.get(key) != other.get(key)} - {"dispersed"}


def test_every_quantity_of_the_dispersions_has_its_lines(studies: ModuleType) -> None:
    text = (ASSETS / "dispersions" / "after_survey.yaml").read_text()
    keys = re.findall(r"^([a-z][\w.]+):", text, re.MULTILINE)
    parts = ("surface_correlation_m", "surface_seed", "correlation_time_s")
    quantities = [key for key in keys if not key.endswith(parts)]
    assert len(quantities) == len(keys) - 4
    wanted = ["nominal", *(f"{key} x {multiple}" for key in quantities for multiple in (1, 2, 3))]
    names = [each.name for each in every_line(studies)]
    assert names == [
        *wanted, "all of after_survey", "all of before_survey", "the paper's disturbance",
    ]  # fmt: skip


def test_a_line_sets_its_quantity_alone(studies: ModuleType) -> None:
    [nominal] = flown(studies, "nominal", 1)
    assert nominal == load_scenario(None, PLAIN, on_true_state=True)
    together = {
        "truth.surface_rms_m": {
            "truth.surface_rms_m", "truth.surface_correlation_m", "truth.surface_seed",
        },
        # The correlation time that ships is the default.
        "truth.attitude.varying_std_deg": {"truth.attitude.varying_std_deg"},
        "spacecraft.mass_kg": {"spacecraft.mass_kg", "transit.start_m", "transit.goal_m"},
        "lidar.noise_std_m": {"lidar.noise_std_m", "transit.start_m", "transit.goal_m"},
    }  # fmt: skip
    for variant in every_line(studies):
        if variant.world is not None:
            key = variant.name.rpartition(" x ")[0]
            scenario = variant.world(nominal, kleopatra())
            changed = together.get(key, {key}) if key else set()
            assert changed_keys(scenario, nominal) == changed
    for name in ("after_survey", "before_survey"):
        drawn = draw_world(dataclasses.replace(nominal, dispersions=name), kleopatra())
        assert flown(studies, f"all of {name}", 1) == [drawn]
    [paper] = flown(studies, "the paper's disturbance", 1)
    assert paper == load_scenario(None, {**PLAIN, "disturbance": {}}, on_true_state=True)


@pytest.mark.parametrize("multiple", [1, 2, 3])
def test_deviations_are_multiples_of_three_sigma(studies: ModuleType, multiple: int) -> None:
    size = kleopatra().shape.extents.max()

    def found(key: str) -> list:
        scenarios = worlds(studies, f"{key} x {multiple}", 8)
        return [functools.reduce(getattr, key.split("."), each) for each in scenarios]

    gravity = np.array(found("truth.gravity")) - 1.0
    np.testing.assert_allclose(np.abs(gravity), multiple * 0.0015)
    assert {*np.sign(gravity)} == {-1.0, 1.0}
    for key, mean, three_sigma in (
        ("truth.thrusters.scale", 1.0, 0.05),
        ("truth.attitude.constant_deg", 0.0, 0.1),
        ("truth.pole_deg", 0.0, 0.05),
    ):
        off = np.array(found(key)) - mean
        np.testing.assert_allclose(np.linalg.norm(off, axis=1), multiple * three_sigma)
        assert len({tuple(np.sign(each)) for each in off}) > 2
    np.testing.assert_allclose(found("truth.surface_rms_m"), multiple * 0.0005 * size)
    np.testing.assert_allclose(found("truth.lidar.dropout"), multiple * 0.1)
    np.testing.assert_allclose(found("truth.lidar.beam_width_rad"), multiple * 1e-3)
    np.testing.assert_allclose(found("truth.specific_impulse_s"), 220.0 / multiple)
    np.testing.assert_allclose(found("lidar.noise_std_m"), 50.0 * 2.0**multiple)
    mass = np.array(found("spacecraft.mass_kg"))
    np.testing.assert_allclose(np.abs(mass - 100.0), multiple * 2.0)


def test_the_navigation_is_told_the_dispersions_and_nothing_of_the_world(
    studies: ModuleType,
) -> None:
    plain = load_scenario(None, PLAIN)
    of_flight, body = of_transit(plain, 10001, 3), kleopatra()
    told = draw_world(dataclasses.replace(of_flight, dispersions="after_survey"), body).navigation
    assert isinstance(told, LidarNavigationConfig)
    assert told.expected is not None
    assert told.expected.gravity == pytest.approx(0.0005)
    for variant in every_line(studies):
        if variant.world is not None:
            assert variant.world(of_flight, body).navigation == told
    for name in ("after_survey", "before_survey"):
        [variant] = [each for each in every_line(studies) if each.name == f"all of {name}"]
        [flight] = variant_flights(variant, plain, 10001, [3])
        asked = dataclasses.replace(of_flight, dispersions=name)
        assert flight.scenario.navigation == draw_world(asked, body).navigation


def row(**changes: Any) -> dict[str, Any]:
    figures = {
        "seed": 1, "transit": 0, "success": True, "collided": False, "keep_out_violations": 0,
        "min_clearance_m": 3000.0, "steps": 460, "control_ms_mean": 2.0, "mpc_solves": 460,
    }  # fmt: skip
    return figures | changes


def test_columns_of_flights_beside_those_of_the_reference(studies: ModuleType) -> None:
    """Δv is paired; what fails, of either, has none."""
    matched = [row(delta_v_m_s=value) for value in (100.0, 200.0, 1.0)]
    hybrid = {"policy_share": 0.9, "policy_share_to_arrival": 0.8, "control_ms_mean": 0.5}
    rows = [
        row(delta_v_m_s=110.0, mpc_solves=46, **hybrid),
        row(delta_v_m_s=206.0, mpc_solves=23, **hybrid),
        row(delta_v_m_s=9.0, mpc_solves=69, success=False, keep_out_violations=2, **hybrid)
        | {"min_clearance_m": -500.0},
    ]
    columns = (
        "success", "keep-out violations", "least clearance (km)", "policy share (%)",
        "before arrival (%)", "solves saved (%)", "Δv over the reference's, mean", "greatest",
        "a step (ms)", "times less than the reference",
    )  # fmt: skip
    assert studies.figures(columns, rows, matched) == [
        "2/3", "2", "-0.50", "90.0", "80.0", "90.0", "1.0650", "1.100", "0.50", "4.0",
    ]  # fmt: skip
    lost = [row(success=False, delta_v_m_s=1.0)]
    assert studies.figures(["Δv over the reference's, mean"], lost, lost) == ["–"]


def test_lines_are_chosen_with_what_they_are_compared_with(studies: ModuleType) -> None:
    asked = argparse.Namespace(dispersions=TOLD, controller="zero")
    study = studies.one_at_a_time(asked, load_scenario(None, PLAIN, on_true_state=True))
    names = [each.name for each in studies.chosen(study, ["truth.size"])]
    assert names == ["nominal", *(f"truth.size x {multiple}" for multiple in (1, 2, 3))]
    assert [each.name for each in studies.chosen(study, ["truth.spin x 2"])] == [
        "nominal", "truth.spin x 2",
    ]  # fmt: skip
    with pytest.raises(InputError, match=re.escape("the nearest is 'truth.size x 1'")):
        studies.chosen(study, ["truth.sise x 1"])
