"""`Beams`: rays with a width, which read the nearest surface in a cone."""

from __future__ import annotations

import math

import numpy as np

from proxops.systems.common import Matrix3, Values, Vector3
from proxops.systems.lidar._beam_kernel import Fan, Mesh, nearest_in_beams
from proxops.systems.lidar.lidar_geometry import LidarGeometry
from proxops.systems.shapes import Polyhedron


class Beams:
    """The rays of a lidar as cones: each reads the surface that is nearest in its cone.

    The nearest point is that of the mesh, in closed form facet by facet, not that of some rays in
    the cone: see `_beam_kernel`. One case is left out: a surface that the axis does not meet
    because another one hides it there, that fills the whole cone, and that is nevertheless the
    nearer one elsewhere in the cone.
    """

    def __init__(self, shape: Polyhedron, geometry: LidarGeometry, width: float):
        """Takes the mesh, the planes and rays, and the full angle of the cones in rad."""
        fan = geometry.directions.reshape(geometry.planes, geometry.rays, 3)
        spread = math.tan(0.5 * geometry.field_of_view)
        self._fan = Fan(fan, 0.5 * float(width), spread)
        ends, beside = shape.edges
        corners = shape.vertices[shape.facets[:, 0]]
        levels = np.einsum("fi,fi->f", shape.normals, corners)
        # The first facet beside an edge runs along it forwards, the second one backwards.
        neighbours = np.empty_like(shape.facets)
        for start, own, other in ((0, 0, 1), (1, 1, 0)):
            corner = np.argmax(shape.facets[beside[:, own]] == ends[:, start, None], axis=1)
            neighbours[beside[:, own], corner] = beside[:, other]
        # Of the same layout as if they were not read-only, so that one compiled kernel serves all.
        self._mesh = Mesh(
            vertices=np.array(shape.vertices, order="C"),
            facets=np.array(shape.facets, order="C"),
            normals=np.array(shape.normals, order="C"),
            neighbours=np.array(neighbours, order="C"),
            levels=levels,
            # Short integers: large meshes are read from memory in every frame.
            ends=np.array(ends, dtype=np.int32),
            beside=np.array(beside, dtype=np.int32),
        )

    def ranges(
        self,
        position: Vector3,
        rotation: Matrix3 | None,
        rays: Values,
        distances: Values,
        facets: Values,
    ) -> np.ndarray:
        """Ranges (planes * rays,) in m, float64; +inf where nothing is in the cone.

        Args:
          position: (3,) in m in K. rotation: R_KS (3, 3), or None for the identity.
          rays, distances, facets: (K,) the rays whose axes meet the mesh, how far away in m, and
            which facet.
        """
        planes, count, _ = self._fan.directions.shape
        ranges = np.full(planes * count, np.inf)
        ranges[rays] = distances
        pose = (
            np.array(position, dtype=np.float64),
            np.array(np.eye(3) if rotation is None else rotation, dtype=np.float64, order="C"),
        )
        nearest_in_beams(pose, self._fan, self._mesh, (rays, facets), ranges)
        return ranges
