"""The navigation's benchmark: bodies and poses are what it says, figures what statistics says."""

import dataclasses
from types import ModuleType

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scripts import load_script
from short_flights import BRIEF, kleopatra, short_scenario

from proxops.diagrams.flight import fly
from proxops.diagrams.logs import FlightLog
from proxops.diagrams.scenario import (
    LidarNavigationConfig,
    load_scenario,
)
from proxops.systems.shapes import Polyhedron


@pytest.fixture(scope="module")
def navigation() -> ModuleType:
    return load_script("benchmarks/navigation.py")


@pytest.fixture(scope="module")
def flights() -> ModuleType:
    return load_script("benchmarks/_navigation_flights.py")


@pytest.fixture(scope="module")
def poses() -> ModuleType:
    return load_script("benchmarks/_navigation_poses.py")


@pytest.fixture(scope="module")
def bodies() -> ModuleType:
    return load_script("benchmarks/_bodies.py")


def on_lidar_for_150_s() -> FlightLog:
    scenario = short_scenario(**BRIEF)
    return fly(dataclasses.replace(scenario, navigation=LidarNavigationConfig()), body=kleopatra())


# --- bodies and poses -----------------------------------------------------------------------------


def test_poses_are_in_the_cube_and_outside_the_body(poses: ModuleType) -> None:
    scenario, body = load_scenario(), kleopatra()
    shape = Polyhedron(body.shape.vertices, body.shape.facets).to_trimesh()
    found = [poses.pose(scenario, body, 5, index) for index in range(200)]
    places = np.array([position for position, _ in found])
    assert 190e3 < np.abs(places).max() <= 1.15 * 170e3
    near = places[np.linalg.norm(places, axis=1) < 110e3]
    # No point of it is inside: its winding number is 0.
    triangles = np.asarray(shape.triangles)
    for place in near:
        a, b, c = (triangles - place).transpose(1, 0, 2)
        la, lb, lc = (np.linalg.norm(each, axis=1) for each in (a, b, c))
        dots = [np.einsum("ni,ni->n", x, y) for x, y in ((a, b), (b, c), (c, a))]
        below = la * lb * lc + dots[0] * lc + dots[1] * la + dots[2] * lb
        angle = 2.0 * np.arctan2(np.einsum("ni,ni->n", a, np.cross(b, c)), below)
        assert abs(angle.sum()) < 0.1
    turns = Rotation.from_quat([attitude for _, attitude in found], scalar_first=True)
    np.testing.assert_allclose(np.degrees(turns.magnitude()), 1.0)
    assert (np.abs(turns.as_rotvec(degrees=True).mean(axis=0)) < 0.2).all()


# --- what is kept of a flight ---------------------------------------------------------------------


def test_kept_of_a_flight(flights: ModuleType, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(flights, "SETTLED", 5)
    log = on_lidar_for_150_s()
    row = flights.describe_navigation(log)
    steps, data = row["steps"], log.dataset.isel(time=slice(0, -1))
    assert row["size_m"] == pytest.approx(218.9e3, rel=1e-3)
    errors = (data["state"] - data["navigation_state"]).values
    np.testing.assert_allclose(steps["position"], np.linalg.norm(errors[:, :3], axis=1), rtol=1e-5)
    np.testing.assert_allclose(steps["velocity"], np.linalg.norm(errors[:, 3:], axis=1), rtol=1e-5)
    turns = Rotation.from_quat(data["navigation_attitude"].values, scalar_first=True)
    np.testing.assert_allclose(steps["attitude"], np.degrees(turns.magnitude()), rtol=1e-4)
    # S is not turned, so that the error is the inverse of what is believed.
    whole = np.hstack([errors, -turns.as_rotvec()])
    covariances = data["navigation_covariance"].values
    deviations = np.sqrt(np.einsum("nii->ni", covariances))
    np.testing.assert_allclose(steps["worst"], np.abs(whole / deviations).max(axis=1), rtol=1e-4)
    nees = [e @ np.linalg.inv(p) @ e for e, p in zip(whole, covariances, strict=True)]
    np.testing.assert_allclose(steps["nees"], nees, rtol=1e-3)
    shares = (np.abs(whole[5:]) <= 3.0 * deviations[5:]).mean(axis=0)
    np.testing.assert_allclose(steps["inside"], shares)


# --- figures --------------------------------------------------------------------------------------


def rows_of(scale: float, count: int = 40, length: int = 120) -> list[dict]:
    """Flights whose errors are `scale` standard deviations, and innovations as they should be."""
    random = np.random.default_rng(1)
    rows = []
    for _ in range(count):
        errors = scale * random.standard_normal((length, 9))
        returns = random.integers(200, 600, length)
        rows.append({"steps": {
            "nees": (errors**2).sum(axis=1).tolist(),
            "nis": random.chisquare(returns).tolist(),
            "returns": returns.tolist(),
        }})  # fmt: skip
    return rows


def test_consistency(flights: ModuleType) -> None:
    good = flights.consistency(rows_of(1.0))
    assert good["nees"] == pytest.approx(1.0, abs=0.02)
    assert 0.85 < good["nees_inside"] < 1.0
    # 360 degrees of freedom: about 1 with a standard deviation of sqrt(2 / 360).
    assert (good["low"], good["high"]) == pytest.approx((1 - 0.146, 1 + 0.146), abs=0.01)
    assert good["nis"] == pytest.approx(1.0, abs=0.01)
    assert good["nis_inside"] == pytest.approx(0.95, abs=0.01)
    wrong = flights.consistency(rows_of(2.0))
    assert wrong["nees"] == pytest.approx(4.0, abs=0.1)
    assert wrong["nees_inside"] == 0.0
    assert np.isnan(flights.consistency([])["nees"])
