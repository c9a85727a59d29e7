"""What every lidar here shares: planes of rays, ports, and noise over the true returns."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.perception import PointCloud
from pydrake.systems.framework import BasicVector, LeafSystem, NumericParameterIndex

from proxops.systems.common import InputError
from proxops.systems.lidar.lidar_errors import (
    LidarErrors,
    false_ranges,
    lost_by_chance,
    measured_ranges,
    misaligned,
)

PLANES = 12
RAYS = 360


def ray_directions(planes: int = PLANES, rays: int = RAYS) -> np.ndarray:
    """Unit vectors (planes * rays, 3), plane by plane, in the spacecraft's axes (those of K).

    Ray (i, j) points along cos b (cos a, sin a, 0) + sin b z with a = i 180°/planes and
    b = j 360°/rays.
    """
    a = np.pi / planes * np.arange(planes)[:, None]
    b = 2.0 * np.pi / rays * np.arange(rays)[None, :]
    xyz = np.cos(b) * np.cos(a), np.cos(b) * np.sin(a), np.broadcast_to(np.sin(b), (planes, rays))
    return np.stack(xyz, axis=-1).reshape(-1, 3)


class TrueReturns(NamedTuple):
    """The K rays of a frame that meet the body."""

    rays: np.ndarray
    """(K,) int: index of the ray, ascending."""
    distances: np.ndarray
    """(K,) float64: distance in m to the surface."""
    grazing: np.ndarray | None = None
    """(K,) bool: met too flatly to return anything. None: no ray is."""


Caster = Callable[[np.ndarray], TrueReturns]
"""What a fan of rays meets from a position (3,) in m in K, without errors, at any range."""


class PlanarLidar(LeafSystem):
    """Planar lidars on a spacecraft whose axes are held to those of the body-fixed frame K.

    A kind of lidar says in `caster` which rays meet the body, and how far away; this class gives it
    the ports and the errors that `Lidar` describes.
    """

    def __init__(
        self,
        errors: LidarErrors,
        max_range: float,
        planes: int,
        rays: int,
        period: float,
        seed: int,
    ):
        """Takes what `Lidar` takes, the errors as one.

        Raises:
          InputError: a property that no lidar has.
        """
        super().__init__()
        if not (max_range > 0.0 and 0.0 < period < math.inf):
            raise InputError(
                f"a lidar needs max_range > 0 and period > 0, got {max_range}, {period}"
            )
        if seed < 0:
            raise InputError(f"a lidar needs a seed that is not negative, got {seed}")
        if planes < 1 or rays < 1:
            raise InputError(f"a lidar needs planes and rays, got {planes} and {rays}")
        if errors.false_returns > 0.0 and not max_range < math.inf:
            raise InputError("a lidar needs a finite max_range for false_returns")
        self.errors = errors
        self.max_range, self.period = max_range, period
        self.planes, self.rays, self.seed = planes, rays, seed
        self.directions = ray_directions(planes, rays)
        """Where the rays are taken to point; with an attitude error they don't."""
        # A pure function of the seed, kept because a fan takes longer to make than to cast.
        self._caster_of = functools.lru_cache(maxsize=2)(self._make_caster)
        self._seed_index = self.DeclareNumericParameter(BasicVector([float(seed)]))
        self._position_port = self.DeclareVectorInputPort(name="position", size=3)
        seeded = self.numeric_parameter_ticket(NumericParameterIndex(self._seed_index))
        self._ranges_port = self.DeclareVectorOutputPort(
            name="ranges",
            size=planes * rays,
            calc=self._calc_ranges,
            prerequisites_of_calc={self._position_port.ticket(), self.time_ticket(), seeded},
        )
        self._point_cloud_port = self.DeclareAbstractOutputPort(
            name="point_cloud",
            alloc=lambda: AbstractValue.Make(PointCloud(0)),
            calc=self._calc_point_cloud,
            prerequisites_of_calc={self._position_port.ticket(), self.time_ticket(), seeded},
        )

    def caster(self, directions: np.ndarray) -> Caster:
        """What casts rays along unit directions (planes * rays, 3) in K."""
        raise NotImplementedError

    def true_returns(self, position: np.ndarray, seed: int | None = None) -> TrueReturns:
        """What the rays from a position (3,) in m in K meet, at any range and without noise.

        Args:
          seed: of the misalignment, if there is one; None: the default one.
        """
        turned = self.errors.attitude_error > 0.0
        return self._caster_of((self.seed if seed is None else seed) if turned else 0)(position)

    def _make_caster(self, seed: int) -> Caster:
        angle = self.errors.attitude_error
        return self.caster(misaligned(self.directions, angle, seed) if angle else self.directions)

    def set_seed(self, context, seed: int) -> None:
        """Sets the noise's seed in this system's Context."""
        context.get_mutable_numeric_parameter(self._seed_index).SetAtIndex(0, float(seed))

    def frames(self, times: np.ndarray, positions: np.ndarray, seed: int) -> np.ndarray:
        """Ranges (N, planes, rays), float32, that the output port gives at times and positions.

        Args:
          times: (N,) in s. positions: (N, 3) in m in K. seed: of the noise.
        """
        frames = np.empty((len(times), self.planes, self.rays), dtype=np.float32)
        for k, (now, position) in enumerate(zip(times, positions, strict=True)):
            step = round(now / self.period)
            frames[k] = self._ranges(position, seed, step).reshape(self.planes, self.rays)
        return frames

    def _ranges(self, position: np.ndarray, seed: int, step: int) -> np.ndarray:
        """The frame (planes * rays,) in m, float64."""
        errors = self.errors
        rays, distances, grazing = self.true_returns(position, seed)
        near = distances <= self.max_range
        # Drawn for all that is in range, before any is lost: dropout leaves the noise as it is.
        found = measured_ranges(distances[near], errors, seed, step)
        if grazing is not None:
            found[grazing[near]] = np.inf
        if errors.dropout > 0.0:
            found[lost_by_chance(found.size, errors.dropout, seed, step)] = np.inf
        ranges = np.full(self.planes * self.rays, np.inf)
        ranges[rays[near]] = found
        if errors.false_returns > 0.0:
            false = false_ranges(ranges.size, errors.false_returns, self.max_range, seed, step)
            ranges = np.minimum(ranges, false)
        return ranges

    def _calc_ranges(self, context, output):
        position = self._position_port.Eval(context)
        seed = int(context.get_numeric_parameter(self._seed_index).GetAtIndex(0))
        step = round(context.get_time() / self.period)
        output.SetFromVector(self._ranges(position, seed, step))

    def _calc_point_cloud(self, context, output):
        ranges = self._ranges_port.Eval(context)
        hits = np.isfinite(ranges)
        points = ranges[hits, None] * self.directions[hits]
        cloud = PointCloud(len(points))
        cloud.mutable_xyzs()[:] = points.T
        output.set_value(cloud)
