"""The lidar's planes in a Meshcat: each a fan that ends where its rays return."""

from __future__ import annotations

import numpy as np
from pydrake.geometry import Rgba
from pydrake.perception import PointCloud

from proxops.diagrams.meshcat.meshcat_scene import Scene, set_mesh
from proxops.systems.lidar import ray_directions

# A ray without a return is drawn for this share of the distance to the body's centre.
_REACH = 0.9
_COLOURS = [(0.25, 0.55, 1.0), (1.0, 0.55, 0.15), (0.35, 0.85, 0.45)]
_FAN_ALPHA = 0.22
_POINT_SIZE = 0.03


def plane_edges(position: np.ndarray, ranges: np.ndarray, plane: int) -> np.ndarray:
    """Where the rays of one plane end (rays, 3), in m in K.

    Args:
      position: (3,) in m in K.
      ranges: (planes, rays) in m; +inf, no return, ends short of the body's distance.
    """
    directions = ray_directions(*ranges.shape).reshape(*ranges.shape, 3)[plane]
    reach = _REACH * float(np.linalg.norm(position))
    lengths = np.where(np.isfinite(ranges[plane]), ranges[plane], reach)
    return position + lengths[:, None] * directions


def add_planes(
    scene: Scene, position: np.ndarray, ranges: np.ndarray, planes: tuple[int, ...]
) -> None:
    """Draws planes as fans and their returns as points, under /lidar/plane_NN.

    Args:
      position: of the spacecraft, (3,) in m in K.
      ranges: (planes, rays) in m, +inf where nothing returned.
      planes: numbers of those to draw.
    """
    rays = np.arange(ranges.shape[1])
    facets = np.stack([np.zeros_like(rays), rays + 1, (rays + 1) % rays.size + 1], axis=1)
    for order, plane in enumerate(planes):
        ends = plane_edges(position, ranges, plane)
        name, colour = f"/lidar/plane_{plane:02d}", _COLOURS[order % len(_COLOURS)]
        points = np.vstack([position[None], ends]) / scene.unit
        set_mesh(scene.meshcat, f"{name}/fan", points, facets, Rgba(*colour, _FAN_ALPHA))
        hits = np.isfinite(ranges[plane])
        cloud = PointCloud(int(hits.sum()))
        cloud.mutable_xyzs()[:] = (ends[hits] / scene.unit).T
        scene.meshcat.SetObject(f"{name}/returns", cloud, _POINT_SIZE, Rgba(*colour))
