"""`SceneLidar` against trimesh's own ray casting, and on a body of a MultibodyPlant."""

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import SpatialInertia
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from scipy.spatial import Delaunay
from trimesh.ray.ray_triangle import RayMeshIntersector

from proxops.systems import (
    BodyPose,
    InputError,
    LidarErrors,
    Polyhedron,
    SceneLidar,
    Surface,
    ray_directions,
)

RAYS = ray_directions(3, 24)
# The first of them and opposite points of planes are in the edges of facets.
RAYS = RAYS @ np.array(RollPitchYaw(0.1, 0.2, 0.3).ToRotationMatrix().matrix()).T
FAR = 300.0


def hills() -> trimesh.Trimesh:
    """Terrain of 100 m by 100 m, about z = 0."""
    x, y = np.random.default_rng(1).uniform(-50.0, 50.0, (2, 400))
    z = 3.0 * np.sin(x / 9.0) * np.cos(y / 12.0)
    return trimesh.Trimesh(np.c_[x, y, z], Delaunay(np.c_[x, y]).simplices, process=False)


def box() -> trimesh.Trimesh:
    return trimesh.creation.box(extents=[8.0, 6.0, 4.0])


def scene(**options) -> SceneLidar:
    surfaces = {
        "Hills": Surface.from_trimesh(hills(), "m"),
        "Box": Polyhedron.from_trimesh(box(), "m"),
    }
    return SceneLidar(surfaces, RAYS, max_range=FAR, **options)


def measured(lidar: SceneLidar, sensor: RigidTransform, **surfaces: RigidTransform) -> np.ndarray:
    context = lidar.CreateDefaultContext()
    lidar.GetInputPort("X_WS").FixValue(context, sensor)
    for name, pose in surfaces.items():
        lidar.GetInputPort(f"X_W{name}").FixValue(context, pose)
    return lidar.GetOutputPort("ranges").Eval(context)


def nearest(sensor: RigidTransform, meshes: list[tuple[trimesh.Trimesh, RigidTransform]]):
    """Ranges (R,) by trimesh, of meshes that stand still in the world."""
    found = np.full(len(RAYS), np.inf)
    start, along = sensor.translation(), RAYS @ sensor.rotation().matrix().T
    for mesh, pose in meshes:
        there = mesh.copy().apply_transform(pose.GetAsMatrix4())
        origins = np.tile(start, (len(RAYS), 1))
        points, rays, _ = RayMeshIntersector(there).intersects_location(origins, along)
        np.minimum.at(found, rays, np.linalg.norm(points.reshape(-1, 3) - start, axis=1))
    found[found > FAR] = np.inf
    return found


angles = st.tuples(*3 * [st.floats(-3.0, 3.0)])


@settings(max_examples=20)
@given(turn=angles, box_turn=angles, height=st.floats(6.0, 60.0), aside=st.floats(-40.0, 40.0))
def test_against_trimesh(turn: tuple, box_turn: tuple, height: float, aside: float) -> None:
    sensor = RigidTransform(RollPitchYaw(turn), [aside, 3.0, height])
    moved = RigidTransform(RollPitchYaw(box_turn), [5.0, -aside, 15.0])
    slope = RigidTransform(RollPitchYaw(0.2, -0.1, 0.5), [1.0, 2.0, -4.0])
    found = measured(scene(), sensor, Hills=slope, Box=moved)
    right = nearest(sensor, [(hills(), slope), (box(), moved)])
    # A ray along an edge may pass it on either side.
    same = np.isfinite(found) == np.isfinite(right)
    assert np.count_nonzero(~same) <= 1
    both = same & np.isfinite(right)
    off = np.abs(found[both] - right[both])
    assert np.count_nonzero(off > 1e-3) <= 1


def test_a_flat_floor() -> None:
    """By hand, from both sides."""
    corners = np.array([[-1e3, -1e3, 0.0], [1e3, -1e3, 0.0], [1e3, 1e3, 0.0], [-1e3, 1e3, 0.0]])
    floor = Surface(corners, np.array([[0, 1, 2], [0, 2, 3]]))
    rays = np.array([[0.0, 0.0, -1.0], [0.6, 0.0, -0.8], [0.0, 0.0, 1.0]])
    for errors, second in ((None, 50.0), (LidarErrors(max_incidence=0.5), np.inf)):
        lidar = SceneLidar({"Floor": floor}, rays, max_range=1e4, errors=errors)
        above, below = (RigidTransform([10.0, 20.0, z]) for z in (40.0, -7.0))
        np.testing.assert_allclose(measured(lidar, above), [40.0, second, np.inf], rtol=1e-6)
        np.testing.assert_allclose(measured(lidar, below), [np.inf, np.inf, 7.0], rtol=1e-6)


def test_it_rides_on_a_body_of_a_multibody_plant() -> None:
    """It falls for two seconds from 40 m: the ray straight down says how far."""
    builder = DiagramBuilder()
    plant = builder.AddSystem(MultibodyPlant(time_step=0.0))
    plant.AddRigidBody("other", SpatialInertia.SolidBoxWithMass(1.0, 1.0, 1.0, 1.0))
    craft = plant.AddRigidBody("craft", SpatialInertia.SolidBoxWithMass(1.0, 1.0, 1.0, 1.0))
    plant.Finalize()
    floor = Surface(
        np.array([[-99.0, -99.0, 0.0], [99.0, -99.0, 0.0], [0.0, 99.0, 0.0]]), [[0, 1, 2]]
    )
    down = np.array([[0.0, 0.0, -1.0]])
    lidar = builder.AddSystem(SceneLidar({"Floor": floor}, down, max_range=100.0))
    pose = builder.AddSystem(BodyPose(craft))
    builder.Connect(plant.GetOutputPort("body_poses"), pose.GetInputPort("poses"))
    builder.Connect(pose.GetOutputPort("X_WF"), lidar.GetInputPort("X_WS"))
    simulator = Simulator(builder.Build())
    context = simulator.get_mutable_context()
    high = RigidTransform([1.0, 2.0, 40.0])
    of_plant = plant.GetMyMutableContextFromRoot(context)
    plant.SetFloatingBaseBodyPoseInWorldFrame(of_plant, craft, high)
    simulator.AdvanceTo(2.0)
    ranges = lidar.GetOutputPort("ranges").Eval(lidar.GetMyContextFromRoot(context))
    assert ranges[0] == pytest.approx(40.0 - 0.5 * 9.81 * 2.0**2, abs=1e-3)
    cloud = lidar.GetOutputPort("point_cloud").Eval(lidar.GetMyContextFromRoot(context))
    np.testing.assert_allclose(cloud.xyzs()[:, 0], [0.0, 0.0, -ranges[0]], atol=1e-5)


GROUND = {"Ground": Surface(np.eye(3), [[0, 1, 2]])}


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"scene": {}}, "at least one surface"),
        ({"scene": {"S": Surface(np.eye(3), [[0, 1, 2]])}}, "called S"),
        ({"directions": np.ones((4, 3))}, "unit vectors"),
        ({"directions": np.ones(3)}, "shape"),
        ({"max_range": 0.0}, "max_range"),
        ({"errors": LidarErrors(beam_width=0.01)}, "beam_width"),
        ({"errors": LidarErrors(false_returns=0.1), "max_range": np.inf}, "max_range"),
    ],
)
def test_bad_values(options: dict, message: str) -> None:
    with pytest.raises(InputError, match=message):
        SceneLidar(**({"scene": GROUND, "directions": RAYS, "max_range": 1.0} | options))
