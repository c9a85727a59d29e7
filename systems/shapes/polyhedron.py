"""A closed, outward-wound triangle mesh of uniform density, in metres."""

from __future__ import annotations

import hashlib
import math
import typing
from functools import cached_property
from pathlib import Path

import numpy as np

from proxops.systems.common import InputError, Vector3
from proxops.systems.shapes.mesh_checks import directed_edges, find_defects, six_volumes
from proxops.systems.shapes.shape_files import metres_per, read_mesh
from proxops.systems.shapes.surface import Surface

if typing.TYPE_CHECKING:
    import trimesh


class Polyhedron(Surface):
    """The shape of a body: vertices (V, 3) in metres and facets (F, 3) wound outwards.

    Every `Polyhedron` is sound: each edge is shared by exactly two facets that run along it in
    opposite directions, no facet is degenerate, and the enclosed volume is positive. All checks are
    relative to the body's size.

    The origin of the body-fixed frame K of the other systems is the centre of mass: see
    `recentred`.
    """

    def __init__(self, vertices: np.ndarray, facets: np.ndarray, name: str = "mesh"):
        """Takes vertices (V, 3) in metres and facets (F, 3) of indices into them.

        Args:
          vertices, facets: the mesh.
          name: name of the mesh in error messages, for instance its file name.

        Raises:
          InputError: the mesh is not sound; the message names the defect and where it is.
        """
        self.vertices = np.array(vertices, dtype=np.float64)
        self.facets = np.array(facets, dtype=np.int64)
        self.vertices.setflags(write=False)
        self.facets.setflags(write=False)
        self.name = name
        defects = find_defects(self.vertices, self.facets)
        if defects:
            raise InputError(f"{defects[0].about(name)}; `proxops shape --fix` may mend it")

    @classmethod
    def load(cls, path: str | Path, unit: str = "km") -> Polyhedron:
        """Reads an OBJ, PLY, STL or PDS `.tab` file whose numbers are in `unit` ("km" or "m").

        Raises:
          InputError: the file does not exist or is no mesh, the unit is not known, or the mesh is
            not sound.
        """
        mesh = read_mesh(path, unit)
        return cls(mesh.vertices, mesh.facets, mesh.name)

    def to_trimesh(self, unit: str = "m") -> trimesh.Trimesh:
        """The same mesh as a `trimesh.Trimesh` in `unit`."""
        import trimesh  # It is slow to import, so only when it is needed.

        scale = metres_per(unit)
        return trimesh.Trimesh(self.vertices / scale, self.facets, process=False)

    def recentred(self) -> Polyhedron:
        """The mesh moved so that its centre of mass is the origin of K."""
        return Polyhedron(self.vertices - self.centre_of_mass, self.facets, self.name)

    @cached_property
    def volume(self) -> float:
        """Enclosed volume in m^3: the sum of signed tetrahedra, for bodies of any form."""
        return float(six_volumes(self.vertices, self.facets).sum() / 6.0)

    @cached_property
    def centre_of_mass(self) -> Vector3:
        """Centre of mass (3,) in m, at uniform density."""
        origin = self.vertices.mean(axis=0)
        corner_sums = (self.vertices[self.facets] - origin).sum(axis=1)
        weights = six_volumes(self.vertices, self.facets)
        # Exact sums: those of a library for matrices differ in the last bit from processor to
        # processor, and with them K and `sha256`.
        moments = [math.fsum(weights * sums) for sums in corner_sums.T]
        return origin + np.array(moments) / (4.0 * math.fsum(weights))

    @cached_property
    def edges(self) -> tuple[np.ndarray, np.ndarray]:
        """Edges (E, 2) as vertex indices and, per edge, the facets (E, 2) on its two sides.

        The first facet runs along the edge from its first vertex to its second, the other facet in
        the opposite direction.
        """
        directed, owner, order = directed_edges(self.facets, len(self.vertices))
        return directed[order[::2]], owner[order].reshape(-1, 2)

    @cached_property
    def sha256(self) -> str:
        """SHA-256 of vertices and facets; it identifies the shape in logs."""
        digest = hashlib.sha256(self.vertices.astype("<f8").tobytes())
        digest.update(self.facets.astype("<i8").tobytes())
        return digest.hexdigest()
