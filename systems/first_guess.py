"""Where to linearise when there is no plan yet: a path that is a fixed rule of its ends."""

import numpy as np

from proxops.systems.ellipsoid import blocks_segment


def first_positions(
    fractions: np.ndarray, start: np.ndarray, end: np.ndarray, axes: np.ndarray
) -> np.ndarray:
    """Positions (N + 1, 3) at the knots of a plan from start (3,) to end (3,), before any plan.

    Args:
      fractions: (N + 1,) knots as shares of the whole time.
      axes: (3,) semi-axes of the keep-out ellipsoid.

    A straight line; where the keep-out ellipsoid is in the way, an arc over it instead: in
    coordinates that make it a sphere, the great circle from start to target, by the shortest
    axis where they are opposite, at the radius interpolated between the ends' and no less
    than the sphere's.
    """
    share = (fractions**2 * (3.0 - 2.0 * fractions))[:, None]
    if not blocks_segment(axes, start, end):
        return start + share * (end - start)
    a, b = start / axes, end / axes
    radius_a, radius_b = np.linalg.norm(a), np.linalg.norm(b)
    over = np.zeros(3)
    over[np.argmin(axes)] = 1.0
    unit_a = a / radius_a if radius_a > 1e-9 else over
    unit_b = b / radius_b if radius_b > 1e-9 else over
    middle = unit_a + unit_b
    # The less the ends' directions say which way round, the more the fixed axis says.
    middle = middle + over * max(0.0, 0.2 - float(np.linalg.norm(middle)))
    middle /= max(float(np.linalg.norm(middle)), 1e-9)
    arc = (1.0 - share) ** 2 * unit_a + 2.0 * share * (1.0 - share) * middle + share**2 * unit_b
    arc /= np.linalg.norm(arc, axis=1, keepdims=True)
    radius = np.maximum((1.0 - share) * radius_a + share * radius_b, 1.0)
    return arc * radius * axes
