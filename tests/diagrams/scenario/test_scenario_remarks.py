"""What is said of a scenario that may be flown, but not as its user may think."""

import dataclasses as dc
from pathlib import Path

import pytest
from short_flights import kleopatra

from proxops.diagrams.new_body import scaled_scenario, write_generated_body
from proxops.diagrams.scenario import load_body, load_scenario, scenario_remarks
from proxops.systems import Polyhedron


def said(*changes: str) -> list[str]:
    return scenario_remarks(load_scenario(None, list(changes)), kleopatra())


def test_nothing_is_said_of_what_is_usual() -> None:
    assert said() == []
    assert said("dispersions=after_survey") == []
    assert said("truth.attitude.constant_deg=[0.5, 0, 0]") == []  # It expects a degree.
    assert said("transit.start_m=[0, 110e3, 0]", "transit.goal_m=[0, 80e3, 0]") == []


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        ("truth.surface_rms_m=100", "surface_rms_m=50"),
        ("truth.gravity=0.8", "gravity=0.2"),
        ("truth.thrusters.scale=[1, 0.9, 1]", "thrust=0.1"),
        ("truth.mass=1.1", "thrust=0.1"),
        ("truth.density_contrast=0.2", "centre_of_mass_m=500"),
        ("truth.lidar.bias_m=30", "lidar_bias_m=20"),
        ("truth.thrusters.least_impulse_n_s=0.1", "least_impulse_n_s=0.1"),
    ],
)
def test_an_error_that_the_navigation_does_not_expect(change: str, expected: str) -> None:
    (remark,) = said(change)
    name, _ = expected.split("=")
    assert f"give navigation.expected.{name}" in remark
    assert change.split("=")[0] in remark
    assert said(change, f"navigation.expected.{expected}") == []
    assert said(change, "navigation=!TrueState {}") == []


def test_a_rigid_spacecraft_owes_what_is_too_little() -> None:
    assert said("truth.thrusters.least_impulse_n_s=0.1", "spacecraft=!RigidBody {}") == []


def test_thrusters_that_are_too_strong_for_the_arrival() -> None:
    (remark,) = said("spacecraft=!RigidBody {}", "arrival.speed_m_s=0.0023")
    assert remark.startswith(
        "the least pulse of a thruster of smallsat changes the speed by 0.0008"
    )
    assert "raise arrival.speed_m_s" in remark
    assert said("spacecraft=!RigidBody {}", "arrival.speed_m_s=0.02") == []


def test_a_body_in_the_wrong_unit() -> None:
    shape = kleopatra().shape
    tiny = Polyhedron(1e-5 * shape.vertices, shape.facets, "tiny")
    small = dc.replace(kleopatra(), shape=tiny)
    remarks = scenario_remarks(load_scenario(), small)
    assert any("is 2.19 m long: if its mesh is in km" in remark for remark in remarks)


def test_a_scenario_of_another_body(tmp_path: Path) -> None:
    write_generated_body(tmp_path, 1, 0)
    path = str(tmp_path / "body.yaml")
    body = load_body(path)
    (remark,) = scenario_remarks(load_scenario(None, [f"body={path}"]), body)
    assert "made for another body" in remark
    assert scenario_remarks(scaled_scenario(body, path), body) == []


def test_what_the_mpc_does_not_fly_well_with() -> None:
    (remark,) = said("control_period_s=200")
    assert "give at least 400" in remark
    assert said("control_period_s=200", "mpc.min_horizon_s=400") == []
    (remark,) = said("transit.start_m=[0, 110e3, 0]", "transit.goal_m=[0, 71e3, 0]")
    assert "the MPC stops short of it" in remark


def test_a_tumbling_that_nobody_is_told_of() -> None:
    (remark,) = said("truth.tumbles=true")
    assert "truth.tumbles is set, but a steady spin is believed" in remark
    assert said("truth.tumbles=true", "navigation=TrueState") == []
