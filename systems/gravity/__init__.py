"""The gravity of a body, of uniform density or of two halves that differ, from its polyhedron.

Start with `GravityField.evaluate`: potential, acceleration and gradient at any number of positions.
`PolyhedralGravity` is the Drake system that wraps it. `PointMassField` has the same interface for a
point mass. So has `TabulatedField`, which is many times as fast, within a bound on its error;
compiled functions call `gravity_at`. `surface_maps` and `equilibria` analyse the field. The kernels
in `_polyhedral_kernel` and `_table_kernel` are compiled. Their last bits are part of every recorded
flight, so a change there raises the version.
"""

from proxops.systems.gravity._table_kernel import FieldTables, gravity_at
from proxops.systems.gravity.equilibria import Equilibrium, find_equilibria, synchronous_radius
from proxops.systems.gravity.gravity_field import (
    GRAVITATIONAL_CONSTANT,
    PLAUSIBLE_DENSITY,
    BodyField,
    Field,
    Gravity,
    GravityField,
)
from proxops.systems.gravity.moons import (
    Moon,
    MoonConfig,
    Moons,
    ball,
    greatest_tide,
    later,
    moon_axes,
    moon_position,
    tide_of,
    tides,
)
from proxops.systems.gravity.point_mass_field import PointMassField
from proxops.systems.gravity.polyhedral_gravity import PolyhedralGravity, PolyhedralGravity_
from proxops.systems.gravity.scaled_field import ScaledField
from proxops.systems.gravity.surface_maps import (
    AXES,
    PlaneCut,
    effective_field,
    plane_cut,
    surface_map,
)
from proxops.systems.gravity.tabulated_field import FINE_MESH, TabulatedField

__all__ = [
    "AXES",
    "FINE_MESH",
    "GRAVITATIONAL_CONSTANT",
    "PLAUSIBLE_DENSITY",
    "BodyField",
    "Equilibrium",
    "Field",
    "FieldTables",
    "Gravity",
    "GravityField",
    "Moon",
    "MoonConfig",
    "Moons",
    "PlaneCut",
    "PointMassField",
    "PolyhedralGravity",
    "PolyhedralGravity_",
    "ScaledField",
    "TabulatedField",
    "ball",
    "effective_field",
    "find_equilibria",
    "gravity_at",
    "greatest_tide",
    "later",
    "moon_axes",
    "moon_position",
    "plane_cut",
    "surface_map",
    "synchronous_radius",
    "tide_of",
    "tides",
]
