"""`Lidar`: planar lidars turned about a common axis, ray-cast against the body's mesh."""

from __future__ import annotations

import math

import numpy as np

from proxops.systems.common import FAR, Vector3, check_type, config, number
from proxops.systems.lidar.beams import Beams
from proxops.systems.lidar.lidar_errors import DEFAULT_ERRORS, LidarErrors, TrueReturns, too_grazing
from proxops.systems.lidar.lidar_geometry import DEFAULT_GEOMETRY, LidarGeometry
from proxops.systems.lidar.planar_lidar import PlanarLidar, turned
from proxops.systems.shapes import Polyhedron, ray_caster


@config
class LidarConfig:
    """The lidar that casts rays against the mesh; see `proxops.systems.Lidar`.

    These are the values on its data sheet. `truth.lidar` says how the true sensor differs.
    """

    # Standard deviation of the range noise; 0 switches the noise off.
    noise_std_m: float = number(50.0, at_least=0.0, at_most=FAR, unit="m")
    # A ray that meets nothing within this distance has the range +inf.
    max_range_m: float = number(350.0e3, at_least=1e-3, at_most=FAR, unit="m")
    # Number of planes, turned by equal angles about a common axis, and of rays in each plane.
    planes: int = number(12, at_least=1, at_most=360)
    rays: int = number(360, at_least=1, at_most=3600)
    # Full angle of a square field of view about S's z, of planes by rays pixels, as a flash lidar
    # has it; 0: planes all around. The policy that reads frames needs them all around.
    field_of_view_deg: float = number(0.0, at_least=0.0, at_most=170.0, unit="degrees")
    # A ray that meets the surface at a greater angle from the normal has no return. With 90, every
    # ray that meets the surface has a return.
    max_incidence_deg: float = number(90.0, at_least=1e-3, at_most=90.0, unit="degrees")


class Lidar(PlanarLidar):
    """Planar lidars on a spacecraft that takes its axes S for those of the body-fixed frame K.

    ```
                  ┌───────┐
    position ────►│ Lidar ├─► ranges (planes * rays), m, plane by plane; +inf: no return
      (3), m, K   │       ├─► point_cloud (abstract PointCloud), m, relative to the
    attitude ────►│       │   spacecraft, in S; only rays that returned
      (4)         └───────┘
    ```

    `attitude` is R_KS as a unit quaternion (w, x, y, z). It may stay unconnected: then the axes of
    S are those of K.

    `LidarErrors` says what is wrong with the ranges. All random numbers are a pure function of
    (seed, step): the seed is a numeric parameter in the Context, and the step is time over period,
    rounded to a whole number. So the same Context gives the same frame, whatever was evaluated
    before, and noise changes in the middle between two steps, where nobody evaluates the frame.
    `set_seed(context, seed)` gives other numbers; Drake's `SetRandomContext` does not.
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
        """
        check_type("Lidar", Polyhedron, shape=shape)
        check_type("Lidar", LidarErrors, errors=errors)
        check_type("Lidar", LidarGeometry, geometry=geometry)
        super().__init__(errors, geometry, period, seed)
        self._normals = shape.normals
        self._fan = ray_caster(shape).fan(self.directions)
        self._beams = Beams(shape, geometry, errors.beam_width) if errors.beam_width > 0.0 else None

    def true_returns(self, position: Vector3, rotation: np.ndarray | None = None) -> TrueReturns:
        """The rays from a position (3,) in m in K that meet the mesh: see `PlanarLidar`."""
        _, rays, distances, facets = self._fan.hits(position[None], rotation)
        grazing, max_incidence = None, self.errors.max_incidence
        if max_incidence < math.pi / 2.0:
            directions = turned(self.directions[rays], rotation)
            grazing = too_grazing(self._normals[facets], directions, max_incidence)
        if self._beams is None:
            return TrueReturns(rays, distances.astype(np.float64), grazing)
        ranges = self._beams.ranges(position, rotation, rays, distances, facets)
        found = np.flatnonzero(ranges < np.inf)
        if grazing is not None:
            of_all = np.zeros(ranges.size, dtype=bool)
            of_all[rays] = grazing
            grazing = of_all[found]
        return TrueReturns(found, ranges[found], grazing)
