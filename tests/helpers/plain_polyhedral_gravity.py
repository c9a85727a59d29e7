"""Polyhedral gravity written straight from Werner & Scheeres (1997), and bodies to try it on.

No series, no far field, no code shared with the product: one dyad per edge and facet, the
logarithm and atan2 as printed. It loses digits beside an edge and, as the square of the distance,
far away; in extended precision (`np.longdouble`) there are 3.3 more to lose.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import trimesh

G = 6.67430e-11


class PlainField(NamedTuple):
    """Potential, acceleration (3,), gradient (3, 3) and total solid angle at one point."""

    potential: np.floating
    acceleration: np.ndarray
    gradient: np.ndarray
    solid_angle: np.floating


class PlainPolyhedralGravity:
    """Field of a closed, outward-wound mesh of uniform density, in the mesh's frame."""

    def __init__(
        self, vertices: np.ndarray, facets: np.ndarray, density: float, dtype: type = float
    ):
        self.vertices = vertices = np.asarray(vertices, dtype=dtype)
        self.facets = facets = np.asarray(facets)
        self.factor = dtype(G) * dtype(density)
        a, b, c = vertices[facets[:, 0]], vertices[facets[:, 1]], vertices[facets[:, 2]]
        cross = _cross(b - a, c - a)
        normals = cross / np.sqrt((cross**2).sum(axis=1))[:, None]
        self.facet_dyads = normals[:, :, None] * normals[:, None, :]

        # Directed edge -> the facet that runs along it.
        owner = {}
        for index, (i, j, k) in enumerate(facets.tolist()):
            for edge in ((i, j), (j, k), (k, i)):
                assert edge not in owner, "two facets run along one edge in the same direction"
                owner[edge] = index
        edges, dyads = [], []
        for (i, j), facet in owner.items():
            if i < j:
                along = vertices[j] - vertices[i]
                along = along / np.sqrt((along**2).sum())
                dyad = np.zeros((3, 3), dtype=dtype)
                for normal, direction in (
                    (normals[facet], along),
                    (normals[owner[j, i]], -along),
                ):
                    outward = _cross(direction, normal)
                    dyad += np.outer(normal, outward)
                edges.append((i, j))
                dyads.append(dyad)
        self.edges = np.array(edges)
        self.edge_dyads = np.array(dyads)

    def at(self, point: np.ndarray) -> PlainField:
        """The field at one point (3,)."""
        towards = self.vertices - np.asarray(point, dtype=self.vertices.dtype)
        distance = np.sqrt((towards**2).sum(axis=1))

        start, end = self.edges.T
        along = towards[end] - towards[start]
        length = np.sqrt((along**2).sum(axis=1))
        both = distance[start] + distance[end]
        edge_potential = np.log((both + length) / (both - length))
        r_edge = towards[start]

        a, b, c = (towards[corner] for corner in self.facets.T)
        ra, rb, rc = (distance[corner] for corner in self.facets.T)
        angle = 2 * np.arctan2(
            _dot(a, _cross(b, c)),
            ra * rb * rc + ra * _dot(b, c) + rb * _dot(c, a) + rc * _dot(a, b),
        )

        edge_pull = _apply(self.edge_dyads, r_edge)
        facet_pull = _apply(self.facet_dyads, a)
        per_edge, per_facet = edge_potential[:, None], angle[:, None]
        potential = (r_edge * edge_pull * per_edge).sum() - (a * facet_pull * per_facet).sum()
        pull = (edge_pull * per_edge).sum(axis=0) - (facet_pull * per_facet).sum(axis=0)
        gradient = (self.edge_dyads * per_edge[:, None]).sum(axis=0)
        gradient -= (self.facet_dyads * per_facet[:, None]).sum(axis=0)
        return PlainField(
            self.factor / 2 * potential, -self.factor * pull, self.factor * gradient, angle.sum()
        )


def _dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return (a * b).sum(axis=1)


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """`np.cross`, spelled out so that it also keeps extended precision."""
    ax, ay, az = np.moveaxis(a, -1, 0)
    bx, by, bz = np.moveaxis(b, -1, 0)
    return np.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx], axis=-1)


def _apply(dyads: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    return (dyads * vectors[:, None, :]).sum(axis=2)


def star_shaped(seed: int, subdivisions: int = 2, size: float = 1.0) -> trimesh.Trimesh:
    """A random lumpy body, every point of it in sight of the origin; radii of about `size`."""
    rng = np.random.default_rng(seed)
    sphere = trimesh.creation.icosphere(subdivisions)
    places = rng.normal(size=(6, 3))
    places /= np.linalg.norm(places, axis=1, keepdims=True)
    lumps = np.exp(4.0 * (sphere.vertices @ places.T - 1.0)) @ rng.uniform(-0.5, 0.8, 6)
    stretch = rng.uniform(0.6, 1.4, 3)
    vertices = size * stretch * sphere.vertices * np.exp(lumps)[:, None]
    return trimesh.Trimesh(vertices, sphere.faces, process=False)


def box(low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (8, 3) and outward facets (12, 3) of an axis-aligned box."""
    corners = np.array([[i, j, k] for i in (0, 1) for j in (0, 1) for k in (0, 1)])
    squares = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    facets = [[s[0], *pair] for s in squares for pair in ((s[1], s[2]), (s[2], s[3]))]
    return np.where(corners, high, low).astype(float), np.array(facets)
