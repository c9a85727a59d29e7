"""`Lidar`: planar lidars turned about a common axis, ray-cast against the body's mesh."""

from __future__ import annotations

import math

import numpy as np

from proxops.systems.lidar.lidar_errors import LidarErrors, too_grazing
from proxops.systems.lidar.planar_lidar import (
    PLANES,
    RAYS,
    Caster,
    PlanarLidar,
    TrueReturns,
    ray_directions,
)
from proxops.systems.shapes import Polyhedron, ray_caster

__all__ = ["PLANES", "RAYS", "Lidar", "ray_directions"]


class Lidar(PlanarLidar):
    """Planar lidars on a spacecraft whose axes are held to those of the body-fixed frame K.

    ```
                  ┌───────┐
    position ────►│ Lidar ├─► ranges (planes * rays), m, plane by plane; +inf: no return
      (3), m, K   │       ├─► point_cloud (abstract PointCloud), m, relative to the
                  └───────┘   spacecraft, in its axes; only rays that returned
    ```

    Ranges carry Gaussian noise, bias and scale error; returns are lost at grazing incidence and by
    chance; rays are answered falsely by chance; all rays may be turned a little from where they are
    taken to point: see `lidar_errors`. What is random is a pure
    function of (seed, step), the seed a numeric parameter in the Context and the step the number
    of periods since time 0: the same Context gives the same frame, whatever was evaluated before.
    Outputs are computed when they are asked for, then cached.
    """

    def __init__(
        self,
        shape: Polyhedron,
        noise_std: float = 50.0,
        max_range: float = 350e3,
        planes: int = PLANES,
        rays: int = RAYS,
        period: float = 10.0,
        seed: int = 0,
        *,
        bias: float = 0.0,
        scale_error: float = 0.0,
        max_incidence: float = math.pi / 2.0,
        dropout: float = 0.0,
        false_returns: float = 0.0,
        attitude_error: float = 0.0,
    ):
        """Takes the mesh in K and the sensor's properties.

        Args:
          noise_std: standard deviation of the range noise in m; 0 switches it off.
          max_range: a surface beyond it, in m, returns nothing.
          planes, rays: number of planes, and of rays in each.
          period: time between steps in s, for all that is random.
          seed: default of the Context's parameter.
          bias: added to every range, in m.
          scale_error: ranges are 1 + this times as long.
          max_incidence: a surface met at a greater angle from its normal, in rad, returns nothing.
          dropout: chance that a return is lost.
          false_returns: chance that a ray is answered from a random range, up to `max_range`.
          attitude_error: angle in rad by which the rays are turned from their nominal directions,
            about an axis drawn from the seed.

        Raises:
          InputError: a property that no lidar has.
        """
        errors = LidarErrors(
            noise_std, bias, scale_error, max_incidence, dropout, false_returns, attitude_error
        )
        super().__init__(errors, max_range, planes, rays, period, seed)
        self._normals = shape.normals
        self._rays = ray_caster(shape)

    def caster(self, directions: np.ndarray) -> Caster:
        """Casts rays along unit directions (planes * rays, 3) in K against the mesh."""
        fan = self._rays.fan(directions)

        def cast(position: np.ndarray) -> TrueReturns:
            _, rays, distances, facets = fan.hits(position[None])
            grazing = None
            if self.errors.max_incidence < math.pi / 2.0:
                normals = self._normals[facets]
                grazing = too_grazing(normals, directions[rays], self.errors.max_incidence)
            return TrueReturns(rays, distances.astype(np.float64), grazing)

        return cast
