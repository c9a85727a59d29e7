"""A lidar with a field of view, and a flight that is known by one that is pointed at the body."""

import dataclasses as dc
import math

import numpy as np
import pytest
from short_flights import SHORT

from proxops.diagrams.flight import fly
from proxops.diagrams.scenario import RigidBodyConfig, load_scenario
from proxops.systems import LidarGeometry
from proxops.systems.attitude import AttitudeGuidanceConfig


def test_pixels_lie_in_a_square_field_about_z():
    geometry = LidarGeometry(128, 128, 1e3, math.radians(20.0))
    pixels = geometry.directions.reshape(128, 128, 3)
    np.testing.assert_allclose(np.linalg.norm(pixels, axis=-1), 1.0)
    across = np.degrees(np.arctan2(pixels[..., :2], pixels[..., 2:]))
    # The outer pixels' middles are half a pixel from the edge.
    half = math.degrees(math.atan(math.tan(math.radians(10.0)) * 127 / 128))
    np.testing.assert_allclose(across.min(axis=(0, 1)), -half)
    np.testing.assert_allclose(across.max(axis=(0, 1)), half)
    # Planes run along x, and a flat wall shows an even grid.
    wall = 100.0 * pixels[..., :2] / pixels[..., 2:]
    for axis in range(2):
        steps = np.diff(wall[..., axis], axis=axis)
        np.testing.assert_allclose(steps, steps.mean(), atol=1e-9)


@pytest.mark.slow
def test_navigation_follows_by_a_lidar_of_20_degrees_that_is_pointed_at_the_body():
    narrow = {"lidar.planes": 24, "lidar.rays": 24, "lidar.field_of_view_deg": 20.0}
    craft = RigidBodyConfig(pointing=AttitudeGuidanceConfig(mode="body"))
    log = fly(dc.replace(load_scenario(None, SHORT | narrow), spacecraft=craft))
    figures = log.summary
    assert figures["success"]
    assert figures["navigation_following"] == 1.0
    assert figures["navigation_position_error_m_median"] < 50.0
    # All around, one ray in twenty meets the body; here most do, at every step.
    returns = np.isfinite(log.dataset["ranges"].values).mean(axis=(1, 2))
    assert returns.min() > 0.3
    assert figures["pointing_error_deg_p99"] < 0.1
