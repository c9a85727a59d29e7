"""A lidar on a spacecraft whose axes are not those of K, as it believes."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from ball_lidar import CENTRE, RADIUS, write_ball_bundle
from numpy.typing import ArrayLike
from one_system import context_of
from pydrake.perception import PointCloud
from scipy.spatial.transform import Rotation

from proxops.systems import (
    InputError,
    LearnedLidar,
    Lidar,
    LidarErrors,
    PlanarLidar,
    Polyhedron,
    RayCaster,
    ray_directions,
)
from proxops.systems.common import rotation_matrix
from proxops.systems.lidar import ChordFan

PLACE = np.array([150e3, 20e3, 10e3])
TURN = Rotation.from_rotvec(np.radians([3.0, -40.0, 75.0]))
IDENTITY = np.array([1.0, 0.0, 0.0, 0.0])


def quaternion(turn: Rotation) -> np.ndarray:
    """(w, x, y, z)."""
    return np.roll(turn.as_quat(), 1)


def pose(lidar: PlanarLidar, place: ArrayLike, attitude: np.ndarray | None, time: float = 0.0):
    """A Context; without an attitude the port stays unconnected."""
    turned: dict[str, Any] = {} if attitude is None else {"attitude": attitude}
    return context_of(lidar, time, position=place, **turned)


def frame(lidar: PlanarLidar, place: ArrayLike, attitude: np.ndarray | None = None) -> np.ndarray:
    return lidar.GetOutputPort("ranges").Eval(pose(lidar, place, attitude)).copy()


# --- quaternions ----------------------------------------------------------------------------------


def test_rotation_matrices_are_those_of_scipy() -> None:
    turns = Rotation.random(50, np.random.default_rng(2))
    for turn in turns:
        for scale in (1.0, -1.0, 1.0 + 1e-9):
            got = rotation_matrix(scale * quaternion(turn))
            np.testing.assert_allclose(got, turn.as_matrix(), atol=1e-15)
    assert np.array_equal(rotation_matrix(IDENTITY), np.eye(3))


@pytest.mark.parametrize("bad", [np.zeros(4), np.full(4, np.nan), [1.0, 0, 0]])
def test_what_is_no_quaternion_is_refused(kleopatra: Polyhedron, bad: ArrayLike) -> None:
    with pytest.raises(InputError, match="needs a quaternion"):
        rotation_matrix(np.asarray(bad))
    with pytest.raises(InputError, match="needs a quaternion"):
        Lidar(kleopatra).frames(np.zeros(1), PLACE[None], 0, np.asarray(bad)[None])


# --- rays cast at a mesh --------------------------------------------------------------------------


def test_the_identity_changes_no_bit(kleopatra: Polyhedron) -> None:
    lidar = Lidar(kleopatra, LidarErrors(50.0, dropout=0.1, max_incidence=1.2))
    places = np.random.default_rng(4).normal(size=(20, 3)) * 80e3
    for place in places:
        assert np.array_equal(frame(lidar, place), frame(lidar, place, IDENTITY))
    attitudes = np.tile(IDENTITY, (20, 1))
    times = 10.0 * np.arange(20)
    assert np.array_equal(lidar.frames(times, places, 3), lidar.frames(times, places, 3, attitudes))


@pytest.mark.parametrize("name", ["kleopatra", "torus"])
def test_a_turned_fan_meets_what_every_turned_ray_alone_meets(
    kleopatra: Polyhedron, name: str
) -> None:
    """From inside, near, and far; a body 30 times as long as thick too."""
    plate = trimesh.creation.box([4e3, 30e3, 1e3])
    plate.apply_translation([60e3, -20e3, 35e3])
    torus = trimesh.creation.torus(60e3, 20e3)
    meshes = {"torus": torus, "plate": plate}
    shape = kleopatra if name == "kleopatra" else Polyhedron.from_trimesh(meshes[name], "m")
    caster, directions = RayCaster(shape), ray_directions(6, 180)
    fan, random = caster.fan(directions), np.random.default_rng(5)
    places = random.normal(size=(40, 3)) * np.geomspace(1e3, 3e6, 40)[:, None]
    places = np.concatenate([places, shape.vertices[:10] * 1.001, shape.vertices[:10] * 0.999])
    met = 0
    for place, turn in zip(places, Rotation.random(len(places), random), strict=True):
        hits = fan.hits(place[None], turn.as_matrix())
        got = np.full(len(directions), np.inf)
        got[hits.rays] = hits.distances
        wanted = caster.distances(np.tile(place, (len(directions), 1)), turn.apply(directions))
        # A ray on an edge falls either way if the last bit of its direction differs.
        unlike = np.isfinite(got) != np.isfinite(wanted)
        assert unlike.sum() <= 1
        seen = np.isfinite(got) & ~unlike
        assert np.quantile(np.abs(got[seen] - wanted[seen]), 0.99) < 0.5 if seen.any() else True
        met += seen.sum()
    assert met > 1000


def test_the_point_cloud_stays_in_the_axes_of_the_spacecraft(kleopatra: Polyhedron) -> None:
    lidar = Lidar(kleopatra, LidarErrors())
    context = pose(lidar, PLACE, quaternion(TURN))
    ranges = lidar.GetOutputPort("ranges").Eval(context)
    cloud = lidar.GetOutputPort("point_cloud").Eval(context)
    assert isinstance(cloud, PointCloud)
    hits = np.isfinite(ranges)
    points = cloud.xyzs().T
    np.testing.assert_allclose(points, ranges[hits, None] * ray_directions()[hits], rtol=1e-5)
    # Turned into K they lie on the surface.
    on_surface = PLACE + TURN.apply(points)[::10]
    gaps = trimesh.proximity.closest_point(kleopatra.to_trimesh(), on_surface)[1]
    assert gaps.max() < 0.1


# --- learned lidars -------------------------------------------------------------------------------


def test_chords_of_a_turned_fan_are_those_of_turned_directions() -> None:
    axes, directions = np.array([140e3, 70e3, 65e3]), ray_directions()
    places = np.array([PLACE, [0.0, 10e3, 0.0], [0.0, 0.0, 300e3]])
    got = ChordFan(CENTRE, axes, directions).chords(places, TURN.as_matrix())
    wanted = ChordFan(CENTRE, axes, directions @ TURN.as_matrix().T).chords(places)
    for one, other in zip(got, wanted, strict=True):
        assert np.array_equal(one, other)


@pytest.mark.slow
def test_the_learned_lidar_turns_its_rays_too(tmp_path: Path) -> None:
    lidar = LearnedLidar(write_ball_bundle(tmp_path / "ball"), LidarErrors())
    offset = PLACE - CENTRE
    along = TURN.apply(ray_directions()) @ offset
    room = along**2 - (offset @ offset - RADIUS**2)
    wanted = np.where((room > 0) & (along < 0), -along - np.sqrt(np.maximum(room, 0)), np.inf)
    got = frame(lidar, PLACE, quaternion(TURN))
    clear = np.abs(room) > (0.01 * RADIUS) ** 2
    assert np.array_equal(np.isfinite(got[clear]), np.isfinite(wanted[clear]))
    seen = clear & np.isfinite(wanted)
    assert seen.sum() > 20
    assert got[seen] == pytest.approx(wanted[seen], abs=10.0)
    assert np.array_equal(frame(lidar, PLACE), frame(lidar, PLACE, IDENTITY))
