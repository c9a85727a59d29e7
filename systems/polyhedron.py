"""A closed, outward-wound triangle mesh of uniform density, in metres."""

from __future__ import annotations

import hashlib
from functools import cached_property
from pathlib import Path

import numpy as np
import trimesh

from proxops.systems.errors import InputError

METRES_PER_UNIT = {"m": 1.0, "km": 1000.0}


class Polyhedron:
    """The shape of a body: vertices (V, 3) in metres and facets (F, 3) wound outwards.

    A `Polyhedron` that exists is sound: every edge is shared by exactly two facets that run along
    it in opposite directions, no facet is degenerate, and the enclosed volume is positive. All
    checks are relative to the body's size, so that a pebble and a planet are judged alike.

    The body-fixed frame K of the other systems has its origin at the centre of mass: see
    `recentred`.
    """

    def __init__(self, vertices: np.ndarray, facets: np.ndarray, name: str = "mesh"):
        """Takes vertices (V, 3) in metres and facets (F, 3) of indices into them.

        Args:
          name: what error messages call the mesh, for instance its file name.

        Raises:
          InputError: the mesh is not sound; the message names the defect and where it is.
        """
        self.vertices = np.array(vertices, dtype=np.float64)
        self.facets = np.array(facets, dtype=np.int64)
        self.vertices.setflags(write=False)
        self.facets.setflags(write=False)
        self.name = name
        _check(self)

    @classmethod
    def load(cls, path: str | Path, unit: str = "km") -> Polyhedron:
        """Reads an OBJ, PLY or STL file whose numbers are in `unit` ("km" or "m").

        Raises:
          InputError: no such file, not a mesh, an unknown unit, or an unsound mesh.
        """
        path = Path(path)
        _metres_per(unit)  # A wrong unit is said before the file is looked for.
        if not path.is_file():
            raise InputError(f"mesh file {path} does not exist or is not a file")
        try:
            mesh = trimesh.load_mesh(path, process=False)
        except Exception as error:
            raise InputError(f"{path} could not be read as a mesh: {error}") from error
        if path.suffix.lower() == ".stl":
            mesh.merge_vertices()  # STL has no shared vertices to begin with.
        return cls.from_trimesh(mesh, unit, name=path.name)

    @classmethod
    def from_trimesh(cls, mesh: trimesh.Trimesh, unit: str, name: str = "mesh") -> Polyhedron:
        """Takes a `trimesh.Trimesh` whose numbers are in `unit` ("km" or "m")."""
        if not isinstance(mesh, trimesh.Trimesh) or len(mesh.faces) == 0:
            raise InputError(f"{name} holds no triangles")
        return cls(mesh.vertices * _metres_per(unit), mesh.faces, name)

    def to_trimesh(self, unit: str = "m") -> trimesh.Trimesh:
        """The same mesh as a `trimesh.Trimesh` in `unit`."""
        scale = _metres_per(unit)
        return trimesh.Trimesh(self.vertices / scale, self.facets, process=False)

    def recentred(self) -> Polyhedron:
        """The mesh moved so that its centre of mass is the origin of K."""
        return Polyhedron(self.vertices - self.centre_of_mass, self.facets, self.name)

    @cached_property
    def _corners(self) -> np.ndarray:
        return self.vertices[self.facets]

    @cached_property
    def volume(self) -> float:
        """Enclosed volume in m^3, signed sum of tetrahedra: right for bent bodies too."""
        a, b, c = np.moveaxis(self._corners - self.vertices.mean(axis=0), 1, 0)
        return float(np.einsum("fi,fi->", a, np.cross(b, c)) / 6.0)

    @cached_property
    def centre_of_mass(self) -> np.ndarray:
        """Centre of mass (3,) in m, at uniform density."""
        origin = self.vertices.mean(axis=0)
        a, b, c = np.moveaxis(self._corners - origin, 1, 0)
        six_volumes = np.einsum("fi,fi->f", a, np.cross(b, c))
        return origin + six_volumes @ (a + b + c) / (4.0 * six_volumes.sum())

    @cached_property
    def extents(self) -> np.ndarray:
        """Lengths (3,) in m of the bounding box along x, y, z."""
        return np.ptp(self.vertices, axis=0)

    @cached_property
    def normals(self) -> np.ndarray:
        """Outward unit normals (F, 3)."""
        a, b, c = np.moveaxis(self._corners, 1, 0)
        cross = np.cross(b - a, c - a)
        return cross / np.linalg.norm(cross, axis=1, keepdims=True)

    @cached_property
    def edges(self) -> tuple[np.ndarray, np.ndarray]:
        """Edges (E, 2) as vertex indices and, per edge, the facets (E, 2) on its two sides.

        The first facet runs along the edge from its first vertex to its second, the other facet
        runs back.
        """
        directed, owner, order = _directed_edges(self.facets, len(self.vertices))
        return directed[order[::2]], owner[order].reshape(-1, 2)

    @cached_property
    def sha256(self) -> str:
        """Hash of vertices and facets, by which logs name the shape."""
        digest = hashlib.sha256(self.vertices.astype("<f8").tobytes())
        digest.update(self.facets.astype("<i8").tobytes())
        return digest.hexdigest()


def _metres_per(unit: str) -> float:
    if unit not in METRES_PER_UNIT:
        raise InputError(f"mesh unit {unit!r} is not known: use one of 'km', 'm'")
    return METRES_PER_UNIT[unit]


def _directed_edges(facets: np.ndarray, vertex_count: int):
    """Directed edges (3F, 2), the facets they belong to, and an order that puts pairs together."""
    directed = np.concatenate([facets[:, [0, 1]], facets[:, [1, 2]], facets[:, [2, 0]]])
    owner = np.tile(np.arange(len(facets)), 3)
    key = directed.min(axis=1) * vertex_count + directed.max(axis=1)
    return directed, owner, np.lexsort((owner, key))


def _check(mesh: Polyhedron) -> None:
    """Raises `InputError` unless the mesh is closed, consistently wound and of positive volume."""
    name, vertices, facets = mesh.name, mesh.vertices, mesh.facets
    hint = "repair the mesh (trimesh and MeshLab can) and load it again"
    if vertices.ndim != 2 or vertices.shape[1] != 3 or facets.ndim != 2 or facets.shape[1] != 3:
        raise InputError(
            f"{name}: vertices must be (V, 3) and facets (F, 3), "
            f"got {vertices.shape} and {facets.shape}"
        )
    if len(facets) < 4:
        raise InputError(f"{name} has {len(facets)} facets; a closed body has at least 4")
    bad = np.flatnonzero(~np.isfinite(vertices).all(axis=1))
    if bad.size:
        raise InputError(f"{name}: vertex {bad[0]} is {vertices[bad[0]]}, not finite")
    if facets.min() < 0 or facets.max() >= len(vertices):
        raise InputError(f"{name}: a facet names a vertex outside 0…{len(vertices) - 1}")
    unique, index = np.unique(vertices, axis=0, return_index=True)
    if len(unique) < len(vertices):
        twin = np.setdiff1d(np.arange(len(vertices)), index)[0]
        raise InputError(
            f"{name}: {len(vertices) - len(unique)} duplicate vertices (the first is vertex "
            f"{twin}); weld them so that neighbouring facets share vertices: {hint}"
        )
    scale = float(np.ptp(vertices, axis=0).max())
    a, b, c = np.moveaxis(vertices[facets], 1, 0)
    twice_area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    flat = np.flatnonzero(twice_area <= 1e-12 * scale**2)
    if flat.size:
        raise InputError(f"{name}: {flat.size} facets have no area, the first is facet {flat[0]}")
    directed, owner, order = _directed_edges(facets, len(vertices))
    low = np.sort(directed[order], axis=1)
    starts = np.flatnonzero(np.r_[True, (low[1:] != low[:-1]).any(axis=1)])
    counts = np.diff(np.r_[starts, len(low)])
    if (counts == 1).any():
        at = owner[order[starts[counts == 1][0]]]
        raise InputError(
            f"{name} has holes: {np.sum(counts == 1)} edges belong to one facet only, "
            f"the first at facet {at}: {hint}"
        )
    if (counts != 2).any():
        at = owner[order[starts[counts != 2][0]]]
        raise InputError(
            f"{name}: {np.sum(counts != 2)} edges belong to more than two facets, "
            f"the first at facet {at}: {hint}"
        )
    same = np.flatnonzero((directed[order[::2]] == directed[order[1::2]]).all(axis=1))
    if same.size:
        raise InputError(
            f"{name}: mixed winding: facets {owner[order[2 * same[0]]]} and "
            f"{owner[order[2 * same[0] + 1]]} run along their common edge in the same direction "
            f"({same.size} such edges): {hint}"
        )
    if abs(mesh.volume) <= 1e-9 * scale**3:
        raise InputError(f"{name} encloses no volume ({mesh.volume:.3g} m^3 at {scale:.3g} m)")
    if mesh.volume < 0:
        raise InputError(
            f"{name} is inside out: its facets wind inwards (volume {mesh.volume:.3g} m^3); "
            "reverse the vertex order of every facet"
        )
