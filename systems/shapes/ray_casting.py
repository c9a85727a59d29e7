"""Ray casting against a mesh with Embree: single rays, and fans of rays from many positions."""

from __future__ import annotations

import functools
from typing import NamedTuple

import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore import EmbreeDevice
from embreex.rtcore_scene import EmbreeScene

from proxops.systems.common import Matrix3, Values, Vector3, Vectors3
from proxops.systems.shapes._turned_rays import turned_rays
from proxops.systems.shapes.polyhedron import Polyhedron
from proxops.systems.shapes.surface import Surface

# Rays in a batch: enough to hide Python's overhead, few enough to stay in the processor's cache.
_BLOCK = 2**17
# Margins of the ellipsoid that selects the rays to cast, and of its cone of tangents. They are far
# greater than the errors of single precision.
_INFLATION = 1e-3
_COSINE_MARGIN = 1e-5
# The least semi-axis of that ellipsoid, over the greatest.
_FLATTEST = 1e-3
_UNTURNED = np.eye(3)


class Hits(NamedTuple):
    """The K rays of a fan that meet the mesh, position by position, ray by ray."""

    places: Values
    """(K,) int: index of the ray's position, ascending."""
    rays: Values
    """(K,) int: index of the ray's direction, ascending within a position."""
    distances: Values
    """(K,) float32: distance in m to the nearest facet."""
    facets: Values
    """(K,) int32: index of that facet."""


class FirstHits(NamedTuple):
    """What N rays meet."""

    distances: Values
    """(N,) float64 in m; of no meaning where a ray meets nothing."""
    facets: Values
    """(N,) int32: index of the facet; -1 where a ray meets nothing."""
    places: np.ndarray
    """(N, 2) float32: weights of the facet's second and third vertex at the point met."""


class RayCaster:
    """Casts rays against a mesh, in the mesh's frame, in single precision.

    A range of 350 km is rounded to about 0.02 m; on a ray that grazes the surface the error is
    greater by one over the cosine of the incidence. Coordinates are rounded in the mesh's frame, so
    keep its origin near the mesh.
    """

    def __init__(self, shape: Surface):
        """Takes the mesh, whose vertices are in m."""
        self.shape = shape
        self._device = EmbreeDevice()
        # The robust flag makes rays watertight across the edges of facets.
        self.scene = EmbreeScene(self._device, True)
        vertices = shape.vertices.astype(np.float32)
        self._mesh = TriangleMesh(self.scene, vertices, shape.facets.astype(np.int32))

    def distances(self, origins: Vectors3, directions: Vectors3) -> np.ndarray:
        """Distances (N,) in m, float64, from origins (N, 3) along unit directions (N, 3).

        +inf where a ray meets nothing.
        """
        found = self.scene.run(
            np.ascontiguousarray(origins, dtype=np.float32),
            np.ascontiguousarray(directions, dtype=np.float32),
            query="DISTANCE",
        ).astype(np.float64)
        found[found > 1e30] = np.inf  # Embree's "nothing" is 1e37.
        return found

    def first_hits(self, position: Vector3, directions: Vectors3) -> FirstHits:
        """What rays from a position (3,), or one each (N, 3), in m, meet first.

        They point along unit directions (N, 3).
        """
        origins = np.empty((len(directions), 3), dtype=np.float32)
        origins[:] = position
        found = self.scene.run(
            origins, np.ascontiguousarray(directions, dtype=np.float32), output=True
        )
        places = np.empty((len(origins), 2), dtype=np.float32)
        places[:, 0], places[:, 1] = found["u"], found["v"]
        return FirstHits(found["tfar"].astype(np.float64), found["primID"], places)

    def fan(self, directions: Vectors3) -> RayFan:
        """A fan of rays along unit directions (R, 3), to cast from many positions."""
        return RayFan(self, directions)


class RayFan:
    """Rays in fixed directions, cast from any position, and turned as a whole if need be.

    From outside, most rays point away from the body. Only rays that meet an ellipsoid around the
    mesh are cast: in coordinates that make it the unit ball, a ray from q along the unit vector e
    meets it if -q·e is at least √(q² - 1), the length of a tangent from q.

    It runs on one thread, because Embree's Python binding holds the interpreter's lock.
    """

    def __init__(self, caster: RayCaster, directions: np.ndarray):
        """Takes the mesh's caster and unit directions (R, 3) in its frame."""
        assert np.ndim(directions) == 2
        self._scene = caster.scene
        self._directions = np.array(directions, dtype=np.float64)
        vertices = caster.shape.vertices
        self._centre = 0.5 * (vertices.min(axis=0) + vertices.max(axis=0))
        # Terrain may be flat.
        axes = 0.5 * np.maximum(caster.shape.extents, _FLATTEST * caster.shape.extents.max())
        reach = np.linalg.norm((vertices - self._centre) / axes, axis=1).max()
        self._axes = axes * reach * (1.0 + _INFLATION)

    def hits(self, positions: Vectors3, rotation: Matrix3 | None = None) -> Hits:
        """The hits of the rays from positions (N, 3) in m; the memory needed grows with N R.

        Args:
          positions: where the rays begin, in the mesh's frame.
          rotation: a matrix (3, 3): every ray points along it times its direction. None: along its
            direction.
        """
        rotation = _UNTURNED if rotation is None else rotation
        places, rays, origins, directions = turned_rays(
            positions, self._centre, self._axes, _COSINE_MARGIN, rotation, self._directions
        )
        found = self._scene.run(origins, directions, output=True)
        met = np.flatnonzero(found["primID"] >= 0)
        return Hits(places[met], rays[met], found["tfar"][met], found["primID"][met])

    def frames(self, positions: Vectors3) -> np.ndarray:
        """Distances (N, R) in m, float32, from positions (N, 3) in m along the rays.

        +inf where a ray meets nothing. The result is that of `RayCaster.distances`, ray by ray, but
        three times as fast from far away. Besides the result it needs a few MB for any N.
        """
        positions = np.asarray(positions, dtype=np.float64)
        assert positions.ndim == 2
        frames = np.full((len(positions), len(self._directions)), np.inf, dtype=np.float32)
        block = max(1, _BLOCK // max(1, len(self._directions)))
        for start in range(0, len(positions), block):
            hits = self.hits(positions[start : start + block])
            frames[start + hits.places, hits.rays] = hits.distances
        return frames


@functools.lru_cache(maxsize=4)
def ray_caster(shape: Polyhedron) -> RayCaster:
    """The ray caster of a mesh; a process keeps those of the last four."""
    return RayCaster(shape)
