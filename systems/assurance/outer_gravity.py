"""`OuterGravity`: gravity outside the keep-out ellipsoid, from a table, and its greatest sizes."""

from __future__ import annotations

import functools
from typing import NamedTuple

import numpy as np

from proxops.systems.assurance._braking_kernel import SURFACE
from proxops.systems.common import Matrix3, Vector3, spread_directions
from proxops.systems.gravity import (
    GRAVITATIONAL_CONSTANT,
    FieldTables,
    GravityField,
    TabulatedField,
)

# Of the table. It takes a thousandth of what gravity takes within a box of 10 %, and a table with a
# closer bound takes longer to make.
_RELATIVE_ERROR = 1e-4
# Number of directions in which the field is sampled, at these ellipsoidal norms |(x/a, y/b, z/c)|.
# The factor covers the gaps between the directions.
_DIRECTIONS = 2000
_LEVELS = (SURFACE, 1.1, 1.25, 1.5, 2.0, 3.0, 5.0, 10.0)
_GAPS = 1.05


class OuterGravity(NamedTuple):
    """A body's gravity outside an ellipsoid. `outer_gravity` makes one."""

    tables: FieldTables
    """What `proxops.systems.gravity.gravity_at` takes."""
    error: float
    """In m/s^2: the bound of the table's error outside the ellipsoid."""
    greatest: Vector3
    """(3,) in m/s^2: the greatest size of each component of the field outside the ellipsoid, as
    sampled: it may be up to 1 % more."""
    places: Matrix3
    """(3, 3) in m: where on the ellipsoid each component is greatest."""
    strongest: float
    """The greatest size of the field outside the ellipsoid, in m/s^2."""
    steepness: float
    """In 1/s^2: outside, at the level L, the spectral norm of the gradient is at most this over the
    cube of L."""


def outer_gravity(field: GravityField | TabulatedField, semi_axes: np.ndarray) -> OuterGravity:
    """Gravity outside the ellipsoid with semi-axes (3,) in m, which contains the body.

    A process samples each field once. The table is made once on a machine, in two seconds, from
    the exact field.

    Raises:
      InputError: the body sticks out of the ellipsoid.
    """
    exact = field.exact if isinstance(field, TabulatedField) else field
    return _sampled(exact, tuple(map(float, semi_axes)))


@functools.lru_cache(maxsize=4)
def _sampled(exact: GravityField, semi_axes: tuple[float, ...]) -> OuterGravity:
    axes = np.array(semi_axes)
    field = TabulatedField(exact, axes, _RELATIVE_ERROR)
    places = spread_directions(_DIRECTIONS) * axes
    # The components of gravity are harmonic, so each is greatest on the surface; and so is the norm
    # of the gradient.
    sampled = [field.evaluate(level * places) for level in _LEVELS]
    surface = sampled[0].acceleration
    sizes = np.abs(surface)
    strongest = _GAPS * float(np.linalg.norm(surface, axis=1).max())
    # Of a point mass, the field far away, along the shortest axis.
    steep = [2.0 * GRAVITATIONAL_CONSTANT * field.mass / axes.min() ** 3]
    for level, found in zip(_LEVELS, sampled, strict=True):
        steep.append(level**3 * float(np.abs(np.linalg.eigvalsh(found.gradient)).max()))
    return OuterGravity(
        tables=field.tables,
        error=_RELATIVE_ERROR * strongest,
        greatest=sizes.max(axis=0),
        places=places[sizes.argmax(axis=0)],
        strongest=strongest,
        steepness=_GAPS * max(steep),
    )
