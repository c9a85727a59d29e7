"""Rays that meet moons, against trimesh, and the mask that blanks them."""

import numpy as np
import pytest
import trimesh
from one_system import evaluated
from scipy.spatial.transform import Rotation
from trimesh.ray.ray_triangle import RayMeshIntersector

from proxops.systems.gravity import Moon, MoonConfig, ball, moon_axes, moon_position
from proxops.systems.lidar import LidarErrors, LidarGeometry, LidarWithMoons, MoonMask
from proxops.systems.lidar.moon_mask import stretch_of_the_moon
from proxops.systems.rotation import SteadySpin
from proxops.systems.shapes import Polyhedron

SPIN = SteadySpin([0.0, 1e-4, 7e-4])
_BOX = trimesh.creation.box([90, 60, 40])
BRICK = Polyhedron(_BOX.vertices, _BOX.faces)
CONFIG = MoonConfig(
    1e9, 60.0, 1100.0, 4e4, eccentricity=0.1, inclination_deg=20.0, node_deg=30.0, mesh="brick"
)
TIME = 70.0
GEOMETRY = LidarGeometry(max_range=5e3)


def merged_scene(time: float) -> trimesh.Trimesh:
    """The body, a ball of 300 m, and the moon where it is, as one mesh in K."""
    turned = BRICK.vertices @ moon_axes(CONFIG, time, SPIN).T + moon_position(CONFIG, time, SPIN)
    body = ball(300.0)
    facets = np.concatenate([body.facets, BRICK.facets + len(body.vertices)])
    return trimesh.Trimesh(np.concatenate([body.vertices, turned]), facets)


def lidar() -> LidarWithMoons:
    moons = [Moon(CONFIG, BRICK)]
    return LidarWithMoons(ball(300.0), moons, SPIN, LidarErrors(), GEOMETRY, period=10.0)


@pytest.mark.parametrize("hides", [False, True])
def test_ranges_are_those_of_a_scene_of_both(hides: bool) -> None:
    """From its side, and from beyond the moon, which then hides part of the body."""
    moon = moon_position(CONFIG, TIME, SPIN)
    position = 1.25 * moon if hides else moon + [100.0, 250.0, -200.0]
    found = evaluated(lidar(), "ranges", TIME, position=position)
    directions = GEOMETRY.directions
    origins = np.broadcast_to(position, directions.shape)
    places, rays, _ = RayMeshIntersector(merged_scene(TIME)).intersects_location(
        origins, directions, multiple_hits=False
    )
    wanted = np.full(len(directions), np.inf)
    wanted[rays] = np.linalg.norm(places - position, axis=1)
    alike = np.isfinite(found) == np.isfinite(wanted)
    assert np.count_nonzero(~alike) <= 2
    both = np.isfinite(found) & np.isfinite(wanted)
    np.testing.assert_allclose(found[both], wanted[both], atol=0.05)
    seen = np.linalg.norm(places - moon, axis=1) < 60.0
    assert np.count_nonzero(seen) > 2


def test_one_side_of_a_moon_faces_the_body() -> None:
    for time in (0.0, 1e4, 3e4):
        axes, place = moon_axes(CONFIG, time, SPIN), moon_position(CONFIG, time, SPIN)
        np.testing.assert_allclose(axes.T @ axes, np.eye(3), atol=1e-12)
        assert np.linalg.det(axes) == pytest.approx(1.0)
        np.testing.assert_allclose(axes[:, 0], -place / np.linalg.norm(place), atol=1e-12)


@pytest.mark.parametrize("side", range(3))
def test_mask_blanks_the_moon_and_nothing_else(side: int) -> None:
    """From everywhere, with false returns: the rays that met the moon, and none of the body's."""
    random = np.random.default_rng(side)
    direction = random.normal(size=3)
    position = random.uniform(700.0, 3000.0) * direction / np.linalg.norm(direction)
    ranges = evaluated(lidar(), "ranges", TIME, position=position)
    points = position + np.minimum(ranges, 1e6)[:, None] * GEOMETRY.directions
    moon = moon_position(CONFIG, TIME, SPIN)
    on_moon = np.isfinite(ranges) & (np.linalg.norm(points - moon, axis=1) < 61.0)
    on_body = np.isfinite(ranges) & ~on_moon
    false = random.random(ranges.size) < 0.005
    given = np.where(false, np.minimum(ranges, random.uniform(0.0, 5e3, ranges.size)), ranges)
    mask = MoonMask(GEOMETRY, [CONFIG], SPIN, 310.0)
    left = evaluated(mask, "ranges", TIME, ranges=given)
    assert not np.isfinite(left[on_moon & ~false]).any()
    np.testing.assert_array_equal(left[on_body & ~false], given[on_body & ~false])


def test_mask_takes_the_axes_as_they_are_turned() -> None:
    """A frame that was measured along axes that are turned loses the same points."""
    attitude = np.array([np.cos(0.4), 0.0, 0.0, np.sin(0.4)])
    position = moon_position(CONFIG, TIME, SPIN) + [100.0, 250.0, -200.0]
    ranges = evaluated(lidar(), "ranges", TIME, position=position, attitude=attitude)
    mask = MoonMask(GEOMETRY, [CONFIG], SPIN, 310.0)
    left = evaluated(mask, "ranges", TIME, ranges=ranges, attitude=attitude)
    turn = Rotation.from_quat(attitude, scalar_first=True)
    points = position + turn.apply(np.minimum(ranges, 1e6)[:, None] * GEOMETRY.directions)
    on_moon = np.linalg.norm(points - moon_position(CONFIG, TIME, SPIN), axis=1) < 61.0
    assert np.count_nonzero(on_moon) > 2
    np.testing.assert_array_equal(np.isfinite(left), np.isfinite(ranges) & ~on_moon)


def test_what_is_in_one_stretch_is_the_body() -> None:
    """A body of which 80 m are seen could be the moon, too."""
    along = np.linspace(500.0, 580.0, 20)
    low = stretch_of_the_moon(along, 1000.0, 60.0, 300.0)
    assert not ((along >= low) & (along <= low + 120.0)).any()
    # With one return of a moon beyond it, this is found.
    low = stretch_of_the_moon(np.append(along, 1600.0), 1000.0, 60.0, 300.0)
    assert low <= 1600.0 <= low + 120.0


def test_a_moon_that_touches_the_body_is_not_blanked() -> None:
    near = MoonConfig(1e9, 60.0, 350.0, 4e4)
    ranges = evaluated(lidar(), "ranges", TIME, position=np.array([300.0, 700.0, -600.0]))
    left = evaluated(MoonMask(GEOMETRY, [near], SPIN, 310.0), "ranges", TIME, ranges=ranges)
    np.testing.assert_array_equal(left, ranges)
