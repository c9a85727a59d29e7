"""Examples for the lidar's networks: noiseless frames on a grid of positions.

Noise belongs to the sensor, not to the body. It is added in flight, as are dropout and false
returns, so one network serves every sensor.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from proxops.diagrams.scenario import Body
from proxops.systems.common import InputError
from proxops.systems.lidar import ChordFan
from proxops.systems.shapes import RayFan, smallest_ellipsoid
from proxops.training.lidar.networks import NO_RETURN

LENGTH_UNITS_PER_CUBE = 340.0
"""Edge of the cube in the unit of length of the paper's network: km, for the paper's 340 km."""
# The ellipsoid that cuts rays to chords is this share larger than the smallest one around all
# returns.
_MARGIN = 0.02
# A ray is near the silhouette if, within this many rays of its plane, another ray returns and it
# does not, or the reverse.
_SILHOUETTE_REACH = 2
# Number of positions whose chords are computed together.
_BLOCK = 64
# A depth error as long as the ellipsoid's mean semi-axis weighs as much as this many nats.
_LENGTH_WEIGHT = 8.0
_FEWEST_POSITIONS = 64
# Their frames take some 9 GB.
_MOST_POSITIONS = 500_000


def grid_positions(body: Body, cube: float, spacing: float) -> np.ndarray:
    """Positions (N, 3) in m in K on a cubic grid about the origin, outside the body.

    Args:
      cube: edge in m that the grid fills. spacing: in m between neighbours.

    Raises:
      InputError: the spacing is not from 0 to the cube's edge, or the grid has more positions than
        memory holds frames of, or too few outside the body to learn from.
    """
    if not 0.0 < spacing <= cube:
        raise InputError(
            f"the spacing must be above 0 and at most the cube's {cube / 1e3:g} km, got "
            f"{spacing / 1e3:g} km"
        )
    if (cube / spacing + 1.0) ** 3 > _MOST_POSITIONS:
        least = cube / (_MOST_POSITIONS ** (1.0 / 3.0) - 1.0)
        raise InputError(
            f"a spacing of {spacing / 1e3:g} km makes too many positions in the cube of "
            f"{cube / 1e3:g} km: give at least {least / 1e3:.3g} km"
        )
    steps = int(cube / spacing * (1.0 + 1e-12))
    line = spacing * (np.arange(steps + 1) - 0.5 * steps)
    grid = np.stack(np.meshgrid(line, line, line, indexing="ij"), axis=-1).reshape(-1, 3)
    grid = outside(body, grid)
    if len(grid) < _FEWEST_POSITIONS:
        raise InputError(
            f"a spacing of {spacing:g} m leaves {len(grid)} positions in the cube of {cube:g} m; "
            f"the networks need {_FEWEST_POSITIONS}"
        )
    return grid


def random_positions(body: Body, cube: float, count: int, seed: int) -> np.ndarray:
    """Positions (count, 3) in m, uniform in the cube outside the body."""
    generator = np.random.default_rng(seed)
    found = np.empty((0, 3))
    while len(found) < count:
        drawn = generator.uniform(-0.5 * cube, 0.5 * cube, (count, 3))
        found = np.concatenate([found, outside(body, drawn)])
    return found[:count]


def outside(body: Body, positions: np.ndarray) -> np.ndarray:
    """The positions of (N, 3) that are outside the body."""
    return positions[~body.gravity_field.evaluate(positions).inside]


def near_silhouette(frames: np.ndarray, planes: int) -> np.ndarray:
    """Marks the rays of frames (N, R) in m that are near the body's outline: (N, R) bool."""
    hits = np.isfinite(frames).reshape(len(frames), planes, -1)
    near = np.zeros_like(hits)
    for shift in range(1, _SILHOUETTE_REACH + 1):
        near |= (hits != np.roll(hits, shift, axis=2)) | (hits != np.roll(hits, -shift, axis=2))
    return near.reshape(frames.shape)


def enclosing_ellipsoid(
    positions: np.ndarray, frames: np.ndarray, directions: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Centre (3,) and semi-axes (3,) in m of an ellipsoid that holds all that the frames saw.

    Found from the returns alone: the networks learn from frames, not from the mesh.
    """
    places, rays = np.nonzero(np.isfinite(frames))
    if places.size == 0:
        raise InputError("no ray of any frame meets the body: make the spacing finer")
    points = positions[places] + frames[places, rays, None] * directions[rays]
    centre = 0.5 * (points.min(axis=0) + points.max(axis=0))
    return centre, smallest_ellipsoid(points - centre, _MARGIN).semi_axes


@dataclass(frozen=True)
class GridFrames:
    """Noiseless frames on the grid, and which positions are for validation."""

    positions: np.ndarray
    """(N, 3) in m in K."""
    frames: np.ndarray
    """(N, R) float32 in m, +inf where nothing returns."""
    held_out: np.ndarray
    """(N,) bool: for validation, not for training."""


def cast_grid(body: Body, fan: RayFan, cube: float, spacing: float, seed: int) -> GridFrames:
    """Casts the frames on the grid, and draws one position in twenty for validation."""
    positions = grid_positions(body, cube, spacing)
    held_out = np.zeros(len(positions), dtype=bool)
    held_out[np.random.default_rng(seed).permutation(len(positions))[: len(positions) // 20]] = True
    return GridFrames(positions, fan.frames(positions), held_out)


def ray_examples(
    fan: ChordFan, positions: np.ndarray, frames: np.ndarray, planes: int
) -> tuple[tuple[Tensor, Tensor, Tensor, Tensor], Tensor]:
    """The arguments of `ray_loss` for all chords, and which of them are near a silhouette (K,).

    Args:
      positions: (N, 3) in m. frames: (N, R) in m, without noise.
    """
    unit = np.cbrt(fan.semi_axes.prod()) / _LENGTH_WEIGHT
    parts = []
    for start in range(0, len(positions), _BLOCK):
        block = frames[start : start + _BLOCK]
        chords = fan.chords(positions[start : start + _BLOCK])
        ranges = block[chords.places, chords.rays].astype(np.float64)
        hit = np.isfinite(ranges)
        depth = np.where(hit, (ranges - chords.starts) / chords.lengths, 0.0)
        near = near_silhouette(block, planes)[chords.places, chords.rays]
        parts.append((chords.ends, hit, depth, chords.lengths / unit, near))
    ends, hit, depth, length, near = map(np.concatenate, zip(*parts, strict=True))
    numbers = [torch.from_numpy(column.astype(np.float32)) for column in (ends, hit, depth, length)]
    return (numbers[0], numbers[1], numbers[2], numbers[3]), torch.from_numpy(near)


def frame_examples(positions: np.ndarray, frames: np.ndarray, cube: float) -> tuple[Tensor, Tensor]:
    """The arguments of `frame_loss`: the paper's positions and frames, −100 for no return."""
    ranges = frames * np.float32(LENGTH_UNITS_PER_CUBE / cube)
    ranges[~np.isfinite(ranges)] = NO_RETURN
    return torch.from_numpy((positions / (0.5 * cube)).astype(np.float32)), torch.from_numpy(ranges)
