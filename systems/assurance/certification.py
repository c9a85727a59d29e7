"""Whether a box of errors can be certified at all, and how much room its margins take."""

from __future__ import annotations

import numpy as np

from proxops.systems.assurance import _braking_kernel as kernel
from proxops.systems.assurance.assurance_bounds import AssuranceBounds
from proxops.systems.common import Vector3, spread_directions
from proxops.systems.gravity import FieldTables
from proxops.systems.shapes import outward_normals

# Number of places on the ellipsoid.
_PLACES = 300
# Heights that are tried there, as shares of its shortest semi-axis; then the least that is enough
# is found by bisection.
_HEIGHTS = np.array([0.0, *np.geomspace(1e-4, 0.5, 24)])
_BISECTIONS = 5

Arguments = tuple[FieldTables, np.record]
"""The kernel's arguments after position and velocity: `tables` and `world`."""


def rooms(
    arguments: Arguments, semi_axes: Vector3, speed: float = 0.0
) -> tuple[np.ndarray, np.ndarray]:
    """The clearance that a state needs to be admitted, at places all around the ellipsoid.

    Args:
      arguments: those of the kernel after position and velocity.
      semi_axes: (3,) in m of the keep-out ellipsoid.
      speed: inward speed in m/s along the normal.

    Returns:
      Points (N, 3) of the ellipsoid in m, and the clearances (N,) in m, inf where no clearance of
      up to half the shortest semi-axis is enough. They are at most 1.5 % too great.
    """
    points, normals = _places(semi_axes)
    needed = np.full(_PLACES, np.inf)
    for row, (point, normal) in enumerate(zip(points, normals, strict=True)):

        def enough(height: float, point=point, normal=normal) -> bool:
            position = point + height * normal
            return kernel.backup_margin(position, -speed * normal, *arguments) >= 0.0

        low = 0.0
        for high in _HEIGHTS * semi_axes.min():
            if enough(high):
                for _ in range(_BISECTIONS):
                    middle = 0.5 * (low + high)
                    low, high = (low, middle) if enough(middle) else (middle, high)
                needed[row] = high
                break
            low = high
    return points, needed


def certified(arguments: Arguments, semi_axes: np.ndarray) -> bool:
    """Whether at rest, at the greatest height of `rooms`, a spacecraft is admitted everywhere.

    If so, `rooms` finds a clearance at each place; this takes a tenth of the time.
    """
    points, normals = _places(semi_axes)
    height, still = _HEIGHTS[-1] * semi_axes.min(), np.zeros(3)
    return all(
        kernel.backup_margin(point + height * normal, still, *arguments) >= 0.0
        for point, normal in zip(points, normals, strict=True)
    )


def _places(semi_axes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Points (N, 3) in m all around the ellipsoid, and its normals (N, 3) there."""
    points = spread_directions(_PLACES) * semi_axes
    return points, outward_normals(semi_axes, points)


def budget(bounds: AssuranceBounds, acceleration: float, gravity: float) -> dict[str, float]:
    """What each bound takes of the thrust acceleration along an axis, in m/s^2; by scenario key.

    Args:
      bounds: the box.
      acceleration: thrust limit over mass, in m/s^2.
      gravity: its size there, in m/s^2.
    """
    return {
        "gravity": bounds.gravity * gravity,
        "thrust": bounds.thrust * acceleration,
        "thrust_direction_deg": bounds.across * acceleration,
        "mass": (1.0 - 1.0 / (1.0 + bounds.mass)) * acceleration,
        "acceleration_m_s2": bounds.acceleration_m_s2,
    }


def tightest(parts: dict[str, float]) -> str:
    """Says which bound takes most, and how much."""
    name = max(parts, key=lambda key: parts[key])
    if parts[name] == 0.0:
        return "fly with more thrust or less mass"
    return f"tighten assurance.bounds.{name} first: it takes {parts[name]:.3g} m/s^2"


def describe(place: Vector3) -> str:
    """A place (3,) in m, for a message."""
    return f"({place[0]:.4g}, {place[1]:.4g}, {place[2]:.4g}) m"
