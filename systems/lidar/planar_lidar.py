"""`PlanarLidar`: what all lidars share, the ports and the errors of the measured ranges."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.perception import PointCloud

from proxops.systems.common import InputError, SeededSystem
from proxops.systems.lidar.lidar_errors import (
    LidarErrors,
    false_ranges,
    lost_by_chance,
    measured_ranges,
    misaligned,
)
from proxops.systems.lidar.lidar_geometry import LidarGeometry


class TrueReturns(NamedTuple):
    """The K rays of a frame that meet the body."""

    rays: np.ndarray
    """(K,) int: index of the ray, ascending."""
    distances: np.ndarray
    """(K,) float64: distance in m to the surface."""
    grazing: np.ndarray | None = None
    """(K,) bool: whether the ray meets the surface at too flat an angle to return. None: no ray
    does."""


Caster = Callable[[np.ndarray], TrueReturns]
"""Gives the true returns of fixed rays from a position (3,) in m in K, at any range."""


class PlanarLidar(SeededSystem):
    """Planar lidars on a spacecraft whose axes are held to those of the body-fixed frame K.

    A derived class defines `caster`, which says what rays meet the body, and how far away. This
    class adds the ports and the errors that `Lidar` describes.

    Attributes:
      errors: what is wrong with the measured ranges.
      geometry: planes, rays and greatest range.
      directions: (planes * rays, 3) unit vectors, where the rays nominally point. With an attitude
        error they point elsewhere.
    """

    def __init__(self, errors: LidarErrors, geometry: LidarGeometry, period: float, seed: int):
        """Takes the errors, the geometry, the time between steps in s and the default seed.

        Raises:
          InputError: the period is not positive, the seed is negative, or there are false returns
            and the greatest range is infinite.
        """
        super().__init__(period, seed)
        if errors.false_returns > 0.0 and not geometry.max_range < math.inf:
            raise InputError("a lidar with false_returns needs a finite max_range")
        self.errors, self.geometry = errors, geometry
        self.directions = geometry.directions
        # The caster depends on the seed alone. It is kept because making one takes longer than
        # casting one frame.
        self._caster_of = functools.lru_cache(maxsize=2)(self._make_caster)
        self._position_port = self.DeclareVectorInputPort(name="position", size=3)
        depends = {self._position_port.ticket(), *self.seed_tickets()}
        self._ranges_port = self.DeclareVectorOutputPort(
            name="ranges",
            size=geometry.size,
            calc=self._calc_ranges,
            prerequisites_of_calc=depends,
        )
        self._point_cloud_port = self.DeclareAbstractOutputPort(
            name="point_cloud",
            alloc=lambda: AbstractValue.Make(PointCloud(0)),
            calc=self._calc_point_cloud,
            prerequisites_of_calc=depends,
        )

    def caster(self, directions: np.ndarray) -> Caster:
        """Returns a function that casts rays along unit directions (planes * rays, 3) in K."""
        raise NotImplementedError

    def true_returns(self, position: np.ndarray, seed: int | None = None) -> TrueReturns:
        """The rays from a position (3,) in m in K that meet the body, at any range, without noise.

        Args:
          seed: gives the axis of the attitude error, if there is one; None: the default seed.
        """
        turned = self.errors.attitude_error > 0.0
        return self._caster_of((self.seed if seed is None else seed) if turned else 0)(position)

    def _make_caster(self, seed: int) -> Caster:
        angle = self.errors.attitude_error
        return self.caster(misaligned(self.directions, angle, seed) if angle else self.directions)

    def frames(self, times: np.ndarray, positions: np.ndarray, seed: int) -> np.ndarray:
        """The frames (N, planes, rays), float32, that the port `ranges` gives.

        Args:
          times: (N,) in s. positions: (N, 3) in m in K. seed: the seed of the random numbers.
        """
        geometry = self.geometry
        frames = np.empty((len(times), geometry.planes, geometry.rays), dtype=np.float32)
        for k, (now, position) in enumerate(zip(times, positions, strict=True)):
            step = round(now / self.period)
            frames[k] = self._ranges(position, seed, step).reshape(frames.shape[1:])
        return frames

    def _ranges(self, position: np.ndarray, seed: int, step: int) -> np.ndarray:
        """The frame (planes * rays,) in m, float64."""
        errors, max_range = self.errors, self.geometry.max_range
        rays, distances, grazing = self.true_returns(position, seed)
        near = distances <= max_range
        # Noise is drawn for every return in range before any is lost, so that dropout leaves the
        # noise of the others as it is.
        found = measured_ranges(distances[near], errors, seed, step)
        if grazing is not None:
            found[grazing[near]] = np.inf
        if errors.dropout > 0.0:
            found[lost_by_chance(found.size, errors.dropout, seed, step)] = np.inf
        ranges = np.full(self.geometry.size, np.inf)
        ranges[rays[near]] = found
        if errors.false_returns > 0.0:
            false = false_ranges(ranges.size, errors.false_returns, max_range, seed, step)
            ranges = np.minimum(ranges, false)
        return ranges

    def _calc_ranges(self, context, output):
        position = self._position_port.Eval(context)
        output.SetFromVector(self._ranges(position, self.seed_of(context), self.step_of(context)))

    def _calc_point_cloud(self, context, output):
        ranges = self._ranges_port.Eval(context)
        hits = np.isfinite(ranges)
        points = ranges[hits, None] * self.directions[hits]
        cloud = PointCloud(len(points))
        cloud.mutable_xyzs()[:] = points.T
        output.set_value(cloud)
