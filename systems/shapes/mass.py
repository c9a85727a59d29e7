"""Volume, centre of mass and moments of inertia of a closed mesh of uniform density."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from proxops.systems.common import Matrix3, Vector3, Vectors3
from proxops.systems.shapes.mesh_checks import areas, six_volumes


@dataclass(frozen=True)
class MassProperties:
    """Mass properties for a density of 1 kg/m^3. For another, multiply the moments."""

    volume: float
    """m^3."""
    area: float
    """m^2."""
    centre_of_mass: Vector3
    """(3,) in m."""
    inertia: Matrix3
    """(3, 3) in kg m^2 per kg/m^3, about the centre of mass, in the mesh's axes."""
    principal_moments: Vector3
    """(3,), ascending, in the units of `inertia`."""
    principal_axes: Matrix3
    """(3, 3): the unit vectors of the moments, in rows, right-handed.

    They point as close to +x, +y and +z as their order allows. For a body whose long axis is x and
    that spins about z they are close to the unit matrix.
    """

    @property
    def equivalent_diameter(self) -> float:
        """Diameter in m of the sphere of the same volume."""
        return float(np.cbrt(6.0 * self.volume / np.pi))


def mass_properties(vertices: Vectors3, facets: Vectors3) -> MassProperties:
    """The exact mass properties of the body bounded by vertices (V, 3) in m and facets (F, 3).

    A tetrahedron of volume V with one corner at the origin and the others at a, b, c has the second
    moments (V / 20) (a a' + b b' + c c' + s s') with s = a + b + c (Tonon, J. Math. Stat. 1 (2005)
    8). Signed tetrahedra over all facets add up to the body.
    """
    origin = vertices.mean(axis=0)
    weights = six_volumes(vertices, facets) / 6.0
    corners = vertices[facets] - origin
    total = corners.sum(axis=1)
    volume = float(weights.sum())
    centre = weights @ total / (4.0 * volume)
    second = np.einsum("f,fki,fkj->ij", weights, corners, corners)
    second += np.einsum("f,fi,fj->ij", weights, total, total)
    second = second / 20.0 - volume * np.outer(centre, centre)
    inertia = np.trace(second) * np.eye(3) - second
    moments, columns = np.linalg.eigh(inertia)
    return MassProperties(
        volume=volume,
        area=float(areas(vertices, facets).sum()),
        centre_of_mass=origin + centre,
        inertia=inertia,
        principal_moments=moments,
        principal_axes=_right_handed(columns.T),
    )


def _right_handed(axes: np.ndarray) -> np.ndarray:
    """The axes (3, 3) in rows with signs: x and z point along +x and +z, and y completes them."""
    x, z = (np.copysign(1.0, axes[k, k]) * axes[k] for k in (0, 2))
    return np.stack([x, np.cross(z, x), z])
