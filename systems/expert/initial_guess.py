"""Where to linearise when there is no plan yet: paths that are a fixed rule of their ends."""

import numpy as np

from proxops.systems.shapes import blocks_segment

# Ends whose directions add up to less than this are so nearly opposite that an axis says which way
# round is the first.
_OPPOSITE = 0.2
# Ends whose directions add up to more than this, 60 degrees apart, have one way round: the other
# would be five times as far.
_ONE_SIDED = 3.0**0.5


def initial_paths(
    fractions: np.ndarray, start: np.ndarray, end: np.ndarray, axes: np.ndarray
) -> list[np.ndarray]:
    """Positions (N + 1, 3) at the knots of plans from start (3,) to end (3,), before any plan.

    Args:
      fractions: (N + 1,) knots as shares of the whole time.
      axes: (3,) semi-axes of the keep-out ellipsoid.

    A straight line; where the keep-out ellipsoid is in the way, arcs over it instead: in
    coordinates that make it a sphere, the shorter way from start to end, near the great circle, and
    the longer way on the other side, unless that is much longer. Both are at the radius
    interpolated between the ends' and no less than the sphere's. The motion in K is not the same
    both ways, nor are the ellipsoid's axes: either may be the better.
    """
    share = (fractions**2 * (3.0 - 2.0 * fractions))[:, None]
    if not blocks_segment(axes, start, end):
        return [start + share * (end - start)]
    a, b = start / axes, end / axes
    radius_a, radius_b = np.linalg.norm(a), np.linalg.norm(b)
    over = _shortest_axis_across(axes, b - a)
    unit_a = a / radius_a if radius_a > 1e-9 else over
    unit_b = b / radius_b if radius_b > 1e-9 else over
    middle = unit_a + unit_b
    alike = float(np.linalg.norm(middle))
    # The less the ends' directions say which way round, the more the fixed axis says.
    middle = middle + over * max(0.0, _OPPOSITE - alike)
    if np.linalg.norm(middle) < 1e-9:  # What the ends say and what the axis says, to the last bit.
        middle = over
    middle /= np.linalg.norm(middle)
    arc = (1.0 - share) ** 2 * unit_a + 2.0 * share * (1.0 - share) * middle + share**2 * unit_b
    arcs = [arc / np.linalg.norm(arc, axis=1, keepdims=True)]
    if alike < _ONE_SIDED:
        first, second = _arc(unit_a, -middle, 2.0 * share), _arc(-middle, unit_b, 2.0 * share - 1.0)
        arcs.append(np.where(share < 0.5, first, second))
    radius = np.maximum((1.0 - share) * radius_a + share * radius_b, 1.0)
    return [arc * radius * axes for arc in arcs]


def _shortest_axis_across(axes: np.ndarray, way: np.ndarray) -> np.ndarray:
    """The part (3,) across `way` (3,) of the shortest axis that has more of it across than along.

    Of unit length.
    """
    along = way / max(float(np.linalg.norm(way)), 1e-9)
    across = np.eye(3) - np.outer(along, along)
    most = next(k for k in np.argsort(axes) if across[k, k] > 0.5)
    return across[most] / np.linalg.norm(across[most])


def _arc(a: np.ndarray, b: np.ndarray, share: np.ndarray) -> np.ndarray:
    """Points (N, 3) of the great circle from unit vector a to b, at shares (N, 1) of the way."""
    angle = np.arccos(np.clip(a @ b, -1.0, 1.0))
    return (np.sin((1.0 - share) * angle) * a + np.sin(share * angle) * b) / np.sin(angle)
