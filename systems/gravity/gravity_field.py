"""Gravity of a polyhedron of one density, or of two halves that differ.

Potential, acceleration, gradient and the inside test.
"""

from __future__ import annotations

import functools
import logging
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import NamedTuple, Protocol

import numpy as np

from proxops.systems.common import InputError, Values, Vector3, Vectors3, threads_to_use
from proxops.systems.gravity import _polyhedral_kernel as kernel
from proxops.systems.gravity._facet_quadrature import Facets, evaluate_by_quadrature, make_facets
from proxops.systems.gravity._far_field import fit_masses
from proxops.systems.gravity._polyhedral_tables import Tables, make_tables
from proxops.systems.shapes import Polyhedron, halves

GRAVITATIONAL_CONSTANT = 6.67430e-11
"""G in m^3 kg^-1 s^-2 (CODATA 2018)."""

# Densities in kg/m^3 between a light rubble pile and iridium. Outside, the mesh's unit or the
# contrast is wrong.
PLAUSIBLE_DENSITY = (100.0, 23_000.0)

# Below this many points one thread is faster than many.
_PARALLEL_FROM = 256
_log = logging.getLogger(__name__)


class Gravity(NamedTuple):
    """The result of `GravityField.evaluate` for N points."""

    potential: Values
    """(N,) in m^2/s^2, positive and falling to 0 far away (Werner & Scheeres's sign)."""
    acceleration: Vectors3
    """(N, 3) in m/s^2: the potential's gradient, so it points towards the body."""
    gradient: np.ndarray
    """(N, 3, 3) in 1/s^2: the derivative of the acceleration by position, symmetric."""
    inside: Values
    """(N,) bool: whether the point is within the surface (a solid angle above 2 pi)."""


class Field(Protocol):
    """The interface of all gravity fields."""

    def evaluate(self, points: Vectors3) -> Gravity:
        """The field at points (N, 3) in m."""
        ...


class BodyField(Field, Protocol):
    """A field that knows its body: a `GravityField` or a `TabulatedField`."""

    @property
    def shape(self) -> Polyhedron:
        """The body."""
        ...

    @property
    def mass(self) -> float:
        """Mass of the body in kg."""
        ...

    @property
    def centre_of_mass(self) -> Vector3:
        """Centre of mass (3,) in m in the mesh's frame."""
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

    A body with a density contrast is two polyhedra of one density each, and the field is the sum of
    theirs. On the cut the gradient is the mean of both sides.

    Fields of equal shape, mass and contrast are equal, so that what takes long to compute of one is
    found again in a cache.
    """

    def __init__(
        self,
        shape: Polyhedron,
        *,
        mass: float | None = None,
        density: float | None = None,
        contrast: float = 0.0,
    ):
        """Takes the shape and exactly one of `mass` in kg and `density` in kg/m^3.

        Args:
          shape: the body. mass: of all of it. density: mass over volume.
          contrast: d, above -1 and below 1. The half of the body on the positive side of the plane
            through the shape's centre of mass across its longest extent is denser by the factor
            (1 + d) and the other half by (1 - d), before both are scaled to the mass.

        Raises:
          InputError: neither or both are given, the value is not positive, the contrast is out of
            range, or the density is one that no body has (for instance because kilometres were
            read as metres).
        """
        if (mass is None) == (density is None):
            raise InputError("give exactly one of mass (kg) and density (kg/m^3)")
        value, what = (mass, "mass") if mass is not None else (density, "density")
        assert value is not None
        if not (np.isfinite(value) and value > 0):
            raise InputError(f"{what} must be positive and finite, got {value}")
        if not -1.0 < contrast < 1.0:
            raise InputError(f"the density contrast must be above -1 and below 1, got {contrast}")
        self.shape = shape
        self.contrast = float(contrast)
        self.density = float(value) if mass is None else float(value) / shape.volume
        self.mass = self.density * shape.volume
        _check_density(shape, self.density, "is the mesh in the unit that was said (km or m)?")
        bodies = _uniform_bodies(shape, self.density, self.contrast)
        for body, own_density in bodies:
            _check_density(body, own_density, "take a density contrast nearer to 0")
        _announce_compilation()
        self._parts = [_UniformPart(body, own_density) for body, own_density in bodies]

    def __eq__(self, other: object) -> bool:
        return isinstance(other, GravityField) and self._key() == other._key()

    def __hash__(self) -> int:
        return hash(self._key())

    def _key(self) -> tuple[str, float, float]:
        return self.shape.sha256, self.mass, self.contrast

    @property
    def centre_of_mass(self) -> Vector3:
        """Centre of mass (3,) in m in the mesh's frame, with the contrast in density."""
        if len(self._parts) == 1:
            return self.shape.centre_of_mass
        masses = np.array([part.mass for part in self._parts])
        return masses @ np.array([part.centre_of_mass for part in self._parts]) / masses.sum()

    def evaluate(self, points: Vectors3) -> Gravity:
        """The field at points (N, 3) in m; large batches are computed by several threads."""
        columns = self.columns(as_points(points))
        gradient = columns[:, 4:13].reshape(-1, 3, 3)
        return Gravity(columns[:, 0], columns[:, 1:4], gradient, columns[:, 13] > 2.0 * np.pi)

    def columns(self, points: Vectors3) -> np.ndarray:
        """The kernel's columns (N, 14) at points (N, 3) in m: see `evaluate_points`."""
        columns = self._parts[0].columns(points)
        for part in self._parts[1:]:
            columns += part.columns(points)
        return columns

    def outer_columns(self, points: Vectors3) -> np.ndarray:
        """As `columns` at points outside, but without solid angles, and within some 1e-7.

        Of a mesh of tens of thousands of facets it is several times as fast.
        """
        return np.sum([part.outer_columns(points) for part in self._parts], axis=0)


def as_points(points: Vectors3) -> Vectors3:
    """The points (N, 3) as float64.

    Raises:
      InputError: they are not an (N, 3) array of numbers.
    """
    try:
        points = np.ascontiguousarray(points, dtype=np.float64)  # As the kernels are compiled for.
    except TypeError as error:
        message = "points must be numbers; for AutoDiffXd, use PolyhedralGravity_"
        raise InputError(message) from error
    if points.ndim != 2 or points.shape[1] != 3:
        raise InputError(f"points must have shape (N, 3), got {points.shape}")
    return points


_Arguments = tuple[Tables, np.ndarray, tuple[float, ...]]
"""Those of the kernel after the points."""


class _UniformPart:
    """A polyhedron of one density: the kernel's tables and the masses of its far field."""

    def __init__(self, shape: Polyhedron, density: float):
        self.mass, self._shape = density * shape.volume, shape
        # The tables are relative to the centre of mass, where the sums far away cancel least.
        self.centre_of_mass = shape.centre_of_mass
        size = float(np.linalg.norm(shape.vertices - self.centre_of_mass, axis=1).max())
        tables = make_tables(shape, self.centre_of_mass)

        def with_masses(masses: np.ndarray, switch: float) -> _Arguments:
            numbers = (
                GRAVITATIONAL_CONSTANT * density,
                size,
                switch,
                *self.centre_of_mass.tolist(),
            )
            return tables, masses, numbers

        self._arguments = with_masses(np.empty((4, 0)), np.inf)
        self._arguments = with_masses(
            *fit_masses(lambda offsets: self.columns(offsets + self.centre_of_mass)[:, 0], size)
        )

    def columns(self, points: Vectors3) -> np.ndarray:
        """The kernel's columns (N, 14) at points (N, 3) in m in the mesh's frame."""
        return _by_threads(
            points, lambda at, out: kernel.evaluate_points(at, *self._arguments, out)
        )

    def outer_columns(self, points: Vectors3) -> np.ndarray:
        """See `GravityField.outer_columns`."""
        factor = self._arguments[2][0]
        return _by_threads(
            points, lambda at, out: evaluate_by_quadrature(at, self._facets, factor, out)
        )

    @functools.cached_property
    def _facets(self) -> Facets:
        return make_facets(self._shape)


def _by_threads(points: Vectors3, evaluate: Callable[[np.ndarray, np.ndarray], None]) -> np.ndarray:
    """The columns (N, 14) that a kernel fills at points (N, 3)."""
    columns = np.empty((len(points), 14))
    threads = threads_to_use() if len(points) >= _PARALLEL_FROM else 1
    if threads == 1:
        evaluate(points, columns)
        return columns
    # More parts than threads, since points near the body take longer.
    parts = (np.array_split(each, 4 * threads) for each in (points, columns))
    with ThreadPoolExecutor(threads) as pool:
        list(pool.map(evaluate, *parts))
    return columns


def _uniform_bodies(
    shape: Polyhedron, density: float, contrast: float
) -> list[tuple[Polyhedron, float]]:
    """The body as polyhedra of one density each, in kg/m^3, whose mean is `density`."""
    if contrast == 0.0:
        return [(shape, density)]
    axis = int(np.argmax(shape.extents))
    lower, upper = halves(shape, axis, shape.centre_of_mass[axis])
    relative = (1.0 - contrast, 1.0 + contrast)
    total = relative[0] * lower.volume + relative[1] * upper.volume
    scale = density * shape.volume / total
    return [(lower, relative[0] * scale), (upper, relative[1] * scale)]


def _check_density(shape: Polyhedron, density: float, remedy: str) -> None:
    low, high = PLAUSIBLE_DENSITY
    if not low <= density <= high:
        raise InputError(
            f"{shape.name}: {density * shape.volume:.4g} kg in {shape.extents.max():.4g} m of "
            f"length is {density:.3g} kg/m^3, which no body has ({low:g} to {high:g}); {remedy}"
        )


@functools.cache
def _announce_compilation() -> None:
    """Warns once in the log that the first use on a machine takes longer.

    Gravity is the first of the kernels that a flight needs, and takes a sixth of their time.
    """
    stats = kernel.evaluate_points.stats
    if stats.cache_path is None:
        _log.warning(
            "compiling, as each process must: no folder to keep it can be written; set "
            "XDG_CACHE_HOME to one that can"
        )
    elif not stats.cache_hits and not list(Path(stats.cache_path).glob("*evaluate_points*.nbi")):
        _log.warning("compiling for this machine, once: a first flight takes a minute longer")
