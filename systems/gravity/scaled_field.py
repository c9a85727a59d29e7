"""`ScaledField`: the field of a body that is larger or heavier than one whose field is known."""

from __future__ import annotations

from proxops.systems.common import Vectors3
from proxops.systems.gravity.gravity_field import BodyField, Gravity
from proxops.systems.shapes import Polyhedron


class ScaledField:
    """The field of a body of the same form and distribution of mass as another.

    A table of one form then serves all sizes and masses that are drawn.
    """

    def __init__(self, field: BodyField, shape: Polyhedron, mass: float):
        """Takes the known field, and the body that is meant.

        Args:
          field: of a body of the same form, in the same frame.
          shape: the body; each vertex is the known one, times one factor. mass: of it in kg.
        """
        self.shape, self.mass, self._field = shape, mass, field
        self._size = float(shape.extents.max() / field.shape.extents.max())
        self.centre_of_mass = self._size * field.centre_of_mass

    def evaluate(self, points: Vectors3) -> Gravity:
        """The field at points (N, 3) in m."""
        size, factor = self._size, self.mass / self._field.mass
        known = self._field.evaluate(points / size)
        return Gravity(
            factor / size * known.potential,
            factor / size**2 * known.acceleration,
            factor / size**3 * known.gradient,
            known.inside,
        )
