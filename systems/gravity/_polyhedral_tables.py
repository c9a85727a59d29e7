"""The tables of `_polyhedral_kernel`: a mesh as *units* of two facets and three edges.

Each edge of a closed mesh belongs to one of the two facets at it, so that half of the facets have
one edge and half have two. A unit is one facet of each kind. So the kernel takes all distances that
an edge needs from its facet, and each unit is like all others.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from proxops.systems.common import kernel
from proxops.systems.gravity._polyhedral_kernel import BLOCK, ROWS
from proxops.systems.shapes import Polyhedron

# Doubles between rows, beyond the block: without them, rows of many units would fall on the same
# lines of the processor's fastest cache.
_GAP = 8


class Tables(NamedTuple):
    """What `_polyhedral_kernel.evaluate_points` knows of the mesh."""

    corners: np.ndarray
    """(K, 6, BLOCK) uint32: indices of vertices, three of each facet."""
    vertices: np.ndarray
    """(3, V) in m."""
    units: np.ndarray
    """(K, ROWS, BLOCK + _GAP): of both facets, first that with two edges, the normal, height of the
    plane over the origin, four times the area, and squares of the edges opposite to the corners;
    of the edges, which run from the corners 0, 1 and 3 to the next, nine moments and the length."""
    number: int
    """Of units."""


def make_tables(shape: Polyhedron, origin: np.ndarray) -> Tables:
    """The tables of a shape relative to `origin` (3,) in m."""
    ends, neighbours = shape.edges
    owner = _owners(np.ascontiguousarray(neighbours), len(shape.facets))
    # The first facet runs along the edge from its first end, the other one from its second end.
    start = np.where(owner == neighbours[:, 0], ends[:, 0], ends[:, 1])
    side = np.argmax(shape.facets[owner] == start[:, None], axis=1)
    edge = np.full(shape.facets.shape, -1)
    edge[owner, side] = np.arange(len(ends))
    # Turn the corners so that a facet's edges are its first ones.
    missing = edge < 0
    single = missing.sum(axis=1) == 2
    turn = np.where(single, np.argmin(missing, axis=1), (np.argmax(missing, axis=1) + 1) % 3)
    order = (np.arange(3) + turn[:, None]) % 3
    corners = np.take_along_axis(shape.facets, order, axis=1)
    edge = np.take_along_axis(edge, order, axis=1)

    vertices = shape.vertices - origin
    facets = _facet_rows(vertices, shape.normals, corners)
    edges = _edge_rows(vertices, shape.normals, ends, neighbours)
    one, two = np.flatnonzero(single), np.flatnonzero(~single)
    parts = [
        facets[two],
        facets[one],
        edges[edge[two, 0]],
        edges[edge[two, 1]],
        edges[edge[one, 0]],
    ]
    both = np.concatenate([corners[two], corners[one]], axis=1)
    blocks = -(-len(one) // BLOCK)
    units = np.zeros((blocks, ROWS, BLOCK + _GAP))
    places = np.zeros((blocks, 6, BLOCK), dtype=np.uint32)
    rows = np.concatenate(parts, axis=1)
    for k in range(blocks):
        here = slice(k * BLOCK, (k + 1) * BLOCK)
        size = len(rows[here])
        units[k, :, :size], places[k, :, :size] = rows[here].T, both[here].T
    return Tables(places, np.ascontiguousarray(vertices.T), units, len(one))


def _facet_rows(vertices: np.ndarray, normals: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """The rows (F, 8) of facets."""
    a, b, c = np.moveaxis(vertices[corners], 1, 0)
    area4 = 2.0 * np.linalg.norm(np.cross(b - a, c - a), axis=1)
    height = np.einsum("fi,fi->f", normals, a)
    squares = [np.sum(side**2, axis=1) for side in (b - c, c - a, a - b)]
    return np.column_stack([normals, height, area4, *squares])


def _edge_rows(
    vertices: np.ndarray, normals: np.ndarray, ends: np.ndarray, neighbours: np.ndarray
) -> np.ndarray:
    """The rows (E, 10) of edges."""
    start = vertices[ends[:, 0]]
    along = vertices[ends[:, 1]] - start
    length = np.linalg.norm(along, axis=1)
    along = along / length[:, None]
    n_a, n_b = normals[neighbours[:, 0]], normals[neighbours[:, 1]]
    # The edge's outward normals in the planes of its facets. Facet b runs along it backwards.
    dyad = n_a[:, :, None] * np.cross(along, n_a)[:, None, :]
    dyad -= n_b[:, :, None] * np.cross(along, n_b)[:, None, :]
    dyad = 0.5 * (dyad + dyad.transpose(0, 2, 1))
    moved = np.einsum("nij,nj->ni", dyad, start)
    rows = [dyad[:, i, j] for i, j in ((0, 0), (1, 1), (0, 1), (0, 2), (1, 2))]
    rows += [*moved.T, np.einsum("ni,ni->n", moved, start), length]
    return np.column_stack(rows)


@kernel
def _owners(neighbours, facets):
    """The facet (E,) that each edge belongs to: one or two edges for each, of three.

    With facets as nodes, edges join two nodes, three at each. A further join of the facets 0 and 1,
    2 and 3, and so on makes four. So a walk over joins, each taken once, ends only where it began,
    and enters each node twice. A join belongs to the node that it enters.

    Args:
      neighbours: (E, 2) the facets at each edge. facets: their number, which is even.
    """
    size = len(neighbours)
    joins = np.empty((size + facets // 2, 2), dtype=np.int64)
    for k in range(size):  # A slice takes numba seconds to compile.
        joins[k, 0], joins[k, 1] = neighbours[k, 0], neighbours[k, 1]
    for k in range(facets // 2):
        joins[size + k, 0], joins[size + k, 1] = 2 * k, 2 * k + 1
    at, filled = np.empty((facets, 4), dtype=np.int64), np.zeros(facets, dtype=np.int64)
    for k in range(len(joins)):
        for i in range(2):
            node = joins[k, i]
            at[node, filled[node]] = k
            filled[node] += 1
    owner = np.full(len(joins), -1, dtype=np.int64)
    for begin in range(facets):
        node, moved = begin, True
        while moved:
            moved = False
            for i in range(4):
                k = at[node, i]
                if owner[k] < 0:
                    node = joins[k, 0] + joins[k, 1] - node
                    owner[k], moved = node, True
                    break
    return owner[:size]
