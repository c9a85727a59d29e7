"""`displaced`: a body whose surface differs from its map by a smooth random field."""

from __future__ import annotations

import numpy as np

from proxops.systems.common import (
    InputError,
    Vector3,
    Vectors3,
    check_not_negative,
    check_positive,
    generator,
    one_thread,
)
from proxops.systems.shapes.mesh_checks import area_vectors, find_defects
from proxops.systems.shapes.polyhedron import Polyhedron
from proxops.systems.shapes.self_intersection import self_intersections
from proxops.systems.shapes.surface import Surface

# Waves in a random field. Over seeds the covariance is exact for any number; with this many, a
# single field is close to Gaussian.
_WAVES = 300
# Beyond this share of the body's length nothing is left of its form, and looking for facets that
# cross would take long.
_MOST = 0.25
# Below this share of the shortest edge no facets can fold over, and no two sheets of a map are so
# close that they could meet: looking for facets that cross would take half of the time.
_GENTLE = 0.1


def displaced(shape: Polyhedron, rms: float, correlation: float, seed: int) -> Polyhedron:
    """The shape with every vertex moved along its normal by a smooth random field.

    The result lies in the frame as a survey registers it: the translation and the small rotation
    that fit the displacement best (point to plane, weighted by area) are taken out. What is left
    is scaled to `rms`. So its covariance is that of `random_field` but for these six motions.

    Args:
      shape: the map.
      rms: root mean square of the displacement over the surface, in m; 0 gives the shape itself.
      correlation: correlation length of the field in m.
      seed: of the field; the same seed gives the same mesh.

    Raises:
      InputError: rms is negative, the correlation is not positive, or the mesh is not sound after
        the displacement (facets turn over or cut each other).
    """
    if rms == 0.0:
        return shape
    vertices = _moved(shape, rms, correlation, seed)
    _check_sound(shape, vertices, rms, correlation)
    return Polyhedron(vertices, shape.facets, shape.name)


def roughened(shape: Polyhedron, rms: float, correlation: float, seed: int) -> Polyhedron:
    """`displaced`, but with facets that may cross, which gravity does not mind."""
    return Polyhedron(_moved(shape, rms, correlation, seed), shape.facets, shape.name)


def _moved(shape: Polyhedron, rms: float, correlation: float, seed: int) -> Vectors3:
    """The vertices (V, 3) of `displaced`."""
    check_not_negative("a displaced surface", rms=rms)
    check_positive("a displaced surface", correlation=correlation)
    normals, weights = vertex_normals(shape)
    with one_thread():
        field = random_field(shape.vertices, correlation, seed)
        heights = field - _rigid_heights(shape, normals, weights, field)
        heights *= rms / np.sqrt(weights @ heights**2 / weights.sum())
    return shape.vertices + heights[:, None] * normals


def random_field(points: Vectors3, correlation: float, seed: int) -> np.ndarray:
    """A random field (N,) of variance 1 at points (N, 3), with covariance exp(-d^2 / (2 l^2)).

    It is a sum of waves of random direction, length and phase: Rahimi & Recht, Random features for
    large-scale kernel machines, NIPS 2007.

    Args:
      points: in m. correlation: l in m. seed: of the waves.
    """
    rng = generator(seed, 0)
    waves = rng.normal(size=(3, _WAVES)) / correlation
    phases = rng.uniform(0.0, 2.0 * np.pi, _WAVES)
    return np.sqrt(2.0 / _WAVES) * np.cos(points @ waves + phases).sum(axis=1)


def vertex_normals(shape: Polyhedron | Surface) -> tuple[np.ndarray, np.ndarray]:
    """Unit normals (V, 3) of the vertices, weighted by area, and a third of the areas around them.

    A vertex of no facet keeps a normal of 0, and so its place.
    """
    doubled = np.repeat(area_vectors(shape.vertices, shape.facets), 3, axis=0)
    corners, count = shape.facets.ravel(), len(shape.vertices)
    sums = np.stack([np.bincount(corners, column, count) for column in doubled.T], axis=1)
    weights = np.bincount(corners, np.linalg.norm(doubled, axis=1) / 6.0, count)
    length = np.linalg.norm(sums, axis=1, keepdims=True)
    return sums / np.where(length > 0.0, length, 1.0), weights


def rigid_motions(points: Vectors3, normals: Vectors3, middle: Vector3, size: float) -> np.ndarray:
    """Heights (N, 6) along the normals at points (N, 3) by moves and small turns about a middle.

    Turns are those by which a point at the distance `size` moves by 1.
    """
    return np.hstack([normals, np.cross((points - middle) / size, normals)])


def _rigid_heights(
    shape: Polyhedron, normals: np.ndarray, weights: np.ndarray, heights: np.ndarray
) -> np.ndarray:
    """The part (V,) of the heights that a rigid motion of the whole body explains best."""
    motions = rigid_motions(shape.vertices, normals, shape.centre_of_mass, shape.extents.max())
    root = np.sqrt(weights)
    # A ball has no rotation that moves its surface: least squares of least norm takes none then.
    fit, *_ = np.linalg.lstsq(motions * root[:, None], heights * root)
    return motions @ fit


def _check_sound(shape: Polyhedron, vertices: np.ndarray, rms: float, correlation: float) -> None:
    what, moved = "", np.linalg.norm(vertices - shape.vertices, axis=1).max()
    ends = shape.vertices[shape.edges[0]]
    if moved <= _GENTLE * np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1).min():
        return
    if moved > _MOST * shape.extents.max():
        what = "vertices far from where they were"
    elif defects := find_defects(vertices, shape.facets):
        what = defects[0].kind
    # Some maps cut themselves a little; the displacement is not to blame for that.
    elif len(self_intersections(vertices, shape.facets)):
        what = "" if len(self_intersections(shape.vertices, shape.facets)) else "facets that cross"
    if what:
        raise InputError(
            f"{shape.name} displaced by {rms:.6g} m rms with a correlation length of "
            f"{correlation:.6g} m has a defect ({what}); take a smaller rms or a greater "
            "correlation length"
        )
