"""Equilibrium points of a spinning body: an undisturbed spacecraft stays at rest there in K."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from proxops.systems.common import InputError, Matrix3, Vector3, Vectors3, cross_matrix
from proxops.systems.gravity.gravity_field import GRAVITATIONAL_CONSTANT, BodyField
from proxops.systems.gravity.surface_maps import effective_field

# Lengths of the search, as shares of the body's greatest radius.
_LONGEST_STEP = 0.1
_CONVERGED = 1e-9
_SAME = 1e-5
_ITERATIONS = 100
# Curvatures below this share of the greatest count as 0. A sphere has a ring of equilibria: the
# field is flat along the ring, and a Newton step along it would be arbitrary.
_FLAT = 1e-9
# Growth below this share of the fastest mode's rate is rounding.
_NO_GROWTH = 1e-6


class Equilibrium(NamedTuple):
    """A point of K where gravity and centrifugal force cancel."""

    position: Vector3
    """(3,) in m in K."""
    potential: float
    """The effective potential there, in m^2/s^2: see `EffectiveField`."""
    inside: bool
    """Whether the point is within the body."""
    eigenvalues: np.ndarray
    """(6,) complex, in 1/s, of the linearised motion about the point: see `linear_modes`."""
    growing: int
    """Number of eigenvalues with a positive real part; 0 means linear stability."""


def synchronous_radius(mass: float, spin: float) -> float:
    """Radius (GM / w^2)^(1/3) in m of the orbit that turns with a body; +inf without spin.

    Args:
      mass: kg. spin: rad/s.
    """
    return float(np.cbrt(GRAVITATIONAL_CONSTANT * mass / spin**2)) if spin else np.inf


def linear_modes(gradient: Matrix3, spin: float) -> np.ndarray:
    """Eigenvalues (6,), complex, in 1/s, of the motion r'' = H r - 2 w x r' near a point of rest.

    They come in pairs of opposite sign. Jiang, Baoyin, Li & Li, Astrophys. Space Sci. 349 (2014)
    83, classify equilibria by them.

    Args:
      gradient: H (3, 3) of the effective acceleration, in 1/s^2. spin: w in rad/s about z.
    """
    coriolis = -2.0 * cross_matrix((0.0, 0.0, spin))
    return np.linalg.eigvals(np.block([[np.zeros((3, 3)), np.eye(3)], [gradient, coriolis]]))


def find_equilibria(
    field: BodyField, spin: float, starts: Vectors3 | None = None
) -> list[Equilibrium]:
    """Equilibria of a body, outside and inside it, by Newton's method from many starts.

    Newton's method finds zeros of the effective acceleration with its own gradient, from all starts
    at once. Equal results are listed once. A body of uniform density has an odd number of
    equilibria, but there is no proof that the starts lead to all of them.

    Args:
      field: of a shape in K.
      spin: rad/s about z.
      starts: (N, 3) in m in K; None: a grid over the body, and rings about the synchronous orbit.

    Returns:
      First the equilibria outside the body, by longitude from -45 degrees on; then those inside,
      from the outermost to the innermost. This is the order of the literature.
    """
    if not np.isfinite(spin):
        raise InputError(f"the spin must be finite, got {spin} rad/s")
    reach = float(np.linalg.norm(field.shape.vertices, axis=1).max())
    points = _default_starts(field, spin, reach) if starts is None else np.array(starts, float)
    found = _newton(field, spin, points, reach)
    different: list[np.ndarray] = []
    for point in found:
        if all(np.linalg.norm(point - other) > _SAME * reach for other in different):
            different.append(point)
    if not different:
        return []
    effective = effective_field(field, spin, np.array(different))
    modes = [linear_modes(gradient, spin) for gradient in effective.gradient]
    growing = [int((np.real(mode) > _NO_GROWTH * np.abs(mode).max()).sum()) for mode in modes]
    columns = zip(different, effective.potential, effective.inside, modes, growing, strict=True)
    equilibria = [
        Equilibrium(point, float(potential), bool(inside), mode, count)
        for point, potential, inside, mode, count in columns
    ]
    return sorted(equilibria, key=_place_in_list)


def _place_in_list(equilibrium: Equilibrium) -> tuple[bool, float]:
    x, y, _ = equilibrium.position
    if equilibrium.inside:
        return True, -float(np.linalg.norm(equilibrium.position))
    return False, float((np.arctan2(y, x) + np.pi / 4.0) % (2.0 * np.pi))


def _default_starts(field: BodyField, spin: float, reach: float) -> np.ndarray:
    """Starts in the equatorial plane: 25 x 25 over the body, and 8 rings of 36 points.

    The rings are about the synchronous orbit, from 0.7 of its radius on.
    """
    low, high = 1.05 * field.shape.vertices.min(axis=0), 1.05 * field.shape.vertices.max(axis=0)
    x, y = np.meshgrid(np.linspace(low[0], high[0], 25), np.linspace(low[1], high[1], 25))
    radius = synchronous_radius(field.mass, spin)
    if np.isfinite(radius):
        # A long body pushes the equilibria over its tips outwards, to beyond its greatest radius.
        radii = radius * np.linspace(0.7, 1.1 + 0.4 * max(1.0, reach / radius), 8)
        angles = np.linspace(0.0, 2.0 * np.pi, 36, endpoint=False)
        x = np.append(x, np.outer(radii, np.cos(angles)))
        y = np.append(y, np.outer(radii, np.sin(angles)))
    return np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1)


def _newton(field: BodyField, spin: float, points: np.ndarray, reach: float) -> np.ndarray:
    """Zeros (K, 3) of the effective acceleration from starts (N, 3); some starts may find none."""
    found = []
    for _ in range(_ITERATIONS):
        if not len(points):
            break
        effective = effective_field(field, spin, points)
        curvature, axes = np.linalg.eigh(effective.gradient)
        flat = np.abs(curvature) < _FLAT * np.abs(curvature).max(axis=1, keepdims=True)
        inverse = np.where(flat, 0.0, 1.0 / np.where(flat, 1.0, curvature))
        step = -np.einsum("nij,nj,nkj,nk->ni", axes, inverse, axes, effective.acceleration)
        length = np.linalg.norm(step, axis=1)
        longest = _LONGEST_STEP * np.maximum(reach, np.linalg.norm(points, axis=1))
        points = points + step * np.minimum(1.0, longest / np.maximum(length, 1e-300))[:, None]
        done = length < _CONVERGED * reach
        found.append(points[done])
        points = points[~done]
    return np.concatenate(found) if found else np.empty((0, 3))
