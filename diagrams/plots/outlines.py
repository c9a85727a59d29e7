"""The outline of a body as it is seen along an axis of K."""

from __future__ import annotations

from collections import defaultdict

import numpy as np

from proxops.systems.shapes import Polyhedron, ray_caster

# How far beside an edge we look for the body, over the body's greatest extent.
_BESIDE = 1e-4
# Parts into which an edge is cut: of an edge that is half hidden, only some are on the outline.
_PARTS = 8


def outline(shape: Polyhedron, across: int, up: int) -> list[np.ndarray]:
    """Computes the outline of a body's projection along an axis.

    Edges between a facet that faces the viewer and one that does not are cut into parts. A part
    lies on the outline if the body is seen on one side of its middle only.

    Args:
      shape: the body's shape in K.
      across: number of the axis of K that points to the right.
      up: number of the axis of K that points upwards.

    Returns:
      Polylines (N, 2) in m.
    """
    edges, sides = shape.edges
    facing = shape.normals[:, 3 - across - up] > 0.0
    flat = shape.vertices[:, [across, up]]
    nodes, parts = _cut(flat, edges[facing[sides[:, 0]] != facing[sides[:, 1]]])
    begin, end = nodes[parts[:, 0]], nodes[parts[:, 1]]
    aside = (end - begin)[:, ::-1] * [1.0, -1.0]
    aside /= np.maximum(np.linalg.norm(aside, axis=1, keepdims=True), np.finfo(float).tiny)
    aside *= _BESIDE * float(shape.extents.max())
    middle = (begin + end) / 2.0
    seen = [_is_hit(shape, middle + sign * aside, across, up) for sign in (-1.0, 1.0)]
    return [nodes[chain] for chain in _chains(parts[seen[0] != seen[1]])]


def _cut(flat: np.ndarray, edges: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Cuts edges (E, 2) between points (N, 2); gives all points, and the parts as pairs of them."""
    share = np.arange(1, _PARTS)[None, :, None] / _PARTS
    begin, end = flat[edges[:, 0], None], flat[edges[:, 1], None]
    between = (begin + share * (end - begin)).reshape(-1, 2)
    numbers = len(flat) + np.arange(len(between)).reshape(len(edges), _PARTS - 1)
    row = np.hstack([edges[:, :1], numbers, edges[:, 1:]])
    parts = np.stack([row[:, :-1], row[:, 1:]], axis=-1).reshape(-1, 2)
    return np.vstack([flat, between]), parts


def _is_hit(shape: Polyhedron, points: np.ndarray, across: int, up: int) -> np.ndarray:
    """Tells which points (N, 2) of the picture show the body."""
    along = 3 - across - up
    origins, directions = np.zeros((2, len(points), 3))
    origins[:, [across, up]] = points
    origins[:, along] = shape.vertices[:, along].max() + float(shape.extents.max())
    directions[:, along] = -1.0
    return np.isfinite(ray_caster(shape).distances(origins, directions))


def _chains(edges: np.ndarray) -> list[list[int]]:
    """Joins edges (N, 2) of vertex numbers to polylines, each as a list of vertex numbers."""
    neighbours: dict[int, set[int]] = defaultdict(set)
    for a, b in edges.tolist():
        neighbours[a].add(b)
        neighbours[b].add(a)
    # A polyline that has ends begins at one of them.
    order = sorted(neighbours, key=lambda vertex: len(neighbours[vertex]) % 2 == 0)
    chains = []
    for first in order:
        while neighbours[first]:
            chain = [first]
            while neighbours[chain[-1]]:
                here = chain[-1]
                there = neighbours[here].pop()
                neighbours[there].discard(here)
                chain.append(there)
            chains.append(chain)
    return chains
