"""A learned lidar for tests that has learned nothing: its network is the closed form of a ball."""

from functools import partial
from pathlib import Path

import numpy as np
import torch
import trimesh
from exported_once import exported_once
from torch import Tensor, nn

from proxops.systems import Polyhedron, ray_directions
from proxops.systems.lidar.ray_chords import ChordFan
from proxops.training.lidar.bundle import Facts, write_bundle, write_frame_bundle

RADIUS = 50e3
CENTRE = np.array([1e3, -2e3, 3e3])
# The ellipsoid that holds the ball is a ball too, twice as large.
HOLDING = 2.0 * RADIUS
ELLIPSOID = CENTRE, np.full(3, HOLDING)


class BallNetwork(nn.Module):
    """Chord ends in the unit ball to what a ball of radius 1/2 answers.

    From the entry e along the unit vector u, b = e·u, |e + t u| = 1/2 at
    t = -b - sqrt(b² - e² + 1/4).
    """

    def forward(self, chords: Tensor) -> tuple[Tensor, Tensor]:
        entry, way = chords[:, :3].double(), (chords[:, 3:] - chords[:, :3]).double()
        length = (way * way).sum(dim=1).clamp(min=1e-12).sqrt()
        along = (entry * way).sum(dim=1) / length
        room = along * along - (entry * entry).sum(dim=1) + 0.25
        depth = (-along - room.clamp(min=0.0).sqrt()) / length
        return (1000.0 * torch.minimum(room, -along)).float(), depth.float()


class BallFrameNetwork(nn.Module):
    """The paper's kind of network: a position over half of the cube's edge to a frame in km."""

    ways: Tensor
    centre: Tensor

    def __init__(self):
        super().__init__()
        self.register_buffer("ways", torch.tensor(ray_directions(12, 360)))
        self.register_buffer("centre", torch.tensor(CENTRE))

    def forward(self, positions: Tensor) -> Tensor:
        away = positions.double() * 170e3 - self.centre
        along = away @ self.ways.T
        room = along * along - (away * away).sum(dim=1, keepdim=True) + RADIUS**2
        distance = -along - room.clamp(min=0.0).sqrt()
        seen = (room > 0.0) & (along < 0.0)
        return torch.where(seen, 1e-3 * distance, -100.0).float()


def ball_shape() -> Polyhedron:
    mesh = trimesh.creation.icosphere(6, radius=RADIUS)
    mesh.apply_translation(CENTRE)
    return Polyhedron.from_trimesh(mesh, "m")


def ball_facts(shape_sha256: str = "") -> Facts:
    body = {"body": "Ball", "shape_sha256": shape_sha256}
    return {"planes": 12, "rays": 360, "cube_m": 340e3, "training": {}} | body


def chord_ends() -> np.ndarray:
    fan = ChordFan(CENTRE, np.full(3, HOLDING), ray_directions())
    return fan.chords(np.array([[150e3, 20e3, 10e3], [-90e3, 90e3, -80e3]])).ends


def export_ball_bundle(folder: Path, shape_sha256: str = "") -> Path:
    """A bundle in `folder`, for 12 planes of 360, as if trained on a body of that shape."""
    write_bundle(folder, BallNetwork(), ball_facts(shape_sha256), ELLIPSOID, chord_ends())
    return folder


def export_ball_frame_bundle(folder: Path, shape_sha256: str = "") -> Path:
    """The same of the paper's kind, whose ranges are in km."""
    positions = np.array([[150e3, 20e3, 10e3], [-90e3, 90e3, -80e3]])
    write_frame_bundle(folder, BallFrameNetwork(), ball_facts(shape_sha256), 1e3, positions)
    return folder


def write_ball_bundle(folder: Path, shape_sha256: str = "", export=export_ball_bundle) -> Path:
    """A copy of what `export` makes."""
    key = (export.__name__, shape_sha256)
    return exported_once(folder, key, lambda bundle: export(bundle, shape_sha256))


write_ball_frame_bundle = partial(write_ball_bundle, export=export_ball_frame_bundle)
