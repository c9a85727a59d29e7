"""Draws the lidar's planes in a Meshcat, each as a fan that ends at its returns."""

from __future__ import annotations

import numpy as np
from pydrake.geometry import Rgba

from proxops.diagrams.meshcat.meshcat_scene import Scene, add_points, set_mesh
from proxops.systems.common import Vector3
from proxops.systems.lidar import ray_directions

# A ray without a return is drawn for this share of the distance to the body's centre.
_REACH = 0.9
_COLOURS = [(0.25, 0.55, 1.0), (1.0, 0.55, 0.15), (0.35, 0.85, 0.45)]
_FAN_ALPHA = 0.22
_POINT_SIZE = 0.03


def plane_edges(position: Vector3, ranges: np.ndarray, plane: int) -> np.ndarray:
    """Computes the ends of the rays of one plane, (rays, 3) in m in K.

    Args:
      position: position (3,) of the spacecraft in K, in m.
      ranges: (planes, rays) in m; a ray without a return (+inf) ends before the body's distance.
      plane: number of the plane.
    """
    directions = ray_directions(*ranges.shape).reshape(*ranges.shape, 3)[plane]
    reach = _REACH * float(np.linalg.norm(position))
    lengths = np.where(np.isfinite(ranges[plane]), ranges[plane], reach)
    return position + lengths[:, None] * directions


def add_planes(
    scene: Scene, position: Vector3, ranges: np.ndarray, planes: tuple[int, ...]
) -> None:
    """Draws planes as fans and their returns as points, under /lidar/plane_NN.

    Args:
      scene: the scene.
      position: position (3,) of the spacecraft in K, in m.
      ranges: (planes, rays) in m; +inf for a ray without a return.
      planes: numbers of the planes to draw.
    """
    rays = np.arange(ranges.shape[1])
    facets = np.stack([np.zeros_like(rays), rays + 1, (rays + 1) % rays.size + 1], axis=1)
    for order, plane in enumerate(planes):
        ends = plane_edges(position, ranges, plane)
        name, colour = f"/lidar/plane_{plane:02d}", _COLOURS[order % len(_COLOURS)]
        points = np.vstack([position[None], ends]) / scene.unit
        set_mesh(scene.meshcat, f"{name}/fan", points, facets, Rgba(*colour, _FAN_ALPHA))
        hits = np.isfinite(ranges[plane])
        add_points(scene, f"{name}/returns", ends[hits], Rgba(*colour), _POINT_SIZE)
