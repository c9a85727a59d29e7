"""The lidar against exact intersections, against bodies made by hand, and its noise."""

import numpy as np
import pytest
import trimesh
from contact_binary import box, polyhedron
from one_system import context_of
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource
from trimesh.ray.ray_triangle import RayMeshIntersector

from proxops.systems import Lidar, LidarErrors, LidarGeometry, Polyhedron, ray_directions


def ranges(lidar: Lidar, context) -> np.ndarray:
    return lidar.GetOutputPort("ranges").Eval(context).reshape(lidar.geometry.planes, -1)


def hits(frame: np.ndarray) -> list[tuple[int, int]]:
    return [(int(i), int(j)) for i, j in np.argwhere(np.isfinite(frame))]


# Directions and the order of the frame


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
    frame = ranges(lidar, context_of(lidar, position=position))
    assert hits(frame) == [index]
    # An icosphere of two subdivisions keeps within 4 % of its radius.
    assert frame[index] == pytest.approx(99e3, abs=40.0)


def test_maximum_range():
    shape = polyhedron(box([101e3, 0.0, 0.0], 3 * [2e3]))
    near, far = (
        Lidar(shape, LidarErrors(), LidarGeometry(max_range=99_990.0)),
        Lidar(shape, LidarErrors(), LidarGeometry(max_range=100_010.0)),
    )
    assert hits(ranges(near, context_of(near, position=np.zeros(3)))) == []
    assert hits(ranges(far, context_of(far, position=np.zeros(3)))) == [(0, 0)]
    default = Lidar(shape, LidarErrors())
    assert hits(ranges(default, context_of(default, position=[-249.9e3, 0, 0]))) == [(0, 0)]
    assert hits(ranges(default, context_of(default, position=[-250.1e3, 0, 0]))) == []


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


@pytest.mark.parametrize(("name", "count"), [("kleopatra", 3), ("dumb-bell", 4)])
def test_ranges_agree_with_exact_intersections(name, count, kleopatra):
    shape = kleopatra if name == "kleopatra" else dumb_bell()
    lidar = Lidar(shape, LidarErrors(), LidarGeometry(max_range=np.inf))
    mesh = shape.to_trimesh()
    exact = RayMeshIntersector(mesh)
    directions = ray_directions()
    differing, found = 0, 0
    for position in outside_poses(shape, count, 150e3):
        frame = ranges(lidar, context_of(lidar, position=position)).ravel()
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
    assert found > 100
    assert differing <= 1


# Noise


# The other outputs


def test_a_seed_is_set_in_a_context_of_the_lidar_alone(kleopatra):
    """In that of a diagram it would be a parameter of another system."""
    builder = DiagramBuilder()
    source = builder.AddSystem(ConstantVectorSource([150e3, 0.0, 0.0]))
    lidar = builder.AddSystem(Lidar(kleopatra))
    builder.Connect(source.get_output_port(), lidar.GetInputPort("position"))
    context = builder.Build().CreateDefaultContext()
    with pytest.raises(RuntimeError, match="Use GetMyContextFromRoot"):
        lidar.set_seed(context, 7)
    lidar.set_seed(lidar.GetMyMutableContextFromRoot(context), 7)
    assert lidar.seed_of(lidar.GetMyContextFromRoot(context)) == 7


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
        context = context_of(lidar, float(time), position=position)
        lidar.set_seed(context, 8)
        assert np.array_equal(frame, ranges(lidar, context).astype(np.float32))
    assert lidar.frames(np.zeros(0), np.zeros((0, 3)), seed=8).shape == (0, 12, 360)
