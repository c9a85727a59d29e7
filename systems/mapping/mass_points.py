"""`MassPoints`: the gravity of a mesh far from it, as that of point masses inside."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from proxops.systems.common import Values, Vectors3, kernel

# Gauss-Jacobi nodes and weights for the integral of s^2 f(s) over 0 to 1, times 3: exact for
# polynomials f of degree 3 (Abramowitz and Stegun, table 25.8, k = 2).
_NODES = np.array([0.4558481559, 0.8774851773])
_WEIGHTS = 3.0 * np.array([0.1007858821, 0.2325474513])


class MassPoints(NamedTuple):
    """Point masses that have the field of a mesh at more than its size from it."""

    shares: Values
    """(M,): of the whole mass; they sum to 1, and may be negative."""
    places: Vectors3
    """(M, 3) in m in the frame of the mesh."""

    @classmethod
    def of(cls, vertices: Vectors3, facets: np.ndarray) -> MassPoints:
        """The masses of a closed mesh whose frame has its origin at the centre of mass.

        Each facet and the origin span a tetrahedron, whose mass lies at two points towards the
        facet's centroid. Where the centre of a uniform density is not the origin, density grows
        linearly, along the direction and as steeply as that takes. A body whose halves differ has
        about this density.
        """
        corners = vertices[facets]
        volumes = np.einsum("fi,fi->f", corners[:, 0], np.cross(corners[:, 1], corners[:, 2]))
        centroids = corners.mean(axis=1)
        places = (_NODES[:, None, None] * centroids).reshape(-1, 3)
        shares = (_WEIGHTS[:, None] * volumes).ravel() / volumes.sum()
        centre = shares @ places
        moments = (places * shares[:, None]).T @ places
        slope = np.linalg.solve(moments - np.outer(centre, centre), -centre)
        return cls(shares * (1.0 + (places - centre) @ slope), places)

    def pull(self, points: Vectors3) -> tuple[np.ndarray, np.ndarray]:
        """The acceleration (N, 3) at points (N, 3) in m by GM = 1, and its gradient (N, 3, 3)."""
        points = np.ascontiguousarray(points, dtype=np.float64)
        pulls, gradients = np.empty((len(points), 3)), np.empty((len(points), 3, 3))
        _pull(points, self.shares, self.places, pulls, gradients)
        return pulls, gradients


@kernel(error_model="numpy")
def _pull(points, masses, places, pulls, gradients):
    """Fills in the pull (N, 3) of M point masses at points, and its gradient (N, 3, 3).

    Args:
      points: (N, 3) in m. masses: (M,), GM of each in m^3/s^2. places: (M, 3) in m.
      pulls, gradients: filled in, in m/s^2 and 1/s^2.
    """
    for n in range(points.shape[0]):
        gx, gy, gz = 0.0, 0.0, 0.0
        xx, yy, xy, xz, yz = 0.0, 0.0, 0.0, 0.0, 0.0
        for m in range(places.shape[0]):
            x = points[n, 0] - places[m, 0]
            y = points[n, 1] - places[m, 1]
            z = points[n, 2] - places[m, 2]
            inverse = 1.0 / (x * x + y * y + z * z)
            near = masses[m] * inverse * math.sqrt(inverse)
            gx -= near * x
            gy -= near * y
            gz -= near * z
            steep = 3.0 * near * inverse
            xx += steep * x * x - near
            yy += steep * y * y - near
            xy += steep * x * y
            xz += steep * x * z
            yz += steep * y * z
        pulls[n, 0], pulls[n, 1], pulls[n, 2] = gx, gy, gz
        gradients[n, 0, 0], gradients[n, 1, 1], gradients[n, 2, 2] = xx, yy, -xx - yy
        gradients[n, 0, 1] = gradients[n, 1, 0] = xy
        gradients[n, 0, 2] = gradients[n, 2, 0] = xz
        gradients[n, 1, 2] = gradients[n, 2, 1] = yz
