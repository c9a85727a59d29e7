"""The flux of gravity out of spheres, which says what mass is in them."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from proxops.systems import GravityField


def outward_flux(
    field: GravityField, centre: ArrayLike, radius: float, breaks: Sequence[float] = ()
) -> float:
    """Flux of the acceleration out of a sphere: Gauss-Legendre in x, trapezium in azimuth.

    Breaks are shares of the radius in x, in ascending order, where the acceleration has a kink.
    """
    ends = np.array([-1.0, *breaks, 1.0])
    x, weight = np.polynomial.legendre.leggauss(48)
    half = np.diff(ends) / 2
    along = (half[:, None] * x + (ends[:-1] + half)[:, None]).ravel()
    weights = np.repeat((half[:, None] * weight).ravel(), 96) * 2 * np.pi / 96 * radius**2
    azimuth = np.tile(2 * np.pi * np.arange(96) / 96, len(along))
    along = np.repeat(along, 96)
    across = np.sqrt(1.0 - along**2)
    normals = np.c_[along, across * np.cos(azimuth), across * np.sin(azimuth)]
    acceleration = field.evaluate(np.asarray(centre) + radius * normals).acceleration
    return float(weights @ np.einsum("ni,ni->n", acceleration, normals))
