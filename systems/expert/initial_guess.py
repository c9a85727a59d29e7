"""Initial paths: where to linearise when there is no plan yet. They depend on their ends alone."""

import numpy as np

from proxops.systems.common import Vector3
from proxops.systems.shapes import blocks_segment

# If the ends' unit vectors add up to less than this, they are nearly opposite. A fixed axis then
# decides which way round the body comes first.
_OPPOSITE = 0.2
# If the ends' unit vectors add up to more than this (they are within 60 degrees), only the short
# way round is tried: the other would be five times as long.
_ONE_SIDED = 3.0**0.5


def initial_paths(
    fractions: np.ndarray, start: Vector3, end: Vector3, axes: Vector3
) -> list[np.ndarray]:
    """Positions (N + 1, 3) at the knots of one or two initial paths from start (3,) to end (3,).

    If the straight line does not pass through the keep-out ellipsoid, it is the only path.
    Otherwise the paths are arcs over the ellipsoid, in coordinates that make it a sphere: the
    shorter way from start to end, near the great circle, and the longer way on the other side,
    unless that is much longer. The radius is interpolated between the ends' radii and is at least
    the sphere's. Either way may be better, because the rotation of K and the ellipsoid's axes
    distinguish them.

    Args:
      fractions: (N + 1,) knots as shares of the whole time.
      start, end: (3,) in m in K.
      axes: (3,) semi-axes of the keep-out ellipsoid in m.
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
    sum_length = float(np.linalg.norm(middle))
    # The closer the ends are to opposite directions, the more the fixed axis counts.
    middle = middle + over * max(0.0, _OPPOSITE - sum_length)
    if np.linalg.norm(middle) < 1e-9:  # The two contributions cancel.
        middle = over
    middle /= np.linalg.norm(middle)
    arc = (1.0 - share) ** 2 * unit_a + 2.0 * share * (1.0 - share) * middle + share**2 * unit_b
    arcs = [arc / np.linalg.norm(arc, axis=1, keepdims=True)]
    if sum_length < _ONE_SIDED:
        first, second = _arc(unit_a, -middle, 2.0 * share), _arc(-middle, unit_b, 2.0 * share - 1.0)
        arcs.append(np.where(share < 0.5, first, second))
    radius = np.maximum((1.0 - share) * radius_a + share * radius_b, 1.0)
    return [arc * radius * axes for arc in arcs]


def _shortest_axis_across(axes: np.ndarray, way: np.ndarray) -> np.ndarray:
    """A unit vector (3,) across `way` (3,), towards a short axis of the ellipsoid.

    It is the component across `way` of the shortest axis that is more across than along it.
    """
    along = way / max(float(np.linalg.norm(way)), 1e-9)
    across = np.eye(3) - np.outer(along, along)
    most = next(k for k in np.argsort(axes) if across[k, k] > 0.5)
    return across[most] / np.linalg.norm(across[most])


def _arc(a: np.ndarray, b: np.ndarray, share: np.ndarray) -> np.ndarray:
    """Points (N, 3) of the great circle from unit vector a to b, at shares (N, 1) of the way."""
    angle = np.arccos(np.clip(a @ b, -1.0, 1.0))
    return (np.sin((1.0 - share) * angle) * a + np.sin(share * angle) * b) / np.sin(angle)
