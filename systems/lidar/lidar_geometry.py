"""`LidarGeometry`: the planes and rays of a lidar, and how far it sees."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from proxops.systems.common import InputError

_MOST_RAYS = 1_000_000


@dataclass(frozen=True)
class LidarGeometry:
    """Where the rays of a lidar point, and how far they reach."""

    planes: int = 12
    rays: int = 360
    """Number of rays in each plane."""
    max_range: float = 350e3
    """A surface beyond this distance, in m, returns nothing; inf: every surface returns."""
    field_of_view: float = 0.0
    """Full angle in rad of a square field about z, as of a flash lidar; 0: all around."""

    def __post_init__(self) -> None:
        """Raises `InputError` for a geometry that no lidar has."""
        if not (self.planes >= 1 and self.rays >= 1 and self.size <= _MOST_RAYS):
            raise InputError(
                "a lidar needs at least 1 plane and 1 ray, and at most a million rays in all, got "
                f"{self.planes} planes of {self.rays} rays"
            )
        if not 0.0 <= self.field_of_view < math.pi:
            raise InputError(
                f"a lidar needs a field of view from 0 to below pi, got {self.field_of_view} rad"
            )
        if not self.max_range > 0.0:
            raise InputError(f"a lidar needs max_range above 0, got {self.max_range} m")

    @property
    def size(self) -> int:
        """Number of rays in all planes."""
        return self.planes * self.rays

    @property
    def directions(self) -> np.ndarray:
        """The rays' unit vectors (planes * rays, 3) in the spacecraft's axes."""
        if self.field_of_view > 0.0:
            return flash_directions(self.planes, self.rays, self.field_of_view)
        return ray_directions(self.planes, self.rays)


DEFAULT_GEOMETRY = LidarGeometry()


def ray_directions(
    planes: int = DEFAULT_GEOMETRY.planes, rays: int = DEFAULT_GEOMETRY.rays
) -> np.ndarray:
    """Unit vectors (planes * rays, 3), plane by plane, in the spacecraft's axes S.

    Ray (i, j) points along cos b (cos a, sin a, 0) + sin b z with a = i 180°/planes and
    b = j 360°/rays.
    """
    a = np.pi / planes * np.arange(planes)[:, None]
    b = 2.0 * np.pi / rays * np.arange(rays)[None, :]
    xyz = np.cos(b) * np.cos(a), np.cos(b) * np.sin(a), np.broadcast_to(np.sin(b), (planes, rays))
    return np.stack(xyz, axis=-1).reshape(-1, 3)


def flash_directions(planes: int, rays: int, field_of_view: float) -> np.ndarray:
    """Unit vectors (planes * rays, 3), plane by plane, in S: of a flash lidar that looks along z.

    Pixel (i, j) is that of a flat detector behind a pinhole: it looks along (x_i, y_j, 1), with x
    and y evenly from -tan(f/2) to tan(f/2).

    Args:
      planes, rays: numbers of pixels along x and y. field_of_view: f in rad, full angle.
    """
    half = math.tan(0.5 * field_of_view)
    x, y = (half * (2.0 * np.arange(n) + 1.0 - n) / n for n in (planes, rays))
    pixels = np.stack([*np.meshgrid(x, y, indexing="ij"), np.ones((planes, rays))], axis=-1)
    return (pixels / np.linalg.norm(pixels, axis=-1, keepdims=True)).reshape(-1, 3)
