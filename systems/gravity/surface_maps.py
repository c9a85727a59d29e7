"""The effective field of a spinning body, at rest in K: over its surface and on a plane.

The effective field is gravity plus the centrifugal acceleration. Everything is in the body-fixed
frame K: its origin is the centre of mass and z is the spin axis. The shape of the `GravityField`
must be in K (`Polyhedron.recentred`).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from proxops.systems.common import InputError, Values, Vectors3
from proxops.systems.gravity.gravity_field import BodyField, Gravity

AXES = {"x": 0, "y": 1, "z": 2}


class EffectiveField(NamedTuple):
    """Gravity and centrifugal acceleration together, at N points at rest in K."""

    potential: Values
    """(N,) in m^2/s^2: V = -U - w^2 (x^2 + y^2) / 2, so that v^2/2 + V is Jacobi's constant."""
    acceleration: Vectors3
    """(N, 3) in m/s^2: -grad V."""
    gradient: np.ndarray
    """(N, 3, 3) in 1/s^2: the derivative of the acceleration by position, symmetric."""
    inside: Values
    """(N,) bool: within the body."""


class SurfaceMap(NamedTuple):
    """The effective field at the centroids of the F facets."""

    centroids: Vectors3
    """(F, 3) in m."""
    gravity: Values
    """(F,) in m/s^2: magnitude of the body's attraction alone."""
    acceleration: Vectors3
    """(F, 3) in m/s^2: attraction and centrifugal acceleration, the direction of a plumb line."""
    slope: Values
    """(F,) in rad, from 0 to pi: angle between the plumb line and the facet's inward normal.

    A stone slides where the slope exceeds its angle of friction, and lifts off above pi / 2."""
    potential: Values
    """(F,) in m^2/s^2: the effective potential V of `EffectiveField`."""


class PlaneCut(NamedTuple):
    """The effective field on a grid of M x N points of a coordinate plane of K."""

    plane: str
    """The axes of the columns and of the rows, for instance "xy"."""
    offset: float
    """Coordinate in m along the third axis."""
    across: Values
    """(N,) in m: coordinate of the columns."""
    up: Values
    """(M,) in m: coordinate of the rows."""
    potential: np.ndarray
    """(M, N) in m^2/s^2: V of `EffectiveField`."""
    acceleration: np.ndarray
    """(M, N, 3) in m/s^2: -grad V."""
    inside: np.ndarray
    """(M, N) bool: within the body."""


def effective_field(field: BodyField, spin: float, points: Vectors3) -> EffectiveField:
    """The effective field at points (N, 3) in m in K of a body that spins at `spin` rad/s about z.

    The axis goes through the centre of mass. Scheeres, Orbital Motion in Strongly Perturbed
    Environments (2012), ch. 2, with the sign of U as in `Gravity`: positive.
    """
    return _effective(field.evaluate(points), field, spin, points)


def _effective(
    gravity: Gravity, field: BodyField, spin: float, points: np.ndarray
) -> EffectiveField:
    """Adds the centrifugal part to gravity at points."""
    centrifugal = spin**2 * np.array([1.0, 1.0, 0.0])
    points = np.asarray(points, dtype=np.float64) - field.centre_of_mass
    return EffectiveField(
        potential=-gravity.potential - 0.5 * (points**2 @ centrifugal),
        acceleration=gravity.acceleration + points * centrifugal,
        gradient=gravity.gradient + np.diag(centrifugal),
        inside=gravity.inside,
    )


def surface_map(field: BodyField, spin: float) -> SurfaceMap:
    """Gravity, slope and effective potential over the facets of the field's own shape.

    Args:
      spin: of the body in rad/s about z.
    """
    shape = field.shape
    centroids = shape.vertices[shape.facets].mean(axis=1)
    attraction = field.evaluate(centroids)
    effective = _effective(attraction, field, spin, centroids)
    # The angle from both products, because an arc cosine would lose the digits of small slopes.
    along = -np.einsum("fi,fi->f", effective.acceleration, shape.normals)
    across = np.linalg.norm(np.cross(effective.acceleration, shape.normals), axis=1)
    return SurfaceMap(
        centroids=centroids,
        gravity=np.linalg.norm(attraction.acceleration, axis=1),
        acceleration=effective.acceleration,
        slope=np.arctan2(across, along),
        potential=effective.potential,
    )


def plane_cut(
    field: BodyField,
    spin: float,
    half_width: float,
    plane: str = "xy",
    count: int = 161,
    offset: float = 0.0,
) -> PlaneCut:
    """The effective field on a square grid in a plane parallel to two axes of K.

    Args:
      spin: of the body in rad/s about z.
      half_width: half the width of the square about the third axis, in m.
      plane: the two axes, for instance "xy": the first across, the second up.
      count: number of points on each side.
      offset: coordinate of the plane along the third axis, in m.

    Raises:
      InputError: the plane is not two different axes.
    """
    if len(plane) != 2 or len(set(plane)) != 2 or not set(plane) <= set(AXES):
        raise InputError(f"a plane is two of x, y and z, for instance xy; got {plane!r}")
    line = np.linspace(-half_width, half_width, count)
    points = np.full((count, count, 3), float(offset))
    points[..., AXES[plane[0]]] = line[None, :]
    points[..., AXES[plane[1]]] = line[:, None]
    effective = effective_field(field, spin, points.reshape(-1, 3))
    square = (count, count)
    return PlaneCut(
        plane=plane,
        offset=float(offset),
        across=line,
        up=line.copy(),
        potential=effective.potential.reshape(square),
        acceleration=effective.acceleration.reshape(*square, 3),
        inside=effective.inside.reshape(square),
    )
