"""`PlanarLidar`: what all lidars share, the ports and the errors of the measured ranges."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from pydrake.common.value import AbstractValue

from proxops.systems.common import Matrix3, SeededSystem, Values, Vector3, Vectors3, rotation_matrix
from proxops.systems.lidar.lidar_errors import (
    LidarErrors,
    TrueReturns,
    check_false_returns,
    received_ranges,
)
from proxops.systems.lidar.lidar_geometry import LidarGeometry

if TYPE_CHECKING:
    from pydrake.perception import PointCloud


def turned(directions: np.ndarray, rotation: np.ndarray | None) -> np.ndarray:
    """Directions (R, 3) in S, turned into K by a matrix R_KS (3, 3); None: the same axes."""
    return directions if rotation is None else directions @ rotation.T


class PlanarLidar(SeededSystem):
    """Planar lidars on a spacecraft that takes its axes S for those of the body-fixed frame K.

    A derived class defines `true_returns`, which says what rays meet the body, and how far away.
    This class adds the ports and the errors that `Lidar` describes.

    Attributes:
      errors: what is wrong with the measured ranges.
      geometry: planes, rays and greatest range.
      directions: (planes * rays, 3) unit vectors in S, along which the rays point.
    """

    def __init__(self, errors: LidarErrors, geometry: LidarGeometry, period: float, seed: int):
        """Takes the errors, the geometry, the time between steps in s and the default seed."""
        super().__init__(period, seed)
        check_false_returns(errors, geometry.max_range)
        self.errors, self.geometry = errors, geometry
        self.directions = geometry.directions
        self._position_port = self.DeclareVectorInputPort("position", 3)
        self._attitude_port = self.DeclareVectorInputPort("attitude", 4)
        depends = {self.all_input_ports_ticket(), *self.seed_tickets()}
        self._ranges_port = self.DeclareVectorOutputPort(
            "ranges", geometry.size, self._calc_ranges, depends
        )
        self.DeclareAbstractOutputPort(
            "point_cloud",
            lambda: AbstractValue.Make(point_cloud(np.zeros(0), np.zeros((0, 3)))),
            self._calc_point_cloud,
            depends,
        )

    def true_returns(self, position: Vector3, rotation: Matrix3 | None = None) -> TrueReturns:
        """The rays that meet the body, at any range, without the errors of ranges.

        Args:
          position: (3,) in m in K.
          rotation: R_KS (3, 3): the rays point along it times `directions`. None: the identity.
        """
        raise NotImplementedError

    def frames(
        self,
        times: Values,
        positions: Vectors3,
        seed: int,
        attitudes: np.ndarray | None = None,
    ) -> np.ndarray:
        """The frames (N, planes, rays), float32, that the port `ranges` gives.

        Args:
          times: (N,) in s. positions: (N, 3) in m in K. seed: the seed of the random numbers.
          attitudes: (N, 4), R_KS as unit quaternions (w, x, y, z); None: as if the port were not
            connected.

        Raises:
          InputError: an attitude is no quaternion, or this lidar knows one attitude only.
        """
        geometry = self.geometry
        frames = np.empty((len(times), geometry.planes, geometry.rays), dtype=np.float32)
        turns = [None] * len(times) if attitudes is None else map(rotation_matrix, attitudes)
        rows = zip(frames, times, positions, turns, strict=True)
        for frame, now, position, rotation in rows:
            step = round(now / self.period)
            frame[:] = self._ranges(position, rotation, seed, step).reshape(frame.shape)
        return frames

    def _ranges(
        self, position: np.ndarray, rotation: np.ndarray | None, seed: int, step: int
    ) -> np.ndarray:
        """The frame (planes * rays,) in m, float64."""
        size, max_range = self.geometry.size, self.geometry.max_range
        returns = self.true_returns(position, rotation)
        return received_ranges(returns, size, max_range, self.errors, seed, step)

    def _calc_ranges(self, context, output):
        position, rotation = self._position_port.Eval(context), None
        if self._attitude_port.HasValue(context):
            rotation = rotation_matrix(self._attitude_port.Eval(context))
        seed, step = self.seed_of(context), self.step_of(context)
        output.SetFromVector(self._ranges(position, rotation, seed, step))

    def _calc_point_cloud(self, context, output):
        ranges = self._ranges_port.Eval(context)
        output.set_value(point_cloud(ranges, self.directions))


def point_cloud(ranges: Values, directions: Vectors3) -> PointCloud:
    """The points in m of the rays that returned, from ranges (R,) and directions (R, 3)."""
    from pydrake.perception import PointCloud  # Slow to import.

    hits = np.isfinite(ranges)
    points = ranges[hits, None] * directions[hits]
    cloud = PointCloud(len(points))
    cloud.mutable_xyzs()[:] = points.T
    return cloud
