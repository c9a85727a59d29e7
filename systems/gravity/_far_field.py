"""Gravity far from a body: point masses on a sphere about it that have the same field out there.

The sums of polyhedral gravity cancel ever more with distance: the relative error grows as its
square, to 1e-6 at 10,000 radii. A sum over point masses does not. The masses are fitted to the
polyhedral potential on the sphere from which on they are used; the misfit is harmonic outside, so
it falls at least as fast as the potential itself.
"""

from collections.abc import Callable
from functools import cache

import numpy as np

SWITCH = 10.0
"""Distance, in radii of the body about its centre of mass, from which the masses are used."""

# They match the field to a degree of about sqrt(_MASSES). With 200, what is left is below rounding
# at 10 radii; on the sphere that holds the body all come out positive, so that nothing cancels.
_MASSES = 200


def fit_masses(
    potential: Callable[[np.ndarray], np.ndarray], radius: float
) -> tuple[np.ndarray, float]:
    """Point masses (4, K), each x, y, z and G m, of a body within `radius` of the origin.

    Args:
      potential: the body's, (N,) at points (N, 3).
      radius: of the sphere about the origin that holds the body, in m.

    Returns:
      the masses, and the distance from the origin from which on they may be used.
    """
    switch = SWITCH * radius
    places, checks, u, s, vt = _unit_fit()
    weights = ((potential(switch * checks) @ u) / s) @ vt * switch
    return np.ascontiguousarray(np.vstack([radius * places.T, weights])), switch


@cache
def _unit_fit() -> tuple[np.ndarray, ...]:
    """Places (K, 3), directions to fit in, and singular value decomposition of the fit."""
    places, checks = _directions(_MASSES), _directions(2 * _MASSES)
    unit_potentials = SWITCH / np.linalg.norm(SWITCH * checks[:, None] - places, axis=2)
    u, s, vt = np.linalg.svd(unit_potentials, full_matrices=False)
    # Singular values below the cut-off stand for degrees that do not reach this far.
    kept = s > 1e-13 * s[0]
    return places, checks, u[:, kept], s[kept], vt[kept]


def _directions(count: int) -> np.ndarray:
    """Unit vectors (count, 3) spread evenly: the Fibonacci spiral."""
    k = np.arange(count) + 0.5
    z = 1.0 - 2.0 * k / count
    azimuth = np.pi * (1.0 + np.sqrt(5.0)) * k
    across = np.sqrt(1.0 - z**2)
    return np.stack([across * np.cos(azimuth), across * np.sin(azimuth), z], axis=1)
