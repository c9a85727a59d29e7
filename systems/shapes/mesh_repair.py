"""Repair of a mesh so that it bounds a body, with a report of what was done."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
import scipy  # Its parts are imported when they are used.

from proxops.systems.common import InputError, Vector3, Vectors3
from proxops.systems.shapes._hole_filling import boundary_loops, triangulate_loop
from proxops.systems.shapes.mass import mass_properties
from proxops.systems.shapes.mesh_checks import (
    areas,
    components,
    directed_edges,
    edge_groups,
    find_defects,
    flat_facets,
    nested_shells,
    shell_labels,
    six_volumes,
)
from proxops.systems.shapes.self_intersection import self_intersections

# Vertices nearer to each other than this share of the body's length, about the resolution of single
# precision, are one vertex.
WELD = 1e-6
# The patch over a hole may have this share of the mesh's area.
LARGEST_HOLE = 0.1
# Where lobes are joined, edges shorter than this share of the median one are collapsed.
_SHORT = 0.5


class Size(NamedTuple):
    """What a repair must not change unsaid."""

    volume: float
    """m^3, as its facets stand: signed tetrahedra."""
    area: float
    """m^2."""
    extents: Vector3
    """Lengths (3,) in m of the box around its facets."""


@dataclass
class Repair:
    """A mesh under repair and the actions so far."""

    vertices: Vectors3
    """(V, 3) in m."""
    facets: Vectors3
    """(F, 3)."""
    actions: list[str] = field(default_factory=list)
    """One sentence for each action; empty if nothing had to be done."""

    before: Size = field(init=False)
    """Its size before the repair."""

    def __post_init__(self) -> None:
        self.before = self.size

    @property
    def size(self) -> Size:
        """Volume, area and extents as they are now."""
        return Size(
            volume=float(six_volumes(self.vertices, self.facets).sum() / 6.0),
            area=float(areas(self.vertices, self.facets).sum()),
            extents=np.ptp(self.vertices[self.facets].reshape(-1, 3), axis=0),
        )


def repair_mesh(
    vertices: Vectors3, facets: Vectors3, *, align: bool = False, flip: bool = False
) -> Repair:
    """Repairs vertices (V, 3) and facets (F, 3) so that they bound a body.

    The steps, in this order:

    1. Vertices that coincide are welded.
    2. Facets that name a vertex twice and copies of facets are dropped. Of facets that stand front
       and back one stays, if the mesh is not closed without them; else they are an inner wall or a
       sheet, and both are dropped.
    3. Neighbouring facets are made to wind the same way.
    4. Facets without neighbours are dropped.
    5. Small holes are filled.
    6. Facets without area are removed by flipping their long edge.
    7. Shells are turned outwards, and the walls of voids inwards.
    8. Shells that overlap, such as the lobes of a contact binary, are joined. Short edges where
       they meet are collapsed, for an error of the surface would fold the slivers there.
    9. Unused vertices are dropped.
    10. The centre of mass is moved to the origin. With `align`, the axes of least and greatest
        moment of inertia are turned onto x and z. With `flip`, the body is turned half a turn about
        x: then one that spins about -z spins about +z.

    Raises:
      InputError: the mesh cannot be mended; the message gives the reason. What the mesh does not
        say, such as whether a shell in another is a void or a copy, is not guessed.
    """
    broken = find_defects(vertices, facets)[:1]
    if broken and broken[0].kind in ("shape", "too few facets", "not finite", "no such vertex"):
        raise InputError(f"{broken[0].about()}; that cannot be mended")
    mesh = Repair(np.array(vertices, dtype=float), np.array(facets, dtype=np.int64))
    _weld(mesh)
    _drop_facets(mesh)
    rims = _rims(mesh)
    _drop_doubles(mesh)
    _wind_alike(mesh)
    _drop_loose_facets(mesh)
    _fill_holes(mesh, rims)
    _flip_flat_facets(mesh)
    _turn_shells(mesh)
    _drop_vertices(mesh)
    cuts = _cuts(mesh)
    if len(cuts) and _join_shells(mesh, cuts):
        cuts = _cuts(mesh)
        _collapse_short_edges(mesh)
        _drop_vertices(mesh)
    if len(cuts):
        raise InputError(
            f"the mesh cannot be mended: {len(cuts)} pairs of facets cut each other, the first "
            f"facets {cuts[0, 0]} and {cuts[0, 1]} of what was mended so far"
        )
    _place(mesh, align, flip)
    return mesh


def _weld(mesh: Repair) -> None:
    reach = WELD * np.ptp(mesh.vertices, axis=0).max()
    pairs = scipy.spatial.KDTree(mesh.vertices).query_pairs(reach, output_type="ndarray")
    if not len(pairs):
        return
    count = len(mesh.vertices)
    _, label = components(count, tuple(pairs.T))
    _, first, place = np.unique(label, return_index=True, return_inverse=True)
    # Each group becomes its first vertex, unmoved.
    distance = np.linalg.norm(mesh.vertices - mesh.vertices[first[place]], axis=1).max()
    rank = np.argsort(np.argsort(first))[place]
    first = np.sort(first)
    mesh.vertices, mesh.facets = mesh.vertices[first], rank[mesh.facets]
    gone = count - len(first)
    mesh.actions.append(f"welded {gone} vertices onto others at most {distance:.3g} m away")


def _drop_facets(mesh: Repair) -> None:
    a, b, c = mesh.facets.T
    thrice = (a != b) & (b != c) & (c != a)
    if not thrice.all():
        mesh.facets = mesh.facets[thrice]
        mesh.actions.append(f"dropped {np.sum(~thrice)} facets that named a vertex twice")


def _drop_doubles(mesh: Repair) -> None:
    """Leaves the first of the facets with the same vertices, or none of an inner wall."""
    # With the least vertex first, a facet winds up or down by which of the others comes next.
    start = np.argmin(mesh.facets, axis=1)[:, None]
    turned = np.take_along_axis(mesh.facets, (start + np.arange(3)) % 3, axis=1)
    up = turned[:, 1] < turned[:, 2]
    _, first, place = np.unique(
        np.sort(turned, axis=1), axis=0, return_index=True, return_inverse=True
    )
    place = place.reshape(-1)
    if len(first) == len(turned):
        return
    backs = up != up[first[place]]
    paired = np.bincount(place, backs) > 0
    # In the order of the file.
    order = np.argsort(first)
    kept, paired = first[order], paired[order]
    copies = len(turned) - len(first) - int(backs.sum())
    if copies:
        mesh.actions.append(f"dropped {copies} copies of facets")
    mesh.facets = mesh.facets[kept]
    walls = _inner_walls(mesh.facets, paired, len(mesh.vertices))
    fronts = int((paired & ~walls).sum())
    if fronts:
        mesh.actions.append(f"dropped the backs of {fronts} facets that stood front and back")
    if walls.any():
        mesh.facets = mesh.facets[~walls]
        mesh.actions.append(f"dropped {walls.sum()} pairs of facets back to back")


def _inner_walls(facets: np.ndarray, paired: np.ndarray, vertex_count: int) -> np.ndarray:
    """Which of the facets (F,) that stand front and back are not needed to close the mesh.

    At an edge with two other facets the mesh is closed without them; at one with one other facet it
    is not. Facets whose edges meet each other alone are decided together.

    Args:
      facets: (F, 3), each once.
      paired: (F,) whether a facet stands front and back.
      vertex_count: number of vertices.
    """
    directed, owner, order = directed_edges(facets, vertex_count)
    starts, counts = edge_groups(directed, order)
    edge = np.repeat(np.arange(len(starts)), counts)
    owner = owner[order]
    doubles = np.bincount(edge, paired[owner], len(starts)).astype(int)
    others = counts - doubles
    # Pairs of doubled facets at an edge, and how many others it has.
    at_two = np.flatnonzero(doubles == 2)
    members = owner[paired[owner] & (doubles[edge] == 2)].reshape(-1, 2)
    alike = members[others[at_two] == 0]
    count, group = components(len(facets), tuple(alike.T))
    needed, closed = np.zeros(count, dtype=bool), np.zeros(count, dtype=bool)
    needed[group[owner[paired[owner] & (doubles == 1)[edge] & (others == 1)[edge]]]] = True
    closed[group[owner[paired[owner] & (others >= 2)[edge]]]] = True
    # At an edge of two doubled facets and one other, one of the two is needed.
    one, two = group[members[others[at_two] == 1].T]
    while True:
        known = needed.sum() + closed.sum()
        for this, that in ((one, two), (two, one)):
            closed[that[needed[this]]] = True
            needed[that[closed[this] & ~needed[this]]] = True
        if needed.sum() + closed.sum() == known:
            break
    return paired & (closed & ~needed)[group]


def _rims(mesh: Repair) -> set[tuple[int, int]]:
    """The edges, lesser vertex first, that belong to one facet, whose copies do not count."""
    facets = np.unique(np.sort(mesh.facets, axis=1), axis=0)
    directed, _, order = directed_edges(facets, len(mesh.vertices))
    starts, counts = edge_groups(directed, order)
    return set(map(tuple, np.sort(directed[order[starts[counts == 1]]], axis=1).tolist()))


def _wind_alike(mesh: Repair) -> None:
    """Reverses facets that wind against the majority of their shell."""
    facets, count = mesh.facets, len(mesh.facets)
    directed, owner, order = directed_edges(facets, len(mesh.vertices))
    starts, counts = edge_groups(directed, order)
    shared = starts[counts == 2]
    first, second = order[shared], order[shared + 1]
    differ = (directed[first] == directed[second]).all(axis=1)
    if not differ.any():
        return
    # A graph of two copies of each facet, one of them reversed; links join neighbours' copies that
    # agree. Both copies of a facet are in one component exactly if a walk over the surface returns
    # reversed.
    one, other = owner[first], owner[second]
    rows = np.r_[one, one + count]
    columns = np.r_[np.where(differ, other + count, other), np.where(differ, other, other + count)]
    _, label = components(2 * count, (rows, columns))
    if (label[:count] == label[count:]).any():
        raise InputError("the mesh cannot be mended: it is one-sided, like a Möbius strip")
    # Each shell has two sets of copies. The one with fewer reversed facets is kept.
    kept = np.bincount(label[:count], minlength=label.max() + 1)
    turn = kept[label[:count]] < kept[label[count:]]
    tied = kept[label[:count]] == kept[label[count:]]
    turn |= tied & (label[:count] > label[count:])
    mesh.facets = np.where(turn[:, None], facets[:, ::-1], facets)
    mesh.actions.append(f"reversed {turn.sum()} facets that wound against their neighbours")


def _drop_loose_facets(mesh: Repair) -> None:
    """Drops facets without neighbours: their rims look like those of holes."""
    shells, label = shell_labels(mesh.facets, len(mesh.vertices))
    loose = np.bincount(label, minlength=shells)[label] == 1
    if loose.any():
        mesh.facets = mesh.facets[~loose]
        mesh.actions.append(f"dropped {loose.sum()} facets that shared no edge with another")


def _fill_holes(mesh: Repair, rims: set[tuple[int, int]]) -> None:
    """Fills holes of the file; `rims` are the edges of these."""
    total = areas(mesh.vertices, mesh.facets).sum()
    patches = []
    for loop in boundary_loops(mesh.facets, len(mesh.vertices)):
        rim = np.sort(np.stack([loop, np.roll(loop, -1)], axis=1), axis=1).tolist()
        if not rims.issuperset(map(tuple, rim)):
            raise InputError(
                f"the mesh cannot be mended: to drop facets that stand front and back would make a "
                f"hole at vertex {loop[0]}; which of them bound the body is not said"
            )
        patch = triangulate_loop(mesh.vertices, mesh.facets, loop)
        share = areas(mesh.vertices, patch).sum() / total
        if share > LARGEST_HOLE:
            raise InputError(
                f"the mesh cannot be mended: the hole at vertex {loop[0]} ({len(loop)} edges) is "
                f"{100 * share:.0f} % as large as the rest; at most {100 * LARGEST_HOLE:.0f} % is "
                "filled"
            )
        patches.append(patch)
    if patches:
        mesh.facets = np.concatenate([mesh.facets, *patches])
        added = sum(map(len, patches))
        share = areas(mesh.vertices, mesh.facets[-added:]).sum() / total
        mesh.actions.append(
            f"filled {len(patches)} holes with {added} facets ({100 * share:.2g} % of the area)"
        )


def _flip_flat_facets(mesh: Repair) -> None:
    """Removes facets without area: flips the long edge of each to its middle vertex."""
    flipped = 0
    for _ in range(100):
        before = flipped
        for facet in flat_facets(mesh.vertices, mesh.facets):
            flipped += _flip(mesh, int(facet))
        if flipped == before:
            break
    if flipped:
        mesh.actions.append(f"flipped the edges of {flipped} facets without area")


def _flip(mesh: Repair, facet: int) -> bool:
    """Whether the facet, m a b with m on the edge a b, and its neighbour b a p could be flipped."""
    corners = mesh.facets[facet]
    if not np.isin(facet, flat_facets(mesh.vertices, mesh.facets)):
        return False  # The flip of another facet has repaired it.
    sides = np.linalg.norm(mesh.vertices[np.roll(corners, -1)] - mesh.vertices[corners], axis=1)
    long = int(np.argmax(sides))
    a, b, m = np.roll(corners, -long)
    back = (mesh.facets == b) & (np.roll(mesh.facets, -1, axis=1) == a)
    found = np.argwhere(back)
    if len(found) != 1:
        return False
    neighbour, k = found[0]
    p = mesh.facets[neighbour, (k + 2) % 3]
    if (np.isin(mesh.facets, (m, p)).sum(axis=1) == 2).any():
        return False  # The new edge exists already.
    mesh.facets[facet], mesh.facets[neighbour] = (m, a, p), (b, m, p)
    return True


def _turn_shells(mesh: Repair) -> None:
    if len(flat_facets(mesh.vertices, mesh.facets)) == len(mesh.facets):
        return  # Nothing has an inside.
    shells = nested_shells(mesh.vertices, mesh.facets)
    wrong = shells.inside_out
    # What is unclear is left for `find_defects` to tell of.
    if wrong.size and not shells.unclear.size:
        turn = np.isin(shells.labels, wrong)
        mesh.facets = np.where(turn[:, None], mesh.facets[:, ::-1], mesh.facets)
        mesh.actions.append(
            f"turned {len(wrong)} of {len(shells.volumes)} shells: {turn.sum()} facets wound the "
            "wrong way"
        )


def _cuts(mesh: Repair) -> np.ndarray:
    """Pairs (N, 2) of facets that cut each other in a mesh without other defects.

    Raises:
      InputError: it has others.
    """
    left = find_defects(mesh.vertices, mesh.facets)
    if left:
        what = "; ".join(defect.about() for defect in left)
        raise InputError(f"the mesh cannot be mended: after all that can be done, {what}")
    return self_intersections(mesh.vertices, mesh.facets)


def _join_shells(mesh: Repair, cuts: np.ndarray) -> bool:
    """Joins bodies that overlap; false if one of them cuts itself or has a void."""
    count, labels = shell_labels(mesh.facets, len(mesh.vertices))
    six = np.bincount(labels, six_volumes(mesh.vertices, mesh.facets), count)
    if (labels[cuts[:, 0]] == labels[cuts[:, 1]]).any() or (six < 0.0).any():
        return False
    before = six.sum() / 6.0
    parts = [(mesh.vertices, mesh.facets[labels == k]) for k in range(count)]
    mesh.vertices, mesh.facets = united(parts)
    twice = before - six_volumes(mesh.vertices, mesh.facets).sum() / 6.0
    mesh.actions.append(
        f"joined {count} shells that overlap: {100 * twice / before:.3g} % of their volumes were "
        "counted twice"
    )
    return True


def united(solids: Sequence[tuple[np.ndarray, np.ndarray]]) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (V, 3) and facets (F, 3) of what at least one of some closed meshes holds.

    Where meshes cut each other some facets may come out without area: their long edges are flipped.
    """
    import manifold3d  # Only here.

    parts = [
        manifold3d.Mesh64(np.array(vertices, order="C"), np.array(facets, dtype=np.uint64))
        for vertices, facets in solids
    ]
    joined = manifold3d.Manifold.batch_boolean(
        [manifold3d.Manifold(part) for part in parts], manifold3d.OpType.Add
    ).to_mesh64()
    mesh = Repair(
        np.array(joined.vert_properties[:, :3]), np.array(joined.tri_verts, dtype=np.int64)
    )
    _flip_flat_facets(mesh)
    return mesh.vertices, mesh.facets


def _collapse_short_edges(mesh: Repair) -> None:
    """Makes one vertex of the ends of each short edge, unless facets would cut each other then."""
    vertices, facets, count = mesh.vertices.copy(), mesh.facets, 0
    sides = np.linalg.norm(vertices[facets] - vertices[np.roll(facets, 1, axis=1)], axis=2)
    limit, collapsed = _SHORT * float(np.median(sides)), True
    while collapsed:
        edges = np.sort(facets[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
        edges = np.unique(edges, axis=0)
        lengths = np.linalg.norm(vertices[edges[:, 0]] - vertices[edges[:, 1]], axis=1)
        order, stays = np.argsort(lengths), np.arange(len(vertices))
        touched, collapsed = np.zeros(len(vertices), dtype=bool), False
        for a, b in edges[order[: np.count_nonzero(lengths < limit)]]:
            one, other = (np.unique(facets[(facets == end).any(axis=1)]) for end in (a, b))
            near = np.union1d(one, other)
            # Both ends and the two facets' other corners are common, or the surface would pinch.
            if len(np.intersect1d(one, other)) != 4 or touched[near].any():
                continue
            touched[near] = collapsed = True
            vertices[a], stays[b] = 0.5 * (vertices[a] + vertices[b]), a
            count += 1
        facets = stays[facets]
        facets = facets[(facets != np.roll(facets, 1, axis=1)).all(axis=1)]
    if count and not len(self_intersections(vertices, facets)):
        mesh.vertices, mesh.facets = vertices, facets
        mesh.actions.append(f"collapsed {count} short edges where they meet")


def _drop_vertices(mesh: Repair) -> None:
    used = np.unique(mesh.facets)
    unused = len(mesh.vertices) - len(used)
    if unused:
        mesh.facets = np.searchsorted(used, mesh.facets)
        mesh.vertices = mesh.vertices[used]
        mesh.actions.append(f"dropped {unused} vertices that no facet uses")


def _place(mesh: Repair, align: bool, flip: bool) -> None:
    properties = mass_properties(mesh.vertices, mesh.facets)
    size = np.ptp(mesh.vertices, axis=0).max()
    if np.linalg.norm(properties.centre_of_mass) > 1e-9 * size:
        mesh.vertices = mesh.vertices - properties.centre_of_mass
        x, y, z = -properties.centre_of_mass
        mesh.actions.append(f"moved by ({x:.6g}, {y:.6g}, {z:.6g}) m to the centre of mass")
    if align and not np.allclose(properties.principal_axes, np.eye(3), rtol=0.0, atol=1e-9):
        axes = properties.principal_axes
        mesh.vertices = mesh.vertices @ axes.T
        angle = np.degrees(np.arccos(np.clip((np.trace(axes) - 1.0) / 2.0, -1.0, 1.0)))
        mesh.actions.append(f"turned by {angle:.4g} degrees onto the principal axes")
    if flip:
        mesh.vertices = mesh.vertices * [1.0, -1.0, -1.0]
        mesh.actions.append("turned half a turn about x: what was -z is +z")
