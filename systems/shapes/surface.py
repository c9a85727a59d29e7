"""`Surface`: triangles that need not close, for instance terrain."""

from __future__ import annotations

import typing
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from proxops.systems.common import InputError, Vector3, Vectors3
from proxops.systems.shapes.mesh_checks import area_vectors
from proxops.systems.shapes.shape_files import metres_per

if typing.TYPE_CHECKING:
    import trimesh


class Surface:
    """Triangles that rays can be cast at: vertices (V, 3) in metres and facets (F, 3).

    Unlike a `Polyhedron`, it need not enclose anything. A facet is met from both sides.
    """

    def __init__(self, vertices: ArrayLike, facets: ArrayLike, name: str = "mesh"):
        """Takes vertices (V, 3) in metres and facets (F, 3) of indices into them."""
        self.vertices = np.array(vertices, dtype=np.float64)
        self.facets = np.array(facets, dtype=np.int64)
        self.name = name
        for what, array in (("vertices", self.vertices), ("facets", self.facets)):
            if array.ndim != 2 or array.shape[1] != 3 or len(array) == 0:
                raise InputError(f"{name}: {what} must have shape (N, 3), got {array.shape}")
        if not np.isfinite(self.vertices).all():
            raise InputError(f"{name}: a vertex is not finite")
        if self.facets.min() < 0 or self.facets.max() >= len(self.vertices):
            raise InputError(
                f"{name}: facets name vertices 0 … {len(self.vertices) - 1}, got "
                f"{self.facets.min()} … {self.facets.max()}"
            )

    @classmethod
    def from_trimesh(cls, mesh: trimesh.Trimesh, unit: str, name: str = "mesh") -> typing.Self:
        """Takes a `trimesh.Trimesh` whose numbers are in `unit` ("km" or "m").

        Raises:
          InputError: it holds no triangles, the unit is not known, or the constructor refuses it.
        """
        import trimesh  # It is slow to import, so only when it is needed.

        if not isinstance(mesh, trimesh.Trimesh) or len(mesh.faces) == 0:
            raise InputError(f"{name} holds no triangles")
        return cls(mesh.vertices * metres_per(unit), mesh.faces, name)

    @cached_property
    def extents(self) -> Vector3:
        """Lengths (3,) in m of the bounding box along x, y, z."""
        return np.ptp(self.vertices, axis=0)

    @cached_property
    def normals(self) -> Vectors3:
        """Unit normals (F, 3) by the winding, outwards if closed; 0 of a facet without an area."""
        vectors = area_vectors(self.vertices, self.facets)
        return vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-300)
