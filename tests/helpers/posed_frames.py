"""Bodies of several forms, poses around them, and the frames that a lidar takes there."""

import dataclasses as dc
import functools
from collections.abc import Callable

import numpy as np
import trimesh
from contact_binary import contact_binary
from one_system import evaluated
from scipy.spatial.transform import Rotation
from short_flights import kleopatra

from proxops.systems import Lidar, LidarErrors, LidarGeometry, Polyhedron
from proxops.systems.navigation.frame_model import FrameModel
from proxops.systems.navigation.map_error import MapError
from proxops.systems.shapes import displaced

STD = np.radians(1.0)
# Noise over the size of the body; greatest range over it.
NOISE, REACH = 2e-4, 1.6


def lumpy() -> Polyhedron:
    """A ball with hills, as high as a tenth of its radius."""
    ball = Polyhedron.from_trimesh(trimesh.creation.icosphere(4, radius=250.0), "m")
    return displaced(ball, 25.0, 80.0, seed=4).recentred()


def ellipsoid() -> Polyhedron:
    """3:1:1, with so much relief that it looks different from all sides."""
    mesh = trimesh.creation.icosphere(4)
    smooth = Polyhedron(mesh.vertices * [3e3, 1e3, 1e3], mesh.faces, "ellipsoid")
    return displaced(smooth, 60.0, 400.0, seed=2).recentred()


BODIES: dict[str, Callable[[], Polyhedron]] = {
    "kleopatra": lambda: kleopatra().shape,
    "contact binary": lambda: Polyhedron.from_trimesh(contact_binary(), "m").recentred(),
    "lumpy ball": lumpy,
    "ellipsoid": ellipsoid,
}


@functools.cache
def body(name: str) -> Polyhedron:
    return BODIES[name]()


@functools.cache
def model(name: str) -> FrameModel:
    shape = body(name)
    size = float(shape.extents.max())
    return FrameModel(shape, LidarGeometry(max_range=REACH * size), NOISE * size, MapError(shape))


def poses(name: str, count: int, seed: int) -> list[tuple[np.ndarray, Rotation]]:
    """Places evenly in a cube around the body, outside of it, and attitudes off by some 1°."""
    shape, rng = body(name), np.random.default_rng(seed)
    size, mesh = float(shape.extents.max()), shape.to_trimesh()
    found: list[tuple[np.ndarray, Rotation]] = []
    while len(found) < count:
        place = size * rng.uniform(-0.8, 0.8, 3)
        if -trimesh.proximity.signed_distance(mesh, place[None])[0] > 0.05 * size:
            found.append((place, Rotation.from_rotvec(STD * rng.normal(size=3))))
    return found


def measured(name: str, pose: tuple[np.ndarray, Rotation], seed: int, **errors: float):
    """The frame of a pose, as the real lidar would take it."""
    place, turn = pose
    modelled = model(name)
    wrong = dc.replace(LidarErrors(noise_std=modelled.noise_std), **errors)
    lidar = Lidar(body(name), wrong, modelled.geometry, seed=seed)
    quaternion = turn.as_quat(scalar_first=True)
    return evaluated(lidar, "ranges", position=place, attitude=quaternion)
