"""A surface of any form from placed returns: an indicator function on a grid, and its boundary."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy.ndimage
from scipy.spatial import KDTree

from proxops.systems.common import InputError, Values, Vectors3, one_thread
from proxops.systems.shapes import self_intersections

# Returns that show a place's normal.
_NEIGHBOURS = 14
# Points whose neighbours are farther away than this many times the usual are false.
_ALONE = 6.0
# The grid reaches beyond the points by this share of their extent on each side.
_ROOM = 0.3
# Cells of the grid of the indicator function, along each edge of those of the surface.
_FINER = 2
# Of the smoothing of the grid, in its cells, and by how much it grows if the surface is not sound.
_SMOOTH, _SMOOTHER, _TRIES = 1.2, 1.3, 6
# How often facets that cut each other are drawn apart.
_TURNS = 40
# Facets of a surface net, over its area in squared cells.
_FACETS = 3.0


class Oriented(NamedTuple):
    """Points of a surface."""

    points: Vectors3
    """(K, 3) in m."""
    normals: Vectors3
    """(K, 3) unit vectors outwards."""
    areas: Values
    """(K,) in m^2: what each point stands for."""


class Mesh(NamedTuple):
    """A closed mesh, wound outwards."""

    vertices: Vectors3
    """(V, 3) in m."""
    facets: np.ndarray
    """(F, 3) int."""


@one_thread()
def oriented(points: Vectors3, rays: Vectors3) -> Oriented:
    """Finds the normal of each point (K, 3) from its neighbours; it looks back along the ray.

    Points that are alone are left out. `rays` (K, 3) are the lidar's, in the frame of the points.
    """
    gaps, near = map(np.asarray, KDTree(points).query(points, k=_NEIGHBOURS))
    radii = gaps[:, -1]
    kept = radii < _ALONE * np.median(radii)
    near, radii = near[kept], radii[kept]
    around = points[near] - points[near].mean(axis=1, keepdims=True)
    _, vectors = np.linalg.eigh(np.einsum("kni,knj->kij", around, around))
    normals = vectors[:, :, 0]
    against = np.einsum("ki,ki->k", normals, rays[kept]) > 0.0
    normals = np.where(against[:, None], -normals, normals)
    return Oriented(points[kept], normals, np.pi * radii**2 / _NEIGHBOURS)


@one_thread()
def free_surface(surface: Oriented, area: float, facets: int) -> Mesh:
    """Makes a closed mesh near oriented points, of one piece without voids.

    The indicator function of the body has the gradient -n over the surface. Its Poisson equation
    is solved on a grid by Fourier transforms (Kazhdan, Bolitho and Hoppe, Poisson Surface
    Reconstruction, 2006), and its boundary is taken as a surface net (Gibson, Constrained Elastic
    Surface Nets, 1998). The mesh is as fine as the grid: it is the start of a fit to the points.

    Args:
      surface: the points. area: of the body, about, in m^2. facets: of the mesh, about.

    Raises:
      InputError: no closed surface was found.
    """
    cell = np.sqrt(_FACETS * area / facets)
    smooth = _SMOOTH
    for _ in range(_TRIES):
        inside, origin, levels = _indicator(surface, cell, smooth)
        if not _reaches_edge(inside):
            mesh = _surface_net(inside, levels, origin, cell)
            if _closed(mesh.facets):
                return mesh
        smooth *= _SMOOTHER
    raise InputError("the returns show no closed surface: see more of the body, from more sides")


def _indicator(
    surface: Oriented, cell: float, smooth: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Which corners of the cells are inside, where the first is, and their levels."""
    low, high = surface.points.min(axis=0), surface.points.max(axis=0)
    room = _ROOM * float((high - low).max())
    shape = _FINER * (np.ceil((high - low + 2.0 * room) / cell).astype(int) + 1)
    origin, fine = low - room, cell / _FINER
    places = (surface.points - origin) / fine
    first = np.floor(places).astype(int)
    rest = places - first
    field = np.zeros((3, *shape))
    flat = field.reshape(3, -1)
    for corner in np.ndindex(2, 2, 2):
        weights = np.prod(np.where(corner, rest, 1.0 - rest), axis=1) * surface.areas
        index = np.ravel_multi_index(tuple((first + corner).T), shape)
        for i in range(3):
            flat[i] += np.bincount(index, weights * surface.normals[:, i], flat.shape[1])
    waves = [2.0 * np.pi * np.fft.fftfreq(n) for n in shape[:2]]
    waves.append(2.0 * np.pi * np.fft.rfftfreq(shape[2]))
    kx, ky, kz = np.meshgrid(*waves, indexing="ij")
    square = kx**2 + ky**2 + kz**2
    square[0, 0, 0] = 1.0
    field = np.fft.rfftn(field, axes=(1, 2, 3))
    total = (1j * (kx * field[0] + ky * field[1] + kz * field[2])) / square
    total *= np.exp(-0.5 * square * smooth**2)
    total[0, 0, 0] = 0.0
    levels = np.fft.irfftn(total, s=shape, axes=(0, 1, 2))
    at = scipy.ndimage.map_coordinates(levels, places.T, order=1)
    levels = levels - np.average(at, weights=surface.areas)
    levels = levels[::_FINER, ::_FINER, ::_FINER]
    return _one_piece(levels > 0.0), origin, levels


def _one_piece(inside: np.ndarray) -> np.ndarray:
    """The greatest piece of what is inside, with its voids filled."""
    labels = np.empty(inside.shape, dtype=np.int32)
    if scipy.ndimage.label(inside, output=labels) == 0:
        return inside
    largest = 1 + int(np.argmax(np.bincount(labels.ravel())[1:]))
    return np.asarray(scipy.ndimage.binary_fill_holes(labels == largest))


def _reaches_edge(inside: np.ndarray) -> bool:
    """Whether the body sticks out of the grid."""
    return any(np.take(inside, [0, -1], axis=axis).any() for axis in range(3))


def _surface_net(inside: np.ndarray, levels: np.ndarray, origin: np.ndarray, cell: float) -> Mesh:
    """The boundary of what is inside: a vertex in each cell that it crosses."""
    # Where pieces were left out or voids filled, a level has the wrong sign.
    levels = np.where(
        (levels > 0.0) == inside, levels, np.where(inside, 1e-3, -1e-3) * np.ptp(levels)
    )
    sums, counts = (
        np.zeros((*(np.array(inside.shape) - 1), 3)),
        np.zeros(np.array(inside.shape) - 1),
    )
    quads = []
    for axis in range(3):
        ends = [slice(None)] * 3
        ends[axis] = slice(None, -1)
        more = [slice(None)] * 3
        more[axis] = slice(1, None)
        here, there = inside[tuple(ends)], inside[tuple(more)]
        edges = np.argwhere(here != there)
        one, two = levels[tuple(ends)][here != there], levels[tuple(more)][here != there]
        crossing = edges.astype(float)
        crossing[:, axis] += one / (one - two)
        b, c = (axis + 1) % 3, (axis + 2) % 3
        around = []
        for db, dc in ((0, 0), (-1, 0), (-1, -1), (0, -1)):
            cells = edges.copy()
            cells[:, b] += db
            cells[:, c] += dc
            around.append(cells)
            np.add.at(sums, tuple(cells.T), crossing)
            np.add.at(counts, tuple(cells.T), 1.0)
        index = np.stack([np.ravel_multi_index(tuple(x.T), counts.shape) for x in around], axis=1)
        outwards = here[here != there]  # The surface looks along the axis.
        quads.append(np.where(outwards[:, None], index, index[:, ::-1]))
    used = np.flatnonzero(counts.ravel())
    vertices = origin + cell * sums.reshape(-1, 3)[used] / counts.ravel()[used, None]
    quads = np.searchsorted(used, np.concatenate(quads))
    corners = vertices[quads]
    short = np.linalg.norm(corners[:, 0] - corners[:, 2], axis=1) <= np.linalg.norm(
        corners[:, 1] - corners[:, 3], axis=1
    )
    first = np.where(short[:, None], quads[:, [0, 1, 2]], quads[:, [0, 1, 3]])
    second = np.where(short[:, None], quads[:, [0, 2, 3]], quads[:, [1, 2, 3]])
    return Mesh(vertices, np.concatenate([first, second]))


def _closed(facets: np.ndarray) -> bool:
    """Whether each edge belongs to two facets that run along it in opposite directions."""
    if len(facets) == 0:
        return False
    directed = np.stack([facets, np.roll(facets, -1, axis=1)], axis=2).reshape(-1, 2)
    keys = directed[:, 0] * (facets.max() + 1) + directed[:, 1]
    back = directed[:, 1] * (facets.max() + 1) + directed[:, 0]
    return len(np.unique(keys)) == len(keys) and bool(np.isin(back, keys).all())


@one_thread()
def untangled(mesh: Mesh) -> Mesh:
    """The mesh with the vertices of facets that cut each other drawn towards their neighbours.

    Raises:
      InputError: they still do after many turns.
    """
    vertices, facets = mesh.vertices.copy(), mesh.facets
    first, second = facets.ravel(), np.roll(facets, -1, axis=1).ravel()
    counts = np.bincount(first, minlength=len(vertices))[:, None]
    for _ in range(_TURNS):
        pairs = self_intersections(vertices, facets)
        if len(pairs) == 0:
            return Mesh(vertices, facets)
        sums = np.stack(
            [np.bincount(first, column, len(vertices)) for column in vertices[second].T], axis=1
        )
        moved = np.unique(facets[pairs.ravel()])
        vertices[moved] = 0.5 * (vertices + sums / counts)[moved]
    raise InputError("the map cuts itself: survey the body for longer, from more sides")
