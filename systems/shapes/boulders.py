"""Boulders and craters: relief that a map has not, by the laws of sizes that are published."""

from __future__ import annotations

import numpy as np
import scipy  # Its parts are imported when they are used.

from proxops.systems.common import (
    FAR,
    InputError,
    Values,
    Vector3,
    config,
    generator,
    number,
    one_thread,
    vector,
)
from proxops.systems.shapes.displacement import vertex_normals
from proxops.systems.shapes.mesh_repair import united
from proxops.systems.shapes.polyhedron import Polyhedron
from proxops.systems.shapes.ray_casting import ray_caster

HEIGHT, DEPTH = 0.4, 0.1
"""Height of a boulder and depth of a crater, over its width: judgement. Boulders of Ryugu are some
0.4 times as high as long, and buried in part (Michikami et al. 2019, Icarus 331, 179)."""
# A form is this many edges of the mesh wide, at least; and the most facets of a mesh.
_EDGES, _MOST_FACETS = 2.0, 100_000
_MOST_FORMS = 1_000_000
# How often an icosahedron is divided to stand for a ball: 320 facets.
_BALL = 2
# The correlation length over the width: half of a form's height is left there.
_LIKE = 0.35


@config
class BouldersConfig:
    """Boulders and craters on the true surface. As many are wider than d as (d / widest) ^ -index.

    No map has them, and gravity is that of the surface without them.
    """

    # The widest boulder; 0: there are none.
    widest_m: float = number(0.0, at_least=0.0, at_most=FAR, unit="m")
    # Minus the exponent of their number: 2.65 at Ryugu (Michikami et al. 2019), 2.9 at Bennu
    # (DellaGiustina et al. 2019), 3.1 at Itokawa (Michikami et al. 2008).
    index: float = number(2.65, at_least=0.5, at_most=6.0)
    # The widest crater, and the exponent of their number; 0: there are none.
    crater_widest_m: float = number(0.0, at_least=0.0, at_most=FAR, unit="m")
    crater_index: float = number(2.0, at_least=0.5, at_most=6.0)
    # Narrower ones are left out.
    narrowest_m: float = number(3e3, at_least=1e-3, at_most=FAR, unit="m")
    # Of the places.
    seed: int = number(0, at_least=0, at_most=2**53 - 1)
    # One more boulder, a ball of this width; 0: there is none. It lies on the surface in the
    # direction of a position, as seen from the origin of K, and may be narrower than a facet. The
    # origin itself stands for a touch-and-go's site: the boulder is within half its width of it, as
    # drawn from the transit.
    lone_m: float = number(0.0, at_least=0.0, at_most=FAR, unit="m")
    lone_at_m: list[float] = vector([0.0, 0.0, 0.0], at_least=-FAR, at_most=FAR, unit="m")


def widths(widest: float, narrowest: float, index: float) -> Values:
    """Widths (N,) in m: of them, as many are wider than d as (d / widest) ^ -index.

    Raises:
      InputError: they are more than a million.
    """
    if widest < narrowest:
        return np.zeros(0)
    count = (widest / narrowest) ** index
    if count > _MOST_FORMS:
        raise InputError(
            f"truth.boulders: {count:.3g} boulders or craters are between {narrowest:g} and "
            f"{widest:g} m wide: take a greater narrowest_m, or less wide ones"
        )
    return widest * np.arange(1, int(count) + 1) ** (-1.0 / index)


def relief_of(boulders: BouldersConfig, shape: Polyhedron) -> tuple[float, float]:
    """How high boulders and craters are on a surface, as a random field.

    Each is a paraboloid, whose mean square is a third of the square of its height.

    Args:
      boulders: their numbers and sizes. shape: whose surface has them.

    Returns:
      Root mean square of the heights and their correlation length, in m; zeros if there are none.
    """
    some = [
        (widths(boulders.widest_m, boulders.narrowest_m, boulders.index), HEIGHT),
        (widths(boulders.crater_widest_m, boulders.narrowest_m, boulders.crater_index), DEPTH),
    ]
    wide = np.concatenate([each for each, _ in some])
    if not wide.size:
        return 0.0, 0.0
    high = np.concatenate([height * each for each, height in some])
    area = float(vertex_normals(shape)[1].sum())
    squares = high**2 / 3.0 * np.pi / 4.0 * wide**2
    return float(np.sqrt(squares.sum() / area)), float(_LIKE * (squares @ wide) / squares.sum())


@one_thread()
def with_boulders(shape: Polyhedron, boulders: BouldersConfig) -> Polyhedron:
    """The shape with finer facets, and boulders and craters at random places on them.

    Their mean height is 0: the map is the mean surface.

    Raises:
      InputError: they are too narrow for a mesh, too many, or wider than the body.
    """
    widest, size = max(boulders.widest_m, boulders.crater_widest_m), float(shape.extents.max())
    if widest > size:
        raise InputError(
            f"truth.boulders: {widest:g} m is wider than {shape.name}, which measures {size:.3g} m"
        )
    fine = _finer(shape, boulders.narrowest_m / _EDGES)
    normals, weights = vertex_normals(fine)
    rng, tree = generator(boulders.seed, 0), scipy.spatial.KDTree(fine.vertices)
    heights = np.zeros(len(weights))
    for widest, index, height in (
        (boulders.crater_widest_m, boulders.crater_index, -DEPTH),
        (boulders.widest_m, boulders.index, HEIGHT),
    ):
        wide = widths(widest, boulders.narrowest_m, index)
        places = fine.vertices[rng.choice(len(weights), wide.size, p=weights / weights.sum())]
        for width, place in zip(wide, places, strict=True):
            near = np.array(tree.query_ball_point(place, 0.5 * width))
            away = np.linalg.norm(fine.vertices[near] - place, axis=1) / (0.5 * width)
            own = height * width * (1.0 - away**2)
            # Of two at one place the greater one is seen.
            heights[near] = np.where(np.abs(own) > np.abs(heights[near]), own, heights[near])
    heights -= weights @ heights / weights.sum()
    return Polyhedron(fine.vertices + heights[:, None] * normals, fine.facets, shape.name)


def with_lone_boulder(shape: Polyhedron, width: float, towards: Vector3) -> Polyhedron:
    """The shape with a ball on it, which sticks out by `HEIGHT` of its width.

    Args:
      shape: of the surface. width: of the ball in m.
      towards: (3,) in m: it lies on the outermost surface in this direction from the origin.

    Raises:
      InputError: there is no direction, or no surface in it.
    """
    import trimesh  # It is slow to import, so only when it is needed.

    length = float(np.linalg.norm(towards))
    out = np.asarray(towards) / (length or 1.0)
    far = 2.0 * float(np.linalg.norm(shape.vertices, axis=1).max())
    met = ray_caster(shape).first_hits((far * out)[None], -out[None])
    if not length or met.facets[0] < 0:
        raise InputError(f"truth.boulders.lone_at_m: {shape.name} has no surface in this direction")
    normal = shape.normals[met.facets[0]]
    middle = (far - met.distances[0]) * out + (HEIGHT - 0.5) * width * normal
    ball = trimesh.creation.icosphere(_BALL, 0.5 * width)
    parts = [(shape.vertices, shape.facets), (ball.vertices + middle, ball.faces)]
    return Polyhedron(*united(parts), shape.name)


def _finer(shape: Polyhedron, edge: float) -> Polyhedron:
    """The shape with its facets divided until they have edges of a length in m, in the mean."""
    mesh = shape.to_trimesh()
    while mesh.edges_unique_length.mean() > edge:
        if 4 * len(mesh.faces) > _MOST_FACETS:
            least = _EDGES * float(mesh.edges_unique_length.mean())
            raise InputError(
                f"truth.boulders.narrowest_m is too narrow for a mesh of {shape.name}: take at "
                f"least {least:.3g} m"
            )
        mesh = mesh.subdivide()
    return Polyhedron(np.array(mesh.vertices), np.array(mesh.faces), shape.name)
