"""Checks of a triangle mesh that should enclose a body; each defect is reported as a `Defect`.

All tolerances are relative to the mesh's size.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from proxops.systems.common import Values, Vector3, Vectors3

# A facet of which twice the area is below this share of the square of the body's length has none.
FLAT = 1e-12
# A volume below this share of the cube of the body's length is none.
_NO_VOLUME = 1e-9


@dataclass(frozen=True)
class Defect:
    """One kind of defect, and where it is."""

    kind: str
    """A short name, the same for every mesh."""
    text: str
    """The description: the rest of a sentence that begins with the mesh's name."""
    facets: np.ndarray
    """Ascending indices of the facets concerned, or of the vertices for a defect of vertices."""

    def about(self, name: str = "the mesh") -> str:
        """The whole sentence."""
        return name + self.text


def directed_edges(
    facets: np.ndarray, vertex_count: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Directed edges (3F, 2), their facets (3F,), and an order (3F,) that groups equal edges."""
    directed = np.concatenate([facets[:, [0, 1]], facets[:, [1, 2]], facets[:, [2, 0]]])
    owner = np.tile(np.arange(len(facets)), 3)
    key = directed.min(axis=1) * vertex_count + directed.max(axis=1)
    return directed, owner, np.lexsort((owner, key))


def edge_groups(directed: np.ndarray, order: Values) -> tuple[np.ndarray, np.ndarray]:
    """Where each of E edges begins in the order of `directed_edges`, and how many facets it has.

    Returns:
      Indices in `order` (E,), and numbers of facets (E,).
    """
    low = np.sort(directed[order], axis=1)
    starts = np.flatnonzero(np.r_[True, (low[1:] != low[:-1]).any(axis=1)])
    return starts, np.diff(np.r_[starts, len(low)])


def six_volumes(vertices: np.ndarray, facets: np.ndarray) -> Values:
    """Six times the signed volumes (F,) of the tetrahedra from the mean vertex to each facet."""
    a, b, c = np.moveaxis(vertices[facets] - vertices.mean(axis=0), 1, 0)
    return (a * np.cross(b, c)).sum(axis=1)


def area_vectors(vertices: np.ndarray, facets: np.ndarray) -> Vectors3:
    """Normals (F, 3) of the facets, each twice as long as its facet's area."""
    a, b, c = np.moveaxis(vertices[facets], 1, 0)
    return np.cross(b - a, c - a)


def areas(vertices: np.ndarray, facets: np.ndarray) -> Values:
    """Areas (F,) of the facets."""
    return 0.5 * np.linalg.norm(area_vectors(vertices, facets), axis=1)


def components(count: int, pairs: tuple[np.ndarray, np.ndarray]) -> tuple[int, np.ndarray]:
    """The number of sets into which pairs of indices join `count` things, and the set of each."""
    # Slow to import, and only new meshes need it.
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    links = coo_array((np.ones(len(pairs[0]), dtype=np.int8), pairs), shape=(count, count))
    return connected_components(links, directed=False)


def flat_facets(vertices: np.ndarray, facets: np.ndarray) -> np.ndarray:
    """Indices of the facets that have no area, relative to the size of the mesh."""
    scale = np.ptp(vertices, axis=0).max()
    return np.flatnonzero(2.0 * areas(vertices, facets) <= FLAT * scale**2)


def smallest_angles(vertices: np.ndarray, facets: np.ndarray) -> Values:
    """The smallest angle (F,) of each facet in degrees; 0 for one without area."""
    corners = vertices[facets]
    sides = np.roll(corners, -1, axis=1) - corners
    # The angles from both products, because an arc cosine would lose the digits of small angles.
    into, out = -np.roll(sides, 1, axis=1), sides
    across = np.linalg.norm(np.cross(out, into), axis=2)
    return np.degrees(np.arctan2(across, np.einsum("fki,fki->fk", out, into)).min(axis=1))


def shell_labels(facets: np.ndarray, vertex_count: int) -> tuple[int, np.ndarray]:
    """The number of shells (sets of facets connected by edges) and the shell (F,) of each facet."""
    _, owner, order = directed_edges(facets, vertex_count)
    low = np.sort(facets[:, [[0, 1], [1, 2], [2, 0]]], axis=2).transpose(1, 0, 2).reshape(-1, 2)
    same = (low[order[1:]] == low[order[:-1]]).all(axis=1)
    return components(len(facets), (owner[order[:-1][same]], owner[order[1:][same]]))


def winding_number(vertices: np.ndarray, facets: np.ndarray, point: Vector3) -> float:
    """How often the facets wind around a point (3,): 1 inside a closed shell wound outwards.

    van Oosterom & Strackee, IEEE Trans. Biomed. Eng. 30 (1983) 125.
    """
    a, b, c = np.moveaxis(vertices[facets] - point, 1, 0)
    ra, rb, rc = (np.linalg.norm(corner, axis=1) for corner in (a, b, c))
    above = np.einsum("fi,fi->f", a, np.cross(b, c))
    below = ra * rb * rc
    for x, y, r in ((a, b, rc), (b, c, ra), (c, a, rb)):
        below = below + np.einsum("fi,fi->f", x, y) * r
    return float(np.arctan2(above, below).sum() / (2.0 * np.pi))


class Shells(NamedTuple):
    """The closed shells of a mesh, and how they lie in each other."""

    labels: Values
    """The shell (F,) of each facet."""
    volumes: Values
    """Volumes (S,) in m^3, negative of those that wind inwards."""
    depths: Values
    """How many others each shell (S,) lies in."""
    around: Values
    """The smallest of these (S,); -1: none."""

    @property
    def inside_out(self) -> np.ndarray:
        """Indices of those that wind the wrong way: a void's wall outwards, or another inwards."""
        return np.flatnonzero((self.volumes > 0.0) != (self.depths % 2 == 0))

    @property
    def unclear(self) -> np.ndarray:
        """Indices of those that wind as the one around them does: a void's wall never does."""
        return np.flatnonzero(
            (self.around >= 0) & ((self.volumes > 0.0) == (self.volumes[self.around] > 0.0))
        )

    def share(self, shell: int) -> float:
        """The volume of a shell over that of the outermost one around it."""
        outer = shell
        while self.around[outer] >= 0:
            outer = int(self.around[outer])
        return float(abs(self.volumes[shell] / self.volumes[outer]))


def nested_shells(vertices: np.ndarray, facets: np.ndarray) -> Shells:
    """The shells of a closed mesh, each of which winds alike."""
    count, labels = shell_labels(facets, len(vertices))
    # Facets in the order of their shells: there may be thousands of each.
    order = np.argsort(labels, kind="stable")
    parts = np.split(facets[order], np.cumsum(np.bincount(labels, minlength=count))[:-1])
    volumes = np.array([six_volumes(vertices, part).sum() / 6.0 for part in parts])
    lows = np.array([vertices[part].min(axis=(0, 1)) for part in parts])
    highs = np.array([vertices[part].max(axis=(0, 1)) for part in parts])
    depths, around = np.zeros(count, dtype=int), np.full(count, -1)
    for k, part in enumerate(parts):
        others = ((lows <= lows[k]) & (highs >= highs[k])).all(axis=1)
        others[k] = False
        outer = [j for j in np.flatnonzero(others) if _contains(vertices, parts[j], part)]
        depths[k] = len(outer)
        if outer:
            around[k] = min(outer, key=lambda j: abs(volumes[j]))
    return Shells(labels, volumes, depths, around)


def _contains(vertices: np.ndarray, outer: np.ndarray, inner: np.ndarray) -> bool:
    """Whether one closed shell contains another, by the outermost and some vertices of that."""
    used = np.unique(inner)
    points = vertices[used]
    outermost = np.concatenate([points.argmin(axis=0), points.argmax(axis=0)])
    sample = np.unique(np.r_[outermost, np.arange(0, len(used), len(used) // 20 + 1)])
    low, high = vertices[outer].min(axis=(0, 1)), vertices[outer].max(axis=(0, 1))
    if (points.min(axis=0) < low).any() or (points.max(axis=0) > high).any():
        return False
    return all(abs(winding_number(vertices, outer, points[k])) > 0.5 for k in sample)


def find_defects(vertices: Vectors3, facets: Vectors3) -> list[Defect]:
    """All defects because of which vertices (V, 3) and facets (F, 3) do not bound a body.

    The mesh must be closed: every edge is shared by two facets that run along it in opposite
    directions. No facet may be without area. Each shell must wind outwards (the wall of a void:
    inwards), and the volume must not be zero. If a defect makes the other checks meaningless, it
    is the only one reported.

    `self_intersections` finds facets that cut each other, which takes longer.
    """
    if vertices.ndim != 2 or vertices.shape[1] != 3 or facets.ndim != 2 or facets.shape[1] != 3:
        shapes = f"{vertices.shape} and {facets.shape}"
        return [_defect("shape", f": vertices must be (V, 3) and facets (F, 3), got {shapes}")]
    bad = np.flatnonzero(~np.isfinite(vertices).all(axis=1))
    if bad.size:
        return [_defect("not finite", f": vertex {bad[0]} is {vertices[bad[0]]}, not finite", bad)]
    bad = np.flatnonzero(((facets < 0) | (facets >= len(vertices))).any(axis=1))
    if bad.size:
        text = ": its facets name vertices, but it has none"
        if len(vertices):
            there = f"0…{len(vertices) - 1}"
            text = f": a facet names a vertex outside {there}, the first is facet {bad[0]}"
        return [_defect("no such vertex", text, bad)]
    if len(facets) < 4:
        text = f" has {len(facets)} facets; a closed body has at least 4"
        return [_defect("too few facets", text)]
    found = []
    unique, index = np.unique(vertices, axis=0, return_index=True)
    if len(unique) < len(vertices):
        twins = np.setdiff1d(np.arange(len(vertices)), index)
        text = (
            f": {twins.size} duplicate vertices (the first is vertex {twins[0]}); weld them so "
            "that neighbouring facets share vertices"
        )
        found.append(_defect("duplicate vertices", text, twins))
    flat = flat_facets(vertices, facets)
    if flat.size:
        text = f": {flat.size} facets have no area, the first is facet {flat[0]}"
        found.append(_defect("no area", text, flat))
    found += _edge_defects(vertices, facets)
    return found or _volume_defects(vertices, facets)


def _edge_defects(vertices: np.ndarray, facets: np.ndarray) -> list[Defect]:
    directed, owner, order = directed_edges(facets, len(vertices))
    starts, counts = edge_groups(directed, order)
    found = []
    holes = owner[order[starts[counts == 1]]]
    if holes.size:
        text = (
            f" has holes: {holes.size} edges belong to one facet only, the first at facet "
            f"{holes[0]}"
        )
        found.append(_defect("holes", text, holes))
    crowded = owner[order[starts[counts > 2]]]
    if crowded.size:
        text = (
            f": {crowded.size} edges belong to more than two facets, the first at facet "
            f"{crowded[0]}"
        )
        found.append(_defect("crowded edges", text, crowded))
    pairs = starts[counts == 2]
    same = pairs[(directed[order[pairs]] == directed[order[pairs + 1]]).all(axis=1)]
    if same.size:
        first, second = owner[order[same[0]]], owner[order[same[0] + 1]]
        text = (
            f": mixed winding: facets {first} and {second} run along their common edge in the same "
            f"direction ({same.size} such edges)"
        )
        found.append(_defect("mixed winding", text, owner[order[same]]))
    return found


def _volume_defects(vertices: np.ndarray, facets: np.ndarray) -> list[Defect]:
    """The defects of a closed, consistently wound mesh."""
    scale = float(np.ptp(vertices, axis=0).max())
    volume = float(six_volumes(vertices, facets).sum()) / 6.0
    if abs(volume) <= _NO_VOLUME * scale**3:
        return [_defect("no volume", f" encloses no volume ({volume:.3g} m^3)")]
    shells = nested_shells(vertices, facets)
    unclear, wrong = shells.unclear, shells.inside_out
    if unclear.size:
        where = np.flatnonzero(np.isin(shells.labels, unclear))
        text = (
            f": {unclear.size} of {len(shells.volumes)} shells lie in another and wind as that "
            f"does, the first at facet {where[0]} ({100 * shells.share(int(unclear[0])):.3g} % of "
            "the volume); each is either the wall of a void, then reverse its facets, or rock "
            "that is there already, such as a second copy, then delete it: the mesh does not say "
            "which"
        )
        return [_defect("shell in shell", text, where)]
    if not wrong.size:
        return []
    where = np.flatnonzero(np.isin(shells.labels, wrong))
    if len(wrong) == len(shells.volumes):
        text = (
            f" is inside out: its facets wind inwards (volume {volume:.3g} m^3); reverse "
            "the vertex order of every facet"
        )
    else:
        text = (
            f": {len(wrong)} of {len(shells.volumes)} shells are inside out, the first at facet "
            f"{where[0]}"
        )
    return [_defect("inside out", text, where)]


def _defect(kind: str, text: str, where: np.ndarray | None = None) -> Defect:
    return Defect(kind, text, np.empty(0, dtype=int) if where is None else np.unique(where))
