"""`registered`: another mesh of the same body, moved onto the map; `greatest_gap`: how far off."""

from __future__ import annotations

import numpy as np
import scipy  # Its parts are imported when they are used.

from proxops.systems.common import InputError, one_thread
from proxops.systems.shapes.displacement import rigid_motions
from proxops.systems.shapes.mesh_checks import areas
from proxops.systems.shapes.polyhedron import Polyhedron

# Facets, by nearness of their centroids, among which the nearest point of the map is looked for.
_CANDIDATES = 8
_ITERATIONS = 100
# A step is small enough to stop if it is below this share of the body's length, or if the distances
# have not become less in as many steps: then points change from one plane to the next and back.
_SMALL, _PATIENCE = 1e-9, 10
# By less than this share they become less for ever, on the way forth and back.
_ROUNDING = 1e-9
# More facets than this are thinned, evenly: they say no more of six numbers.
_ENOUGH = 3_000


@one_thread()
def registered(mesh: Polyhedron, onto: Polyhedron) -> Polyhedron:
    """The mesh turned and moved so that its surface lies on the map's as well as it can.

    The distances of its facets' centroids to the nearest facets' planes, weighted by area, become
    least in squares: Chen & Medioni, Image Vis. Comput. 10 (1992) 145. The start may be off by
    5 % of the body's length and 5 degrees. Of a body of revolution the rotation about its axis may
    be any. The result depends on the two meshes alone. It ends when a step is below 1e-9 of the
    body's length, or when the distances have not become less in ten.

    Args:
      mesh: the mesh to move.
      onto: the map, a mesh of the same body in K; its frame is the result's.

    Raises:
      InputError: the two surfaces are so different that no place is found.
    """
    tree = scipy.spatial.KDTree(onto.vertices[onto.facets].mean(axis=1))
    size, middle = onto.extents.max(), onto.centre_of_mass
    facets = mesh.facets[:: -(-len(mesh.facets) // _ENOUGH)]
    root = np.sqrt(areas(mesh.vertices, facets))
    vertices = best = mesh.vertices
    least, since = np.inf, 0
    for _ in range(_ITERATIONS):
        points = vertices[facets].mean(axis=1)
        normals, heights = _nearest_planes(onto, tree, points)
        squares, since = float(np.sum((heights * root) ** 2)), since + 1
        if squares < least:
            since = since if squares > (1.0 - _ROUNDING) * least else 0
            best, least = vertices, squares
        if since == _PATIENCE:
            return Polyhedron(best, mesh.facets, mesh.name)
        rows = rigid_motions(points, normals, middle, size)
        fit, *_ = np.linalg.lstsq(rows * root[:, None], -heights * root)
        turn = scipy.spatial.transform.Rotation.from_rotvec(fit[3:] / size)
        vertices = middle + turn.apply(vertices - middle) + fit[:3]
        if np.linalg.norm(fit) < _SMALL * size:
            return Polyhedron(vertices, mesh.facets, mesh.name)
    raise InputError(
        f"{mesh.name} finds no place on {onto.name}: are they meshes of the same body, turned "
        "by less than 5 degrees?"
    )


def greatest_gap(mesh: Polyhedron, onto: Polyhedron) -> float:
    """The greatest distance in m of a mesh's vertices from another mesh of the body."""
    tree = scipy.spatial.KDTree(onto.vertices[onto.facets].mean(axis=1))
    return float(_nearest_facets(onto, tree, mesh.vertices)[1].max())


def _nearest_planes(
    onto: Polyhedron, tree: scipy.spatial.KDTree, points: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """The normal (N, 3) of the facet nearest to each point, and the height (N,) over its plane."""
    nearest, _ = _nearest_facets(onto, tree, points)
    normals = onto.normals[nearest]
    start = onto.vertices[onto.facets[nearest, 0]]
    return normals, np.einsum("ni,ni->n", points - start, normals)


def _nearest_facets(
    onto: Polyhedron, tree: scipy.spatial.KDTree, points: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """The facet (N,) nearest to each point, and the distance (N,) of it."""
    import trimesh  # It is slow to import, so only when it is needed.

    count = min(_CANDIDATES, len(onto.facets))
    _, near = tree.query(points, k=count)
    corners = onto.vertices[onto.facets[near.ravel()]]
    feet = trimesh.triangles.closest_point(corners, np.repeat(points, count, axis=0))
    gaps = np.linalg.norm(feet.reshape(-1, count, 3) - points[:, None], axis=2)
    chosen = gaps.argmin(axis=1)[:, None]
    nearest = np.take_along_axis(near, chosen, axis=1)[:, 0]
    return nearest, np.take_along_axis(gaps, chosen, axis=1)[:, 0]
