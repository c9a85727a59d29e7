"""A lidar mounted crookedly: its rays are turned, and nobody knows."""

from pathlib import Path

import numpy as np
import pytest
import trimesh
from ball_lidar import CENTRE, RADIUS, write_ball_bundle
from numpy.typing import ArrayLike
from pydrake.perception import PointCloud
from scipy.spatial.transform import Rotation

from proxops.diagrams.scenario.body import load_body
from proxops.systems import LearnedLidar, Lidar, LidarErrors, Polyhedron, RayCaster, ray_directions
from proxops.systems.lidar.lidar_errors import misaligned

ANGLE = np.radians(3.0)
PLACE = np.array([150e3, 20e3, 10e3])


@pytest.fixture(scope="module")
def kleopatra() -> Polyhedron:
    return load_body("kleopatra").shape


def frame(lidar, place: ArrayLike, seed: int = 0, time: float = 0.0) -> np.ndarray:
    context = lidar.CreateDefaultContext()
    context.SetTime(time)
    lidar.set_seed(context, seed)
    lidar.GetInputPort("position").FixValue(context, place)
    return lidar.GetOutputPort("ranges").Eval(context).copy()


def turn_of(seed: int, angle: float = ANGLE) -> Rotation:
    """The rotation, found by scipy from what became of the nominal directions."""
    turned = misaligned(ray_directions(), angle, seed)
    found = Rotation.align_vectors(turned, ray_directions())[0]
    np.testing.assert_allclose(turned, found.apply(ray_directions()), atol=1e-9)
    return found


@pytest.mark.parametrize("angle", [1e-3, ANGLE, 2.0, np.pi])
def test_a_rotation_by_the_angle(angle: float) -> None:
    assert turn_of(5, angle).magnitude() == pytest.approx(angle, abs=1e-7)


def test_axes_are_spread_over_the_sphere_by_seed() -> None:
    axes = np.array([turn_of(seed).as_rotvec() / ANGLE for seed in range(400)])
    np.testing.assert_allclose(axes.T @ axes / 400, np.eye(3) / 3.0, atol=0.08)
    assert np.abs(axes.mean(axis=0)).max() < 0.12


@pytest.mark.parametrize("seed", [0, 4])
def test_rays_are_cast_where_they_truly_point(kleopatra: Polyhedron, seed: int) -> None:
    got = frame(Lidar(kleopatra, LidarErrors(attitude_error=ANGLE)), PLACE, seed)
    directions = turn_of(seed).apply(ray_directions())
    wanted = RayCaster(kleopatra).distances(np.tile(PLACE, (4320, 1)), directions)
    # Rays that graze an edge may fall either way for single precision.
    same = np.isfinite(got) == np.isfinite(wanted)
    assert same.mean() > 0.999
    seen = np.isfinite(got) & np.isfinite(wanted)
    assert seen.sum() > 50
    assert np.median(np.abs(got[seen] - wanted[seen])) < 0.1
    assert not np.array_equal(got, frame(Lidar(kleopatra, LidarErrors()), PLACE, seed))


def test_as_if_the_body_were_turned_the_other_way(kleopatra: Polyhedron) -> None:
    back = turn_of(3).inv()
    turned = trimesh.Trimesh(
        back.apply(kleopatra.vertices.copy()), kleopatra.facets, process=False, validate=False
    )
    other = Lidar(Polyhedron.from_trimesh(turned, "m"), LidarErrors())
    got = frame(Lidar(kleopatra, LidarErrors(attitude_error=ANGLE)), PLACE, 3)
    wanted = frame(other, back.apply(PLACE))
    assert (np.isfinite(got) == np.isfinite(wanted)).mean() > 0.999
    seen = np.isfinite(got) & np.isfinite(wanted)
    assert np.median(np.abs(got[seen] - wanted[seen])) < 0.5


def test_others_believe_the_nominal_directions(kleopatra: Polyhedron) -> None:
    """The point cloud lies along them, turned away from the surface by the error."""
    lidar = Lidar(kleopatra, LidarErrors(attitude_error=ANGLE))
    context = lidar.CreateDefaultContext()
    lidar.GetInputPort("position").FixValue(context, PLACE)
    ranges = lidar.GetOutputPort("ranges").Eval(context)
    cloud = lidar.GetOutputPort("point_cloud").Eval(context)
    assert isinstance(cloud, PointCloud)
    hits = np.isfinite(ranges)
    points = cloud.xyzs().T
    np.testing.assert_allclose(points, ranges[hits, None] * ray_directions()[hits], rtol=1e-5)
    true = turn_of(0).apply(ray_directions())[hits] * ranges[hits, None]
    off = np.linalg.norm(points - true, axis=1) / ranges[hits]
    assert off.max() <= 2.0 * np.sin(ANGLE / 2.0) + 1e-5


def test_the_same_at_every_step_but_not_for_every_seed(kleopatra: Polyhedron) -> None:
    lidar = Lidar(kleopatra, LidarErrors(attitude_error=ANGLE))
    first = frame(lidar, PLACE)
    assert np.array_equal(first, frame(lidar, PLACE, time=500.0))
    others = [frame(lidar, PLACE, seed) for seed in (1, 2, 3)]  # More than are kept.
    assert not any(np.array_equal(first, other) for other in others)
    assert np.array_equal(first, frame(lidar, PLACE))
    assert np.array_equal(lidar.frames(np.zeros(1), PLACE[None], 2)[0].ravel(),
                          others[1].astype(np.float32))  # fmt: skip


def test_grazing_is_judged_by_the_true_rays() -> None:
    """A wall 10 km off, rays in one plane: what returns lies within 30° of the true normal."""
    wall = trimesh.creation.box([2e3, 200e3, 200e3])
    wall.apply_translation([11e3, 0.0, 0.0])
    errors = LidarErrors(max_incidence=np.radians(30.0), attitude_error=np.radians(15.0))
    lidar = Lidar(Polyhedron.from_trimesh(wall, "m"), errors)
    found = np.isfinite(frame(lidar, np.zeros(3), 6))
    cosine = turn_of(6, np.radians(15.0)).apply(ray_directions())[:, 0]
    clear = np.abs(cosine - np.cos(np.radians(30.0))) > 1e-5
    assert np.array_equal(found[clear], (cosine > np.cos(np.radians(30.0)))[clear])


def test_the_learned_lidar_has_it_too(tmp_path: Path) -> None:
    lidar = LearnedLidar(write_ball_bundle(tmp_path / "ball"), LidarErrors(attitude_error=ANGLE))
    offset = PLACE - CENTRE
    along = turn_of(7).apply(ray_directions()) @ offset
    room = along**2 - (offset @ offset - RADIUS**2)
    wanted = np.where((room > 0) & (along < 0), -along - np.sqrt(np.maximum(room, 0)), np.inf)
    got = frame(lidar, PLACE, 7)
    clear = np.abs(room) > (0.01 * RADIUS) ** 2
    assert np.array_equal(np.isfinite(got[clear]), np.isfinite(wanted[clear]))
    seen = clear & np.isfinite(wanted)
    assert seen.sum() > 20
    assert got[seen] == pytest.approx(wanted[seen], abs=10.0)
