"""`Lidar`: planar lidars turned about a common axis, ray-cast against the body's mesh."""

from __future__ import annotations

import math

import numpy as np

from proxops.systems.lidar.lidar_errors import DEFAULT_ERRORS, LidarErrors, too_grazing
from proxops.systems.lidar.lidar_geometry import DEFAULT_GEOMETRY, LidarGeometry
from proxops.systems.lidar.planar_lidar import Caster, PlanarLidar, TrueReturns
from proxops.systems.shapes import Polyhedron, ray_caster


class Lidar(PlanarLidar):
    """Planar lidars on a spacecraft whose axes are held to those of the body-fixed frame K.

    ```
                  ┌───────┐
    position ────►│ Lidar ├─► ranges (planes * rays), m, plane by plane; +inf: no return
      (3), m, K   │       ├─► point_cloud (abstract PointCloud), m, relative to the
                  └───────┘   spacecraft, in its axes; only rays that returned
    ```

    `LidarErrors` says what is wrong with the ranges. All random numbers are a pure function of
    (seed, step): the seed is a numeric parameter in the Context, and the step is the number of
    periods since time 0. So the same Context gives the same frame, whatever was evaluated before.
    Outputs are computed when they are asked for, then cached.
    """

    def __init__(
        self,
        shape: Polyhedron,
        errors: LidarErrors = DEFAULT_ERRORS,
        geometry: LidarGeometry = DEFAULT_GEOMETRY,
        period: float = 10.0,
        seed: int = 0,
    ):
        """Takes the mesh in K and the sensor's properties.

        Args:
          shape: the body's mesh.
          errors: by default range noise of 50 m alone.
          geometry: by default 12 planes of 360 rays, up to 350 km.
          period: time between steps in s.
          seed: default of the Context's parameter.

        Raises:
          InputError: the period is not positive, the seed is negative, or there are false returns
            and the greatest range is infinite.
        """
        super().__init__(errors, geometry, period, seed)
        self._normals = shape.normals
        self._ray_caster = ray_caster(shape)

    def caster(self, directions: np.ndarray) -> Caster:
        """Returns a function that casts rays along unit directions (planes * rays, 3) in K."""
        fan, max_incidence = self._ray_caster.fan(directions), self.errors.max_incidence

        def cast(position: np.ndarray) -> TrueReturns:
            _, rays, distances, facets = fan.hits(position[None])
            grazing = None
            if max_incidence < math.pi / 2.0:
                grazing = too_grazing(self._normals[facets], directions[rays], max_incidence)
            return TrueReturns(rays, distances.astype(np.float64), grazing)

        return cast
