"""The lidar against exact intersections, against bodies made by hand, and its noise."""

import numpy as np
import pytest
import trimesh
from pydrake.perception import PointCloud
from scipy import stats
from trimesh.ray.ray_triangle import RayMeshIntersector

from proxops.diagrams.scenario.body import load_body
from proxops.systems import (
    Lidar,
    LidarErrors,
    LidarGeometry,
    Polyhedron,
    ray_directions,
)
from proxops.systems.common.counter_noise import generator


def box(centre, edge: float = 2e3) -> trimesh.Trimesh:
    mesh = trimesh.creation.box(extents=3 * [edge])
    mesh.apply_translation(centre)
    return mesh


def polyhedron(*meshes: trimesh.Trimesh) -> Polyhedron:
    together = trimesh.util.concatenate(list(meshes))
    assert isinstance(together, trimesh.Trimesh)
    return Polyhedron.from_trimesh(together, "m")


def lidar_at(lidar: Lidar, position, time: float = 0.0):
    context = lidar.CreateDefaultContext()
    context.SetTime(time)
    lidar.GetInputPort("position").FixValue(context, np.asarray(position, dtype=float))
    return context


def ranges(lidar: Lidar, context) -> np.ndarray:
    return lidar.GetOutputPort("ranges").Eval(context).reshape(lidar.geometry.planes, -1)


def hits(frame: np.ndarray) -> list[tuple[int, int]]:
    return [(int(i), int(j)) for i, j in np.argwhere(np.isfinite(frame))]


@pytest.fixture(scope="module")
def kleopatra() -> Polyhedron:
    return load_body("kleopatra").shape


# Directions and the order of the frame


def test_directions_of_known_rays():
    rays = ray_directions().reshape(12, 360, 3)
    root = np.sqrt(0.5)
    known = {
        (0, 0): [1, 0, 0],
        (0, 90): [0, 0, 1],
        (0, 180): [-1, 0, 0],
        (0, 270): [0, 0, -1],
        (3, 0): [root, root, 0],
        (6, 0): [0, 1, 0],
        (6, 45): [0, root, root],
        (6, 180): [0, -1, 0],
        (9, 0): [-root, root, 0],
        (11, 90): [0, 0, 1],
    }
    for index, direction in known.items():
        assert rays[index] == pytest.approx(np.array(direction), abs=1e-15)
    assert np.linalg.norm(rays, axis=2) == pytest.approx(np.ones((12, 360)), abs=1e-15)


@pytest.mark.parametrize(
    ("index", "direction"),
    [
        ((0, 0), [1, 0, 0]),
        ((6, 0), [0, 1, 0]),
        ((0, 180), [-1, 0, 0]),
        ((6, 180), [0, -1, 0]),
        ((0, 30), [np.sqrt(0.75), 0, 0.5]),
        ((6, 330), [0, np.sqrt(0.75), -0.5]),
        ((3, 45), [0.5, 0.5, np.sqrt(0.5)]),
        ((9, 225), [0.5, -0.5, -np.sqrt(0.5)]),
    ],
)
def test_small_box_is_hit_by_the_one_ray_towards_it(index, direction):
    position = np.array([-30e3, 10e3, 5e3])
    sphere = trimesh.creation.icosphere(subdivisions=2, radius=1e3)
    sphere.apply_translation(position + 100e3 * np.array(direction))
    lidar = Lidar(polyhedron(sphere), LidarErrors())
    frame = ranges(lidar, lidar_at(lidar, position))
    assert hits(frame) == [index]
    # An icosphere of two subdivisions keeps within 4 % of its radius.
    assert frame[index] == pytest.approx(99e3, abs=40.0)


def test_box_over_the_pole_is_hit_by_one_ray_of_each_plane():
    lidar = Lidar(polyhedron(box([0.0, 0.0, 101e3])), LidarErrors())
    frame = ranges(lidar, lidar_at(lidar, np.zeros(3)))
    assert hits(frame) == [(i, 90) for i in range(12)]
    assert frame[:, 90] == pytest.approx(100e3, abs=0.02)


def test_nearest_of_two_bodies_in_line_returns():
    lidar = Lidar(polyhedron(box([50e3, 0, 0]), box([80e3, 0, 0])), LidarErrors())
    assert ranges(lidar, lidar_at(lidar, np.zeros(3)))[0, 0] == pytest.approx(49e3, abs=0.02)


def test_maximum_range():
    shape = polyhedron(box([101e3, 0.0, 0.0]))
    near, far = (
        Lidar(shape, LidarErrors(), LidarGeometry(max_range=99_990.0)),
        Lidar(shape, LidarErrors(), LidarGeometry(max_range=100_010.0)),
    )
    assert hits(ranges(near, lidar_at(near, np.zeros(3)))) == []
    assert hits(ranges(far, lidar_at(far, np.zeros(3)))) == [(0, 0)]
    default = Lidar(shape, LidarErrors())
    assert hits(ranges(default, lidar_at(default, [-249.9e3, 0, 0]))) == [(0, 0)]
    assert hits(ranges(default, lidar_at(default, [-250.1e3, 0, 0]))) == []


# Against trimesh's own exact intersections


def outside_poses(shape: Polyhedron, count: int, half_edge: float) -> np.ndarray:
    random = np.random.default_rng(4)
    solid = shape.to_trimesh()
    poses = random.uniform(-half_edge, half_edge, (20 * count, 3))
    return poses[~solid.contains(poses)][:count]


def dumb_bell() -> Polyhedron:
    """Two bumpy spheres with a gap between them: rays may meet either, both or the gap."""
    random = np.random.default_rng(9)
    parts = []
    for side in (-1.0, 1.0):
        sphere = trimesh.creation.icosphere(subdivisions=2)
        radii = 25e3 * random.uniform(0.8, 1.2, len(sphere.vertices))
        parts.append(
            trimesh.Trimesh(
                sphere.vertices * radii[:, None] + [side * 45e3, 0.0, 0.0],
                sphere.faces,
                process=False,
            )
        )
    return polyhedron(*parts)


@pytest.mark.parametrize(("name", "count"), [("kleopatra", 8), ("dumb-bell", 12)])
def test_ranges_agree_with_exact_intersections(name, count, kleopatra):
    shape = kleopatra if name == "kleopatra" else dumb_bell()
    lidar = Lidar(shape, LidarErrors(), LidarGeometry(max_range=np.inf))
    mesh = shape.to_trimesh()
    exact = RayMeshIntersector(mesh)
    directions = ray_directions()
    differing, found = 0, 0
    for position in outside_poses(shape, count, 150e3):
        frame = ranges(lidar, lidar_at(lidar, position)).ravel()
        points, rays, facets = exact.intersects_location(
            np.tile(position, (len(directions), 1)), directions, multiple_hits=True
        )
        expected = np.full(len(frame), np.inf)
        distances = np.linalg.norm(points - position, axis=1)
        np.minimum.at(expected, rays, distances)
        incidence = np.ones(len(frame))
        nearest = distances <= expected[rays]
        cosines = np.abs(np.sum(mesh.face_normals[facets] * directions[rays], axis=1))
        incidence[rays[nearest]] = cosines[nearest]
        both = np.isfinite(frame) & np.isfinite(expected)
        # A ray along the rim may fall on either side of it in single precision.
        error = np.abs(frame[both] - expected[both]) * incidence[both]
        rim = error > 0.05
        differing += int((np.isfinite(frame) != np.isfinite(expected)).sum() + rim.sum())
        found += int(both.sum())
    assert found > 300
    assert differing <= 1


# Noise


def test_noise_is_gaussian_with_the_stated_deviation(kleopatra):
    position = [0.0, 20e3, 25e3]
    exact, noisy = Lidar(kleopatra, LidarErrors()), Lidar(kleopatra)
    truth = ranges(exact, lidar_at(exact, position))
    errors = []
    for step in range(12):
        frame = ranges(noisy, lidar_at(noisy, position, 10.0 * step))
        assert hits(frame) == hits(truth)
        errors.append(frame[np.isfinite(truth)] - truth[np.isfinite(truth)])
    sample = np.concatenate(errors)
    count = sample.size
    assert count > 10_000
    assert abs(sample.mean()) < 4.0 * 50.0 / np.sqrt(count)
    assert sample.std() == pytest.approx(50.0, abs=4.0 * 50.0 / np.sqrt(2.0 * count))
    assert stats.kstest(sample / 50.0, "norm").pvalue > 1e-3
    # White over the steps and over the rays of a frame.
    assert abs(np.corrcoef(errors[0], errors[1])[0, 1]) < 4.0 / np.sqrt(errors[0].size)
    assert abs(np.corrcoef(sample[1:], sample[:-1])[0, 1]) < 4.0 / np.sqrt(count)


def test_noise_is_a_pure_function_of_seed_and_step(kleopatra):
    position = [20e3, 60e3, -30e3]
    lidar = Lidar(kleopatra, seed=5)
    context = lidar_at(lidar, position, 30.0)
    frame = ranges(lidar, context).copy()
    # Evaluated elsewhere and at another time in between, in whatever order.
    lidar.GetInputPort("position").FixValue(context, np.array([90e3, 70e3, 0.0]))
    context.SetTime(10.0)
    ranges(lidar, context)
    context.SetTime(30.0)
    lidar.GetInputPort("position").FixValue(context, np.array(position))
    assert np.array_equal(frame, ranges(lidar, context))
    # Cloned, or made by another lidar with the same seed.
    assert np.array_equal(frame, ranges(lidar, context.Clone()))
    twin = Lidar(kleopatra, seed=5)
    assert np.array_equal(frame, ranges(twin, lidar_at(twin, position, 30.0)))
    # The same step until the next begins to be nearer; another step is another draw.
    context.SetTime(30.0 + 1e-9)
    assert np.array_equal(frame, ranges(lidar, context))
    context.SetTime(40.0)
    other = ranges(lidar, context)
    assert hits(other) == hits(frame)
    assert np.all(other[np.isfinite(other)] != frame[np.isfinite(frame)])


def test_rays_that_miss_draw_no_noise():
    """One box or two: the first ray that returns gets the same noise."""
    one = Lidar(polyhedron(box([101e3, 0, 0])))
    two = Lidar(polyhedron(box([101e3, 0, 0]), box([0, 101e3, 0])))
    frame_one, frame_two = (ranges(lidar, lidar_at(lidar, np.zeros(3))) for lidar in (one, two))
    drawn = 50.0 * generator(0, 0).standard_normal(2)
    assert hits(frame_one) == [(0, 0)]
    assert hits(frame_two) == [(0, 0), (6, 0)]
    assert frame_one[0, 0] == frame_two[0, 0] == pytest.approx(100e3 + drawn[0], abs=0.02)
    assert frame_two[6, 0] == pytest.approx(100e3 + drawn[1], abs=0.02)
    nothing = ranges(one, lidar_at(one, [0.0, 0.0, 340e3]))
    assert np.all(np.isposinf(nothing))


def test_ranges_are_never_negative():
    lidar = Lidar(polyhedron(box(np.zeros(3))), LidarErrors(noise_std=5e3))
    frame = ranges(lidar, lidar_at(lidar, np.zeros(3)))
    assert np.isfinite(frame).all()
    assert frame.min() == 0.0


# The other outputs


def test_point_cloud_agrees_with_ranges(kleopatra):
    position = np.array([20e3, 60e3, -30e3])
    lidar = Lidar(kleopatra)
    context = lidar_at(lidar, position, 20.0)
    frame = ranges(lidar, context).ravel()
    cloud = lidar.GetOutputPort("point_cloud").Eval(context)
    assert isinstance(cloud, PointCloud)
    finite = np.isfinite(frame)
    assert cloud.size() == finite.sum() > 0
    expected = frame[finite, None] * ray_directions()[finite]
    points = cloud.xyzs().T
    assert points == pytest.approx(expected, rel=1e-6, abs=0.02)
    exact = Lidar(kleopatra, LidarErrors())
    cloud = exact.GetOutputPort("point_cloud").Eval(lidar_at(exact, position))
    surface = trimesh.proximity.closest_point(
        kleopatra.to_trimesh(), position + cloud.xyzs().T[::20]
    )
    assert surface[1].max() < 0.1  # Points are relative to the spacecraft, on the surface.


def test_point_cloud_of_nothing_is_empty(kleopatra):
    lidar = Lidar(kleopatra)
    context = lidar_at(lidar, [0.0, 0.0, 600e3])
    assert lidar.GetOutputPort("point_cloud").Eval(context).size() == 0


def test_frames_equal_the_port(kleopatra):
    lidar = Lidar(kleopatra, seed=1)
    times = np.array([0.0, 10.0, 20.0, 7.5])
    positions = np.array(
        [[20e3, 60e3, -30e3], [90e3, 70e3, 0.0], [-1e5, 1e5, 1e5], [0.0, 0.0, 70e3]]
    )
    frames = lidar.frames(times, positions, seed=8)
    assert frames.shape == (4, 12, 360)
    assert frames.dtype == np.float32
    for time, position, frame in zip(times, positions, frames, strict=True):
        context = lidar_at(lidar, position, float(time))
        lidar.set_seed(context, 8)
        assert np.array_equal(frame, ranges(lidar, context).astype(np.float32))
    assert lidar.frames(np.zeros(0), np.zeros((0, 3)), seed=8).shape == (0, 12, 360)
