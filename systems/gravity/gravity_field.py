"""Gravity of a polyhedron of constant density: potential, acceleration, gradient, inside test."""

from __future__ import annotations

import functools
import sys
from pathlib import Path
from typing import NamedTuple, Protocol

import numpy as np

from proxops.systems.common import InputError
from proxops.systems.gravity import _polyhedral_kernel as kernel
from proxops.systems.gravity._far_field import fit_masses
from proxops.systems.shapes import Polyhedron

GRAVITATIONAL_CONSTANT = 6.67430e-11
"""G in m^3 kg^-1 s^-2 (CODATA 2018)."""

# Densities in kg/m^3 between a light rubble pile and iridium. Outside, the mesh's unit is wrong.
PLAUSIBLE_DENSITY = (100.0, 23_000.0)

# Below this many points one thread is faster than many.
_PARALLEL_FROM = 256


class Gravity(NamedTuple):
    """The result of `GravityField.evaluate` for N points."""

    potential: np.ndarray
    """(N,) in m^2/s^2, positive and falling to 0 far away (Werner & Scheeres's sign)."""
    acceleration: np.ndarray
    """(N, 3) in m/s^2: the potential's gradient, so it points towards the body."""
    gradient: np.ndarray
    """(N, 3, 3) in 1/s^2: the derivative of the acceleration by position, symmetric."""
    inside: np.ndarray
    """(N,) bool: whether the point is within the surface (a solid angle above 2 pi)."""


class Field(Protocol):
    """The interface of all gravity fields."""

    def evaluate(self, points: np.ndarray) -> Gravity:
        """The field at points (N, 3) in m."""
        ...


class GravityField:
    """The field of a `Polyhedron`, in the mesh's own frame.

    The formulas are eqs. 10, 15, 16 and 19 of Werner & Scheeres, Celest. Mech. Dyn. Astron. 65
    (1997) 313. The potential and the acceleration are finite and continuous everywhere. The
    gradient jumps across a facet; on the facet it is the mean of both sides (trace -2 pi G rho). It
    diverges as a logarithm at an edge; on the edge it is limited to its value at a distance of
    1e-15 of the edge's length.

    From 10 radii on, where those sums lose digits, the field is that of point masses fitted to it
    (`fit_masses`). Relative errors on Kleopatra's mesh: below 1e-12 for potential and acceleration
    anywhere outside; a few 1e-12 at most for the gradient, except beside edges, where it follows
    the rounding of the position.
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
          InputError: neither or both are given, the value is not positive, or the density is one
            that no body has (for instance because kilometres were read as metres).
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
        _announce_compilation()
        # The tables are relative to the centre of mass, where the sums far away cancel least.
        self._origin = shape.centre_of_mass
        self._tables = _tables(shape, self._origin)
        self._factor = GRAVITATIONAL_CONSTANT * self.density
        size = float(np.linalg.norm(shape.vertices - self._origin, axis=1).max())
        self._masses, self._limits = np.empty((4, 0)), (size, np.inf)
        self._masses, switch = fit_masses(lambda offsets: self._columns(offsets)[:, 0], size)
        self._limits = (size, switch)

    def evaluate(self, points: np.ndarray) -> Gravity:
        """The field at points (N, 3) in m; large batches are computed by all of numba's threads.

        Raises:
          InputError: the points are not an (N, 3) array.
        """
        points = np.asarray(points, dtype=np.float64)
        if points.ndim != 2 or points.shape[1] != 3:
            raise InputError(f"points must have shape (N, 3), got {points.shape}")
        columns = self._columns(points - self._origin)
        gradient = columns[:, 4:13].reshape(-1, 3, 3)
        return Gravity(columns[:, 0], columns[:, 1:4], gradient, columns[:, 13] > 2.0 * np.pi)

    def _columns(self, offsets: np.ndarray) -> np.ndarray:
        """The kernel's columns (N, 14) at points (N, 3) relative to the centre of mass."""
        columns = np.empty((len(offsets), 14))
        parallel = len(offsets) >= _PARALLEL_FROM
        run = kernel.evaluate_parallel if parallel else kernel.evaluate_serial
        arguments = (*self._tables, self._masses, self._factor, self._limits, columns)
        run(offsets, *arguments)  # pyright: ignore[reportCallIssue]  (a tuple of known length)
        return columns


@functools.cache
def _announce_compilation() -> None:
    """Prints once that the first use on a machine takes a few seconds."""
    stats = kernel.evaluate_serial.stats
    if not stats.cache_hits and not list(Path(str(stats.cache_path)).glob("*evaluate_serial*.nbi")):
        sys.stderr.write("proxops: compiling gravity for this machine (once, about 5 s)\n")


def _tables(shape: Polyhedron, origin: np.ndarray) -> tuple[np.ndarray, ...]:
    """The kernel's arrays of the shape relative to `origin`.

    Returns:
      The arguments ends, corners, vertices, edges and facets of `kernel.evaluate_serial`.
    """
    vertices = shape.vertices - origin
    normals = shape.normals
    ends, neighbours = shape.edges
    start = vertices[ends[:, 0]]
    along = vertices[ends[:, 1]] - start
    length = np.linalg.norm(along, axis=1)
    along = along / length[:, None]
    n_a, n_b = normals[neighbours[:, 0]], normals[neighbours[:, 1]]
    # The edge's outward normals in the planes of its facets. Facet b runs along it backwards.
    dyad = n_a[:, :, None] * np.cross(along, n_a)[:, None, :]
    dyad -= n_b[:, :, None] * np.cross(along, n_b)[:, None, :]
    dyad = 0.5 * (dyad + dyad.transpose(0, 2, 1))
    moved = np.einsum("nij,nj->ni", dyad, start)
    rows = [dyad[:, i, j] for i, j in ((0, 0), (1, 1), (0, 1), (0, 2), (1, 2))]
    rows += [*moved.T, np.einsum("ni,ni->n", moved, start), length]

    a, b, c = np.moveaxis(vertices[shape.facets], 1, 0)
    twice_area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    height = np.einsum("fi,fi->f", normals, a)
    squares = [np.sum(side**2, axis=1) for side in (b - c, c - a, a - b)]
    return (
        np.ascontiguousarray(ends.T.astype(np.uint32)),
        np.ascontiguousarray(shape.facets.T.astype(np.uint32)),
        np.ascontiguousarray(vertices.T),
        np.ascontiguousarray(rows),
        np.ascontiguousarray([*normals.T, height, twice_area, *squares]),
    )
