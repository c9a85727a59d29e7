"""Fields as keys of a cache: what is kept of one field is never taken for another's."""

import numpy as np
import pytest
from short_flights import kleopatra

from proxops.systems import GravityField, PointMassField
from proxops.systems.gravity import GRAVITATIONAL_CONSTANT
from proxops.systems.hybrid.reach_time import greatest_gravity
from proxops.systems.shapes.polyhedron import Polyhedron

AXES = np.array([140e3, 70e3, 65e3])
HEIGHTS = np.array([0.0, 20e3])


def test_other_fields_differ() -> None:
    field = kleopatra().exact_field
    smaller = Polyhedron(0.9 * field.shape.vertices, field.shape.facets, "smaller")
    others = [
        GravityField(field.shape, mass=1.01 * field.mass),
        GravityField(field.shape, mass=field.mass, contrast=0.1),
        GravityField(smaller, mass=field.mass),
        PointMassField(1e15),
        PointMassField(1e15),
    ]
    assert len({field, *others}) == 1 + len(others)


@pytest.mark.parametrize("factor", [1.0, 1.7])
def test_bounds_of_gravity_are_those_of_their_own_field(factor: float) -> None:
    """A point mass is strongest at the shortest semi-axis, where the bound is 5 % above it."""
    for mass in (factor * 1e15, factor * 3e15):
        strength = GRAVITATIONAL_CONSTANT * mass
        bounds = greatest_gravity(PointMassField(mass), AXES, HEIGHTS)
        np.testing.assert_allclose(bounds, 1.05 * strength / (65e3 + HEIGHTS) ** 2, rtol=0.01)
