"""A contact binary: two ellipsoids that overlap, as one closed mesh."""

import numpy as np
import trimesh


def contact_binary(length: float = 500.0, subdivisions: int = 4) -> trimesh.Trimesh:
    """Two lobes along x, `length` long, 20 * 4^subdivisions facets; the origin in the neck.

    Each lobe is convex and holds the origin, so the surface is in sight of it: in every direction
    it is where the ray leaves the farther lobe.
    """
    sphere = trimesh.creation.icosphere(subdivisions)
    lobes = (
        (np.array([-0.23, 0.0, 0.0]), np.array([0.27, 0.20, 0.18])),
        (np.array([0.26, 0.02, 0.01]), np.array([0.295, 0.24, 0.21])),
    )
    radii = np.max([_exit(sphere.vertices, *lobe) for lobe in lobes], axis=0)
    vertices = sphere.vertices * radii[:, None]
    vertices *= length / np.ptp(vertices[:, 0])
    return trimesh.Trimesh(vertices, sphere.faces, process=False)


def together(*meshes: trimesh.Trimesh) -> trimesh.Trimesh:
    """All of them in one mesh, not joined."""
    starts = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
    faces = [mesh.faces + start for mesh, start in zip(meshes, starts[:-1], strict=True)]
    vertices = np.concatenate([mesh.vertices for mesh in meshes])
    return trimesh.Trimesh(vertices, np.concatenate(faces), process=False)


def _exit(directions: np.ndarray, centre: np.ndarray, axes: np.ndarray) -> np.ndarray:
    """Distances (N,) from the origin, inside, to an ellipsoid's surface."""
    d, c = directions / axes, centre / axes
    a, b = np.sum(d**2, axis=1), d @ c
    return (b + np.sqrt(b**2 - a * (c @ c - 1.0))) / a
