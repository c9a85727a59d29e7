"""A contact binary: two ellipsoids that overlap, as one closed mesh."""

import numpy as np
import trimesh
from numpy.typing import ArrayLike
from scripts import load_script

from proxops.systems import Polyhedron


def contact_binary(length: float = 500.0, subdivisions: int = 4) -> trimesh.Trimesh:
    """Two lobes along x, `length` long, 20 * 4^subdivisions facets; the origin in the neck.

    The surface is in sight of the origin.
    """
    sphere = trimesh.creation.icosphere(subdivisions)
    radii = load_script("benchmarks/_bodies.py").two_ellipsoids(np.array(sphere.vertices))
    vertices = sphere.vertices * radii[:, None]
    vertices *= length / np.ptp(vertices[:, 0])
    return trimesh.Trimesh(vertices, sphere.faces, process=False)


def together(*meshes: trimesh.Trimesh) -> trimesh.Trimesh:
    """All of them in one mesh, not joined."""
    starts = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
    faces = [mesh.faces + start for mesh, start in zip(meshes, starts[:-1], strict=True)]
    vertices = np.concatenate([mesh.vertices for mesh in meshes])
    return trimesh.Trimesh(vertices, np.concatenate(faces), process=False)


def polyhedron(*meshes: trimesh.Trimesh) -> Polyhedron:
    """The same as a shape; the meshes are in m."""
    return Polyhedron.from_trimesh(together(*meshes), "m")


def box(centre: ArrayLike, extents: ArrayLike) -> trimesh.Trimesh:
    mesh = trimesh.creation.box(extents)
    mesh.apply_translation(centre)
    return mesh
