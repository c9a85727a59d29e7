"""Gravity far from a body: point masses on a sphere about it that have the same field far away.

The sums of polyhedral gravity lose digits with distance: the relative error grows as its square, to
1e-6 at 10,000 radii. A sum over point masses loses none. The masses are fitted to the polyhedral
potential on the sphere where they take over. The misfit is harmonic outside that sphere, so it
falls at least as fast as the potential.
"""

from collections.abc import Callable
from functools import cache

import numpy as np

from proxops.systems.common import one_thread, spread_directions

SWITCH = 10.0
"""Distance from the centre of mass, in radii of the body, from which the masses are used."""

# The masses match the field's harmonics up to a degree of about sqrt(_MASSES). With 200, the rest
# is below rounding at 10 radii. On the sphere that contains the body all masses come out positive,
# so that nothing cancels.
_MASSES = 200


@one_thread()
def fit_masses(
    potential: Callable[[np.ndarray], np.ndarray], radius: float
) -> tuple[np.ndarray, float]:
    """Fits point masses to the potential of a body within `radius` of the origin.

    Args:
      potential: gives the body's potential (N,) at points (N, 3).
      radius: radius in m of a sphere about the origin that contains the body.

    Returns:
      The masses (4, K), each x, y, z and G m, and the distance in m from which they may be used.
    """
    switch = SWITCH * radius
    places, checks, u, s, vt = _unit_fit()
    weights = ((potential(switch * checks) @ u) / s) @ vt * switch
    return np.ascontiguousarray(np.vstack([radius * places.T, weights])), switch


@cache
def _unit_fit() -> tuple[np.ndarray, ...]:
    """Places (K, 3), directions of the fit's points, and the fit's singular value decomposition."""
    places, checks = spread_directions(_MASSES), spread_directions(2 * _MASSES)
    unit_potentials = SWITCH / np.linalg.norm(SWITCH * checks[:, None] - places, axis=2)
    u, s, vt = np.linalg.svd(unit_potentials, full_matrices=False)
    # Singular values below the cut-off belong to degrees whose field has decayed at this distance.
    kept = s > 1e-13 * s[0]
    return places, checks, u[:, kept], s[kept], vt[kept]
