"""Light on a spacecraft of plane facets: the force and the torque of its pressure."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from proxops.systems.common import Values, Vector3, Vectors3


class Facets(NamedTuple):
    """The outside of a spacecraft, in S, whose origin is the centre of mass."""

    centres: Vectors3
    """(F, 3) in m."""
    normals: Vectors3
    """(F, 3) unit vectors, outwards."""
    areas: Values
    """(F,) in m^2."""
    specular: Values
    """(F,) share of the light that is thrown back as by a mirror."""
    diffuse: Values
    """(F,) share that is thrown back to all sides, by Lambert's law. The rest is absorbed."""


def light_on_facets(facets: Facets, direction: Vector3) -> tuple[Vector3, Vector3]:
    """Force (3,) in m^2 and torque (3,) in m^3 on facets, in S, each over the pressure of light.

    With the area A, the unit normal n, the unit vector s to the Sun, and cos = n·s above 0, a facet
    gets -A cos ((1 - specular) s + 2 (specular cos + diffuse / 3) n): Montenbruck and Gill,
    Satellite Orbits, 2000, equation 3.73 with light that is thrown back diffusely, as in Basilisk's
    facetSRPDynamicEffector. Facets do not shadow each other.

    Args:
      facets: of the spacecraft. direction: (3,) unit vector to the Sun, in S.
    """
    cosines = facets.normals @ direction
    lit = np.flatnonzero(cosines > 0.0)
    cosines, normals = cosines[lit], facets.normals[lit]
    specular, pushes = facets.specular[lit], -facets.areas[lit] * cosines
    along = 2.0 * (specular * cosines + facets.diffuse[lit] / 3.0)
    forces = (pushes * (1.0 - specular))[:, None] * direction + (pushes * along)[:, None] * normals
    # Row i, column j: the sum of r_i f_j, whose differences are those of r x f. `np.cross` is slow.
    moments = facets.centres[lit].T @ forces
    torque = (moments - moments.T)[[1, 2, 0], [2, 0, 1]]
    return forces.sum(axis=0), torque
