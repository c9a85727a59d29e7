"""`TabulatedField`: a body's field outside an ellipsoid from a table, within a bound."""

from __future__ import annotations

import functools
import logging
from collections.abc import Iterable

import numpy as np

from proxops.systems.common import (
    InputError,
    Vectors3,
    checked_semi_axes,
    keep_arrays,
    kept_arrays,
    name_of,
)
from proxops.systems.gravity import _table_kernel as kernel
from proxops.systems.gravity._far_field import SWITCH, fit_masses
from proxops.systems.gravity._harmonic_boxes import DEGREE, Boxes, entries, make_boxes, recursion
from proxops.systems.gravity.gravity_field import Gravity, GravityField, as_points
from proxops.systems.shapes import Polyhedron, ellipsoidal_norms

# Of the files on disk, and their kind. Whoever changes how a table is made, or a last bit of the
# exact field, raises the format.
_FORMAT, _KIND = 2, "gravity"
# Below the first, rounding is no longer small against the bound.
_ERRORS = (1e-11, 1e-2)
FINE_MESH = 10_000
"""A mesh with more facets is fine: its exact field takes milliseconds."""
# The usual bound, that of a fine mesh, and the one from which the latter's table is made by
# quadrature.
_USUAL, _FINE_USUAL, _BY_QUADRATURE = 1e-9, 1e-6, 5e-7
_log = logging.getLogger(__name__)


class TabulatedField:
    """The field of a `GravityField`, from a table outside an ellipsoid and exact inside.

    Outside, the relative error of potential and acceleration is meant to be below `relative_error`:
    each box of an octree has a harmonic polynomial, and the octree is divided until the error at 20
    points of every box's surface is below half of that, which leaves a factor of two for what lies
    between the points. Acceleration
    and gradient are the derivatives of the potential that is returned, so a free flight keeps its
    energy. Outside a cube with an edge of 20 radii, the field is that of point masses.

    The table is made at the first use on a machine and kept in the user's cache folder. It depends
    on body, mass, contrast, semi-axes and bound alone. Of a mesh with more than 10,000 facets it is
    made by quadrature, if the bound permits.
    """

    def __init__(
        self, field: GravityField, semi_axes: np.ndarray, relative_error: float | None = None
    ) -> None:
        """Takes the exact field and the semi-axes (3,) in m of an ellipsoid about the origin.

        Args:
          field: of a body within the ellipsoid. semi_axes: along x, y, z.
          relative_error: the bound, from 1e-11 to 1e-2; None: 1e-9, and 1e-6 of a mesh with more
            than 10,000 facets.

        Raises:
          InputError: the body sticks out of the ellipsoid, or a value is out of range.
        """
        axes = checked_semi_axes("TabulatedField: the ellipsoid", semi_axes)
        low, high = _ERRORS
        relative_error = _bound(field.shape, relative_error)
        if not low <= relative_error <= high:
            raise InputError(
                f"TabulatedField: relative_error must be from {low:g} to {high:g}, "
                f"got {relative_error}"
            )
        farthest = float(ellipsoidal_norms(axes, field.shape.vertices).max())
        if farthest >= 1.0:
            raise InputError(
                f"TabulatedField: {field.shape.name} sticks out of the ellipsoid; semi-axes that "
                f"are {farthest:.3f} times as long would contain it"
            )
        self.exact = field
        """The field that the table was made from."""
        self.shape, self.mass, self.centre_of_mass = field.shape, field.mass, field.centre_of_mass
        half, masses = _far_masses(field)
        boxes = _boxes(field, tuple(axes.tolist()), float(relative_error), half)
        scales = np.zeros(1, dtype=kernel.SCALES).view(np.recarray)
        scales[0] = 1.0 / axes, half, DEGREE
        self.tables = kernel.FieldTables(*boxes, recursion(DEGREE), masses, scales[0])
        """What `proxops.systems.gravity.gravity_at` takes, in other compiled functions too."""

    @staticmethod
    def is_kept(
        field: GravityField, semi_axes: np.ndarray, relative_error: float | None = None
    ) -> bool:
        """Whether this machine has the table already, so that nobody waits for it.

        Args: as those of the constructor.
        """
        bound = _bound(field.shape, relative_error)
        return _kept_boxes(_name_of(field, semi_axes, bound)) is not None

    def evaluate(self, points: Vectors3) -> Gravity:
        """The field at points (N, 3) in m."""
        points = as_points(points)
        columns = np.empty((len(points), 14))
        missing = kernel.evaluate(points, self.tables, columns)
        inside = np.zeros(len(points), dtype=bool)
        gradient = columns[:, 4:13].reshape(-1, 3, 3)
        if missing:
            rest = np.isnan(columns[:, 0])
            columns[rest, 0], columns[rest, 1:4], gradient[rest], inside[rest] = (
                self.exact.evaluate(points[rest])
            )
        return Gravity(columns[:, 0], columns[:, 1:4], gradient, inside)


def _bound(shape: Polyhedron, error: float | None) -> float:
    if error is not None:
        return float(error)
    return _USUAL if len(shape.facets) <= FINE_MESH else _FINE_USUAL


def _name_of(field: GravityField, axes: Iterable[float], error: float) -> str:
    numbers = map(float, (field.mass, field.contrast, *axes, error))
    return name_of(_FORMAT, field.shape.sha256, *numbers)


# Flights of one process share the arrays; they are never written to. Runtime assurance has a second
# table of each body.
@functools.lru_cache(maxsize=4)
def _boxes(field: GravityField, axes: tuple[float, ...], error: float, half: float) -> Boxes:
    name = _name_of(field, axes, error)
    boxes = _kept_boxes(name)
    if boxes is None:
        fine = len(field.shape.facets) > FINE_MESH
        # A warning, as of all that somebody may wait for without knowing why.
        _log.warning(
            "making the gravity table of %s (once on this machine, up to %s)",
            field.shape.name,
            "three minutes" if fine else "a minute",
        )
        by_quadrature = fine and error >= _BY_QUADRATURE
        evaluate = field.outer_columns if by_quadrature else field.columns
        boxes = make_boxes(evaluate, np.array(axes), half, error)
        keep_arrays(_KIND, name, boxes._asdict())
    else:
        _log.info("the gravity table of %s is read from the cache", field.shape.name)
    return boxes


def _kept_boxes(name: str) -> Boxes | None:
    """The boxes kept under a name, if the compiled kernel, which checks no index, can read them."""
    arrays = kept_arrays(_KIND, name)
    if arrays is None or set(arrays) != set(Boxes._fields):
        return None
    children, places, coefficients = boxes = Boxes(**arrays)
    fits = (
        children.dtype == np.int32
        and places.dtype == coefficients.dtype == np.float64
        and children.ndim == 2
        and len(children) > 0
        and children.shape[1] == 8
        and places.shape == (len(places), 4)
        and coefficients.shape == (len(places), entries(DEGREE), 2)
        # A child comes after its node, so that every descent ends.
        and bool(np.all((children < 0) | (children > np.arange(len(children))[:, None])))
        and bool(np.all(children < len(children)))
        and bool(np.all(children >= -1 - len(places)))
    )
    return boxes if fits else None


def _far_masses(field: GravityField) -> tuple[float, np.ndarray]:
    """Half the edge of the cube outside of which point masses (4, K) have the field."""
    centre = field.centre_of_mass
    radius = float(np.linalg.norm(field.shape.vertices - centre, axis=1).max())
    masses, _ = fit_masses(lambda points: field.columns(points + centre)[:, 0], radius)
    masses[:3] += centre[:, None]
    return SWITCH * radius + float(np.abs(centre).max()), masses
