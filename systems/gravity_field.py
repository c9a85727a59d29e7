"""Gravity of a polyhedron of constant density: potential, acceleration, gradient, inside test."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from proxops.systems import _polyhedral_kernel as kernel
from proxops.systems._far_field import fit_masses
from proxops.systems.errors import InputError
from proxops.systems.polyhedron import Polyhedron

GRAVITATIONAL_CONSTANT = 6.67430e-11
"""G in m^3 kg^-1 s^-2 (CODATA 2018)."""

# Lighter than any rubble pile and heavier than iridium: outside, the mesh's unit is wrong.
PLAUSIBLE_DENSITY = (100.0, 23_000.0)

# Below this many points a thread pool costs more than it gives.
_PARALLEL_FROM = 256


class Gravity(NamedTuple):
    """What `GravityField.evaluate` returns for N points."""

    potential: np.ndarray
    """(N,) in m^2/s^2, positive and falling to 0 far away (Werner & Scheeres's sign)."""
    acceleration: np.ndarray
    """(N, 3) in m/s^2: the potential's gradient, so it points towards the body."""
    gradient: np.ndarray
    """(N, 3, 3) in 1/s^2: the derivative of the acceleration by position, symmetric."""
    inside: np.ndarray
    """(N,) bool: within the surface (a solid angle above 2 pi)."""


class GravityField:
    """The field of a `Polyhedron`, in the mesh's own frame.

    Werner & Scheeres, Celest. Mech. Dyn. Astron. 65 (1997) 313, eqs. 10, 15, 16 and 19. The
    potential and the acceleration are finite and continuous everywhere. The gradient jumps across
    a facet, where it is the mean of both sides (trace -2 pi G rho), and diverges as a logarithm at
    an edge, where it is capped: on an edge it is what it is 1e-15 of the edge's length away.

    From 10 radii on, where those sums lose digits, the field is that of point masses fitted to it
    (`fit_masses`). Relative errors on Kleopatra's mesh: below 1e-12 for potential and acceleration
    anywhere outside, below 2e-12 for the gradient but beside edges, where it follows the rounding
    of the position.
    """

    def __init__(
        self,
        shape: Polyhedron,
        *,
        mass: float | None = None,
        density: float | None = None,
    ):
        """Takes the shape and exactly one of `mass` in kg and `density` in kg/m^3.

        Raises:
          InputError: neither or both are given, not positive, or together with the shape's
            volume they make a density that no body has (as metres read for kilometres do).
        """
        if (mass is None) == (density is None):
            raise InputError("give exactly one of mass (kg) and density (kg/m^3)")
        value, what = (mass, "mass") if mass is not None else (density, "density")
        assert value is not None
        if not (np.isfinite(value) and value > 0):
            raise InputError(f"{what} must be positive and finite, got {value}")
        self.shape = shape
        self.density = float(value) if mass is None else float(value) / shape.volume
        self.mass = self.density * shape.volume
        low, high = PLAUSIBLE_DENSITY
        if not low <= self.density <= high:
            raise InputError(
                f"{shape.name}: {self.mass:.4g} kg in {shape.extents.max():.4g} m of length is "
                f"{self.density:.3g} kg/m^3, which no body has ({low:g} to {high:g}); "
                "is the mesh in the unit that was said (km or m)?"
            )
        # The tables are relative to the centre of mass: far away the sums then cancel least.
        self._origin = shape.centre_of_mass
        self._tables = _tables(shape, self._origin)
        self._factor = GRAVITATIONAL_CONSTANT * self.density
        self._far = np.empty((4, 0)), np.inf
        self._far = fit_masses(
            lambda offsets: self._columns(offsets)[:, 0],
            float(np.linalg.norm(shape.vertices - self._origin, axis=1).max()),
        )

    def evaluate(self, points: np.ndarray) -> Gravity:
        """The field at points (N, 3) in m. Large batches use all threads that numba may use.

        Raises:
          InputError: the points are not an (N, 3) array.
        """
        points = np.asarray(points, dtype=np.float64)
        if points.ndim != 2 or points.shape[1] != 3:
            raise InputError(f"points must have shape (N, 3), got {points.shape}")
        columns = self._columns(points - self._origin)
        gradient = columns[:, [4, 7, 8, 7, 5, 9, 8, 9, 6]].reshape(-1, 3, 3)
        return Gravity(columns[:, 0], columns[:, 1:4], gradient, columns[:, 10] > 2.0 * np.pi)

    def _columns(self, offsets: np.ndarray) -> np.ndarray:
        """The kernel's columns (N, 11) at points (N, 3) relative to the centre of mass."""
        columns = np.empty((len(offsets), 11))
        parallel = len(offsets) >= _PARALLEL_FROM
        run = kernel.evaluate_parallel if parallel else kernel.evaluate_serial
        arguments = (offsets, *self._tables, self._factor, *self._far, columns)
        run(*arguments)
        return columns


def _tables(shape: Polyhedron, origin: np.ndarray) -> tuple[np.ndarray, ...]:
    """The kernel's structure-of-arrays, from the shape relative to `origin`.

    Returns vertices (3, V), edge ends (2, E), edge lengths (E,), edge moments (9, E), facet
    corners (3, F), facet sides (8, F), facet moments (9, F). Moments of a dyad D at the point p
    are D_xx, D_yy, D_xy, D_xz, D_yz, (D p)_x, (D p)_y, (D p)_z, p.D p.
    """
    vertices = shape.vertices - origin
    normals = shape.normals
    edges, neighbours = shape.edges
    start = vertices[edges[:, 0]]
    along = vertices[edges[:, 1]] - start
    length = np.linalg.norm(along, axis=1)
    along = along / length[:, None]
    n_a, n_b = normals[neighbours[:, 0]], normals[neighbours[:, 1]]
    # Outward normals of the edge in the planes of its facets; facet b runs along it backwards.
    dyad = n_a[:, :, None] * np.cross(along, n_a)[:, None, :]
    dyad -= n_b[:, :, None] * np.cross(along, n_b)[:, None, :]
    dyad = 0.5 * (dyad + dyad.transpose(0, 2, 1))

    a, b, c = np.moveaxis(vertices[shape.facets], 1, 0)
    twice_area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    height = np.einsum("fi,fi->f", normals, a)
    side = np.empty((8, len(normals)))
    side[0] = height * twice_area
    side[1:4] = (normals * twice_area[:, None]).T
    side[4] = np.sum((b - c) ** 2, axis=1)
    side[5] = np.sum((c - a) ** 2, axis=1)
    side[6] = np.sum((a - b) ** 2, axis=1)
    # A point this close to a facet's plane, in units of height times twice the area, lies in it.
    side[7] = 1e-14 * np.abs(vertices).max() * twice_area
    return (
        np.ascontiguousarray(vertices.T),
        np.ascontiguousarray(edges.T.astype(np.uint32)),
        length,
        _moments(dyad, start),
        np.ascontiguousarray(shape.facets.T.astype(np.uint32)),
        side,
        _moments(normals[:, :, None] * normals[:, None, :], a),
    )


def _moments(dyads: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Moments (9, n), as `_tables` lists them, of dyads (n, 3, 3) at points (n, 3)."""
    moved = np.einsum("nij,nj->ni", dyads, points)
    rows = [dyads[:, i, j] for i, j in ((0, 0), (1, 1), (0, 1), (0, 2), (1, 2))]
    rows += [moved[:, 0], moved[:, 1], moved[:, 2], np.einsum("ni,ni->n", moved, points)]
    return np.ascontiguousarray(rows)
