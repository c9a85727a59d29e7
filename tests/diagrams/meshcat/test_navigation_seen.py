"""A replay shows where the navigation believes to be, how sure it is, and what it does."""

import numpy as np
import pytest
from known_navigation import ACQUIRING, AXES, DEVIATIONS, ERROR, navigated_log
from meshcat_pages import doubles, pose
from pydrake.geometry import Meshcat
from scipy.spatial.transform import Rotation

from proxops.diagrams.logs import FlightLog
from proxops.diagrams.meshcat.meshcat_scene import Scene
from proxops.diagrams.meshcat.navigation_scene import (
    add_navigation,
    move_navigation,
    navigation_region,
)

UNIT = 100e3


@pytest.fixture(scope="module")
def log() -> FlightLog:
    return navigated_log()


def test_region_is_three_deviations_of_the_covariance(log: FlightLog) -> None:
    region = navigation_region(log.dataset)
    np.testing.assert_array_equal(np.flatnonzero(~region.known), np.arange(ACQUIRING.stop))
    np.testing.assert_allclose(region.errors[50], -ERROR[:3], rtol=1e-5)
    np.testing.assert_allclose(np.sort(region.semi_axes[50]), 3.0 * DEVIATIONS)
    squares = region.axes[50] @ np.diag(region.semi_axes[50] ** 2) @ region.axes[50].T
    np.testing.assert_allclose(
        squares, 9.0 * AXES @ np.diag(DEVIATIONS**2) @ AXES.T, rtol=1e-6, atol=1e-6
    )
    np.testing.assert_allclose(np.linalg.det(region.axes), 1.0)


def test_axes_do_not_spin(log: FlightLog) -> None:
    """Although the order of the deviations changes, and eigenvectors have no sign."""
    count = log.dataset.sizes["time"]
    covariances = log.dataset["navigation_covariance"].values.copy()
    for row in range(count):
        turn = Rotation.from_rotvec([0.0, 0.03 * row, 0.01 * row]).as_matrix()
        deviations = np.array([21.0 + 2.0 * row, 50.0, 100.0])
        covariances[row, :3, :3] = turn @ np.diag(deviations**2) @ turn.T
    columns = log.dataset["navigation_covariance"].copy(data=covariances)
    region = navigation_region(log.dataset.assign(navigation_covariance=columns))
    axes = Rotation.from_matrix(region.axes[ACQUIRING.stop :])
    steps = (axes[1:] * axes[:-1].inv()).magnitude()
    assert np.median(steps) == pytest.approx(np.hypot(0.03, 0.01), rel=0.05)
    assert steps.max() < 0.1


def test_spacecraft_inside_the_region_is_drawn_inside(log: FlightLog, meshcat: Meshcat) -> None:
    """Also where the ellipsoid is drawn smaller, and it has the right place and size."""
    region, position = navigation_region(log.dataset), np.array([160e3, 20e3, -30e3])
    scene = Scene(meshcat, log.body)
    add_navigation(scene)
    inside = np.sum((region.axes[50].T @ region.errors[50] / region.semi_axes[50]) ** 2)
    for times in (10.0, 1e4):
        move_navigation(scene, position, region, 50, times)
        place = pose(meshcat, "/navigation/region")
        packed = meshcat._GetPackedProperty("/navigation/region/ball", "scale")
        drawn = doubles(packed, b"value", 3)
        away = (position / UNIT - place[:3, 3]) @ place[:3, :3]
        factor = min(1.0, 0.4 / (region.semi_axes[50].max() * times / UNIT))
        np.testing.assert_allclose(drawn, factor * times * region.semi_axes[50] / UNIT)
        assert np.sum((away / drawn) ** 2) == pytest.approx(inside, rel=1e-4)
