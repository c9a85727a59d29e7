"""`LidarWithMoons`: a `Lidar` whose rays also meet the moons of the body."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from proxops.systems.common import Matrix3, Vector3
from proxops.systems.gravity import Moon, moon_axes, moon_position
from proxops.systems.lidar.lidar import Lidar
from proxops.systems.lidar.lidar_errors import (
    DEFAULT_ERRORS,
    LidarErrors,
    TrueReturns,
    received_ranges,
    too_grazing,
)
from proxops.systems.lidar.lidar_geometry import DEFAULT_GEOMETRY, LidarGeometry
from proxops.systems.lidar.planar_lidar import turned
from proxops.systems.rotation import Spin, spin_model
from proxops.systems.shapes import Polyhedron, RayCaster

_ROUNDING = 1e-9


class LidarWithMoons(Lidar):
    """A `Lidar` at a body with moons: a ray reads the nearest surface that it meets.

    ```
    position (3), m, K ──►┌────────────────┐─► ranges (planes * rays), m; +inf: no return
    attitude (4) ────────►│ LidarWithMoons │─► point_cloud (abstract PointCloud)
                          └────────────────┘
    ```

    Ports, errors and random numbers are those of `Lidar`. The moons are where they are at the step
    of the frame, turned as `moon_axes` says. Beams that have a width have none at a moon.
    """

    def __init__(
        self,
        shape: Polyhedron,
        moons: Sequence[Moon],
        spin: Spin,
        errors: LidarErrors = DEFAULT_ERRORS,
        geometry: LidarGeometry = DEFAULT_GEOMETRY,
        period: float = 10.0,
        seed: int = 0,
    ):
        """Takes the moons and how K turns, beside what `Lidar` takes."""
        super().__init__(shape, errors, geometry, period, seed)
        self.moons, self.spin = moons, spin_model(spin)
        self._seen = [
            (RayCaster(moon.shape).fan(self.directions),
             float(np.linalg.norm(moon.shape.vertices, axis=1).max()))
            for moon in moons
        ]  # fmt: skip
        """Of each moon its rays, and the radius in m of the ball that holds it."""

    def returns_at(self, position: Vector3, rotation: Matrix3 | None, time: float) -> TrueReturns:
        """The rays that meet body or moon at a time in s: see `PlanarLidar.true_returns`."""
        body = self.true_returns(position, rotation)
        rotation = np.eye(3) if rotation is None else rotation
        met = []
        for moon, (fan, radius) in zip(self.moons, self._seen, strict=True):
            away = position - moon_position(moon.config, time, self.spin)
            if self._may_meet(away @ rotation, radius):
                met.append((moon, fan, away))
        if not met:
            return body
        distances = np.full(self.geometry.size, np.inf)
        grazing = np.zeros(self.geometry.size, dtype=bool)
        distances[body.rays] = body.distances
        if body.grazing is not None:
            grazing[body.rays] = body.grazing
        for moon, fan, away in met:
            axes = moon_axes(moon.config, time, self.spin)
            turn = axes.T @ rotation
            _, rays, ranges, facets = fan.hits((axes.T @ away)[None], turn)
            nearer = ranges < distances[rays]
            rays = rays[nearer]
            distances[rays] = ranges[nearer]
            normals = moon.shape.normals[facets[nearer]]
            directions = turned(self.directions[rays], turn)
            grazing[rays] = too_grazing(normals, directions, self.errors.max_incidence)
        found = np.flatnonzero(distances < np.inf)
        return TrueReturns(found, distances[found], grazing[found])

    def _may_meet(self, place: Vector3, radius: float) -> bool:
        """Whether a ray within reach may meet a ball, from a place (3,) in m from it, along S."""
        away = math.hypot(*place.tolist())
        if away - radius > self.geometry.max_range:
            return False
        if away <= radius:
            return True
        # The cosine of the half-angle of a cone about the ball.
        least = math.sqrt(1.0 - (radius / away) ** 2)
        return bool((self.directions @ (place / -away)).max() > least - _ROUNDING)

    def _ranges(
        self, position: np.ndarray, rotation: np.ndarray | None, seed: int, step: int
    ) -> np.ndarray:
        returns = self.returns_at(position, rotation, step * self.period)
        size, max_range = self.geometry.size, self.geometry.max_range
        return received_ranges(returns, size, max_range, self.errors, seed, step)
