"""Light on a spacecraft of plane facets: the force and the torque of its pressure."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from proxops.systems.common import Values, Vectors3, kernel


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


@kernel(error_model="numpy")
def light_on_facets(facets, direction):
    """Force (3,) in m^2 and torque (3,) in m^3 on facets, in S, each over the pressure of light.

    With the area A, the unit normal n, the unit vector s to the Sun, and cos = n·s above 0, a facet
    gets -A cos ((1 - specular) s + 2 (specular cos + diffuse / 3) n): Montenbruck and Gill,
    Satellite Orbits, 2000, equation 3.73 with light that is thrown back diffusely, as in Basilisk's
    facetSRPDynamicEffector. Facets do not shadow each other.

    Args:
      facets: of the spacecraft. direction: unit vector to the Sun, in S: (3,), or three numbers.
    """
    force, torque = np.zeros(3), np.zeros(3)
    x, y, z = direction
    for k in range(facets.areas.size):
        a, b, c = facets.normals[k]
        cosine = a * x + b * y + c * z
        if cosine > 0.0:
            push = -facets.areas[k] * cosine
            along = 2.0 * (facets.specular[k] * cosine + facets.diffuse[k] / 3.0) * push
            across = (1.0 - facets.specular[k]) * push
            u, v, w = across * x + along * a, across * y + along * b, across * z + along * c
            p, q, r = facets.centres[k]
            force[0], force[1], force[2] = force[0] + u, force[1] + v, force[2] + w
            torque[0] += q * w - r * v
            torque[1] += r * u - p * w
            torque[2] += p * v - q * u
    return force, torque
