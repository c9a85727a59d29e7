"""`Lidar`: planar lidars turned about a common axis, ray-cast against the body's mesh."""

from __future__ import annotations

import functools

import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore import EmbreeDevice
from embreex.rtcore_scene import EmbreeScene
from pydrake.common.value import AbstractValue
from pydrake.perception import PointCloud
from pydrake.systems.framework import BasicVector, LeafSystem, NumericParameterIndex

from proxops.systems.counter_noise import generator
from proxops.systems.errors import InputError
from proxops.systems.polyhedron import Polyhedron

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


class RayCaster:
    """Distances along rays to a mesh, by Embree: single precision, 0.02 m at 350 km."""

    def __init__(self, shape: Polyhedron):
        # The robust flag makes rays watertight across the edges of facets.
        self._device = EmbreeDevice()
        self._scene = EmbreeScene(self._device, True)
        vertices = shape.vertices.astype(np.float32)
        self._mesh = TriangleMesh(self._scene, vertices, shape.facets.astype(np.int32))

    def distances(self, origins: np.ndarray, directions: np.ndarray) -> np.ndarray:
        """Distances (N,) in m, float64, from origins (N, 3) along unit directions (N, 3).

        +inf where a ray meets nothing.
        """
        found = self._scene.run(
            np.ascontiguousarray(origins, dtype=np.float32),
            np.ascontiguousarray(directions, dtype=np.float32),
            query="DISTANCE",
        ).astype(np.float64)
        found[found > 1e30] = np.inf  # Embree's "nothing" is 1e37.
        return found


@functools.lru_cache(maxsize=4)
def ray_caster(shape: Polyhedron) -> RayCaster:
    """The ray caster of a mesh, built once for all that cast rays against it."""
    return RayCaster(shape)


class Lidar(LeafSystem):
    """Planar lidars on a spacecraft whose axes are held to those of the body-fixed frame K.

    ```
                  ┌───────┐
    position ────►│ Lidar ├─► ranges (planes * rays), m, plane by plane; +inf: no return
      (3), m, K   │       ├─► point_cloud (abstract PointCloud), m, relative to the
                  └───────┘   spacecraft, in its axes; only rays that returned
    ```

    Ranges carry Gaussian noise, drawn for the rays that returned. It is a pure function of
    (seed, step), the seed a numeric parameter in the Context and the step the number of periods
    since time 0: the same Context gives the same frame, whatever was evaluated before. Outputs
    are computed when they are asked for, then cached.
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
    ):
        """Takes the mesh in K and the sensor's properties.

        Args:
          noise_std: standard deviation of the range noise in m; 0 switches it off.
          max_range: a surface beyond it, in m, returns nothing.
          planes, rays: number of planes, and of rays in each.
          period: time between steps in s, for the noise.
          seed: default of the Context's parameter.

        Raises:
          InputError: a property that no lidar has.
        """
        super().__init__()
        if not (0.0 <= noise_std < np.inf and max_range > 0.0 and 0.0 < period < np.inf):
            raise InputError(
                "a lidar needs noise_std >= 0, max_range > 0 and period > 0, "
                f"got {noise_std}, {max_range}, {period}"
            )
        if seed < 0:
            raise InputError(f"a lidar needs a seed that is not negative, got {seed}")
        if planes < 1 or rays < 1:
            raise InputError(f"a lidar needs planes and rays, got {planes} and {rays}")
        self.noise_std, self.max_range, self.period = noise_std, max_range, period
        self.planes, self.rays, self.seed = planes, rays, seed
        self.directions = ray_directions(planes, rays)
        self._rays32 = self.directions.astype(np.float32)
        self._caster = ray_caster(shape)
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

    def set_seed(self, context, seed: int) -> None:
        """Sets the noise's seed in this system's Context."""
        context.get_mutable_numeric_parameter(self._seed_index).SetAtIndex(0, float(seed))

    def frames(self, times: np.ndarray, positions: np.ndarray, seed: int) -> np.ndarray:
        """Ranges (N, planes, rays), float32, that the output port gives at times and positions.

        Args:
          times: (N,) in s. positions: (N, 3) in m in K. seed: of the noise.
        """
        context = self.CreateDefaultContext()
        self.set_seed(context, seed)
        frames = np.empty((len(times), self.planes, self.rays), dtype=np.float32)
        for k, (now, position) in enumerate(zip(times, positions, strict=True)):
            context.SetTime(now)
            self._position_port.FixValue(context, position)
            frames[k] = self._ranges_port.Eval(context).reshape(self.planes, self.rays)
        return frames

    def _calc_ranges(self, context, output):
        position = self._position_port.Eval(context)
        origins = np.broadcast_to(position.astype(np.float32), self._rays32.shape)
        ranges = self._caster.distances(origins, self._rays32)
        ranges[ranges > self.max_range] = np.inf
        if self.noise_std > 0.0:
            hits = np.flatnonzero(np.isfinite(ranges))
            seed = int(context.get_numeric_parameter(self._seed_index).GetAtIndex(0))
            step = round(context.get_time() / self.period)
            noise = generator(seed, step).standard_normal(hits.size)
            ranges[hits] = np.maximum(ranges[hits] + self.noise_std * noise, 0.0)
        output.SetFromVector(ranges)

    def _calc_point_cloud(self, context, output):
        ranges = self._ranges_port.Eval(context)
        hits = np.isfinite(ranges)
        points = ranges[hits, None] * self.directions[hits]
        cloud = PointCloud(len(points))
        cloud.mutable_xyzs()[:] = points.T
        output.set_value(cloud)
