"""`PointMassField`: the field of a point mass, with the interface of `GravityField`."""

from __future__ import annotations

import numpy as np

from proxops.systems.common import InputError, Vectors3
from proxops.systems.gravity.gravity_field import GRAVITATIONAL_CONSTANT, Gravity, as_points


class PointMassField:
    """Gravity of a mass at the origin of K."""

    def __init__(self, mass: float):
        """Takes the mass in kg."""
        if not (np.isfinite(mass) and mass > 0.0):
            raise InputError(f"mass must be positive and finite, got {mass}")
        self.mass = mass

    def evaluate(self, points: Vectors3) -> Gravity:
        """The field at points (N, 3) in m. It is not finite at the origin; no point is inside."""
        points = as_points(points)
        mu = GRAVITATIONAL_CONSTANT * self.mass
        r = np.linalg.norm(points, axis=1)
        factor = (mu / r**3)[:, None]
        tides = 3.0 * np.einsum("ni,nj->nij", points, points) / (r**2)[:, None, None] - np.eye(3)
        return Gravity(mu / r, -factor * points, factor[:, :, None] * tides, np.zeros(len(r), bool))
