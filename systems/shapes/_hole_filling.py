"""Holes of a mesh: their rims, and the patches that close them."""

from __future__ import annotations

import numpy as np

from proxops.systems.common import InputError
from proxops.systems.shapes._polygons import best_triangles
from proxops.systems.shapes.mesh_checks import directed_edges, edge_groups

LONGEST_RIM = 200


def boundary_loops(facets: np.ndarray, vertex_count: int) -> list[np.ndarray]:
    """The rims of the holes of consistently wound facets (F, 3), each as vertex indices (n,).

    A rim has the direction in which the facets of a patch run along it. Rims that touch at a vertex
    are separate rims.

    Raises:
      InputError: some edge has more than two facets, so that rims cannot be followed.
    """
    directed, owner, order = directed_edges(facets, vertex_count)
    starts, counts = edge_groups(directed, order)
    if (counts > 2).any():
        at = owner[order[starts[counts > 2][0]]]
        raise InputError(
            f"the mesh cannot be mended: {np.sum(counts > 2)} edges belong to more than two "
            f"facets, the first at facet {at}; which of them bound the body is not said"
        )
    # A patch runs along the rim in the opposite direction.
    following: dict[int, list[int]] = {}
    for b, a in directed[order[starts[counts == 1]]].tolist():
        following.setdefault(a, []).append(b)
    loops = []
    while following:
        walk = [next(iter(following))]
        place = {walk[0]: 0}
        while walk[-1] in following:
            ends = following[walk[-1]]
            end = ends.pop()
            if not ends:
                del following[walk[-1]]
            if end in place:  # A rim closes here. Where rims touch, the walk goes on before it.
                loops.append(np.array(walk[place[end] :]))
                for vertex in walk[place[end] + 1 :]:
                    del place[vertex]
                walk = walk[: place[end] + 1]
            else:
                place[end] = len(walk)
                walk.append(end)
    return loops


def triangulate_loop(vertices: np.ndarray, facets: np.ndarray, loop: np.ndarray) -> np.ndarray:
    """The patch (n - 2, 3) of facets over the rim `loop` (n,), wound in the rim's direction.

    `best_triangles` are the patch. A diagonal that is an edge of the mesh already is not used.

    Raises:
      InputError: the rim is longer than `LONGEST_RIM`, or has no such patch.
    """
    n = len(loop)
    if not 3 <= n <= LONGEST_RIM:
        raise InputError(
            f"the mesh cannot be mended: the hole at vertex {loop[0]} has {n} edges; 3 to "
            f"{LONGEST_RIM} are filled"
        )
    points = vertices[loop] / np.ptp(vertices[loop], axis=0).max()
    near = facets[np.isin(facets, loop).sum(axis=1) >= 2]
    taken = {frozenset(edge) for edge in directed_edges(near, len(vertices))[0].tolist()}
    free = np.ones((n, n), dtype=bool)
    for i in range(n):
        for k in range(i + 2, n):
            is_rim = i == 0 and k == n - 1
            free[i, k] = is_rim or frozenset((int(loop[i]), int(loop[k]))) not in taken
    patch = best_triangles(points, free)
    if patch is None:
        raise InputError(f"the mesh cannot be mended: the hole at vertex {loop[0]} has no patch")
    return loop[patch]
