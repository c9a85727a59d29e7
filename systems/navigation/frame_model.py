"""`FrameModel`: what frame of ranges the map predicts, and what a measured frame says."""

from __future__ import annotations

import copy
from functools import cached_property

import numpy as np

from proxops.systems.common import Matrix3
from proxops.systems.lidar import LidarGeometry
from proxops.systems.navigation._frame_kernel import (
    Comparison,
    RangeErrors,
    Surface,
    raised_origins,
    returned_rays,
    rows_of_frame,
)
from proxops.systems.navigation.estimate import BASE, MEASURED, SIZE, Estimate
from proxops.systems.navigation.map_error import MapError
from proxops.systems.navigation.relief import PATTERNS, relief_rows
from proxops.systems.shapes import Polyhedron, RayFan, ray_caster


class FrameModel:
    """Predicts frames from the map by ray casting, and their derivatives in closed form."""

    def __init__(
        self,
        shape: Polyhedron,
        geometry: LidarGeometry,
        noise_std: float,
        map_error: MapError,
        half_beam: float = 0.0,
    ):
        """Takes the map, the lidar's geometry and range noise in m, and what may be wrong.

        Args:
          shape: the map. geometry: of the lidar. noise_std: of its ranges, in m.
          map_error: of the map. half_beam: half of the angle in rad that the beams may have.
        """
        self.shape, self.geometry, self.noise_std = shape, geometry, noise_std
        self.directions = geometry.directions
        self.map_error = map_error
        rest = map_error.relief**2 or map_error.rest
        self._range_errors = RangeErrors(float(noise_std), float(rest), float(half_beam))
        self._farthest = geometry.max_range * 1.001
        self.normals = shape.normals
        self._surface = Surface(shape.normals, np.array(shape.facets), map_error.table)
        self.centres = shape.vertices[shape.facets].mean(axis=1)
        self.first_hits, self.distances = ray_caster(shape).first_hits, ray_caster(shape).distances
        # Where the measured quantities are in an estimate.
        self.columns = np.concatenate([MEASURED, BASE + np.arange(map_error.coefficients)])

    @cached_property
    def fan(self) -> RayFan:
        """The rays, for the search of an acquisition."""
        return ray_caster(self.shape).fan(self.directions)

    def turned(self, axes: Matrix3) -> FrameModel:
        """The model of a frame that was measured with the lidar turned by a rotation (3, 3)."""
        model = copy.copy(self)
        model.directions = self.directions @ axes.T
        vars(model).pop("fan", None)
        return model

    def compared(self, estimate: Estimate, ranges: np.ndarray) -> Comparison:
        """A frame (planes * rays,), in m, +inf for no return, beside the predicted one."""
        # A larger body seen from a place is the map seen from nearer, all lengths in proportion.
        mean, rough = estimate.mean, BASE + self.map_error.modes
        larger, position = 1.0 + mean[SIZE], mean[:3]
        rays = returned_rays(ranges, self._farthest, estimate.rotation, self.directions)
        hits = self.first_hits(position / larger, rays.directions)
        heights = np.zeros(rays.indices.size)
        if self.map_error.modes:
            # Where the surface lies farther out, it is the map seen from so much nearer.
            rays, origins, heights = raised_origins(
                position / larger, rays, hits, self._surface, mean[BASE:rough] / larger
            )
            hits = self.first_hits(origins, rays.directions)
        hits = hits._replace(distances=larger * hits.distances)
        compared = rows_of_frame(
            position,
            rays,
            hits,
            larger * heights,
            ranges,
            self._surface,
            (mean[SIZE:], self._range_errors),
        )
        if not self.map_error.relief:
            return compared
        met = hits.facets >= 0
        points = hits.distances[met, None] * rays.directions[met]
        return self._with_relief(compared, points, mean[rough:])

    def _with_relief(
        self, compared: Comparison, points: np.ndarray, mean: np.ndarray
    ) -> Comparison:
        """A `Comparison` of K rays that meet points (K, 3), with coefficients (P,) of relief."""
        rows, residuals, variances = compared.rows, compared.residuals, compared.variances
        like = rows[:, :PATTERNS]  # Of position and attitude.
        found, usable = np.zeros_like(like), np.flatnonzero(variances < np.inf)
        if usable.size:
            std, correlation = self.map_error.relief, self.map_error.relief_correlation
            found[usable], anew = relief_rows(like[usable], points[usable], std, correlation)
            residuals, variances = residuals - found @ mean, variances + anew
        return Comparison(compared.rays, residuals, variances, np.hstack([rows, found]))
