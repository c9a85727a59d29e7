"""`MapError`: the error of a map as a few smooth displacements of its surface."""

from __future__ import annotations

import copy
import functools
import math

import numpy as np
import scipy  # Its parts are imported when they are used.

from proxops.systems.common import Values, one_thread
from proxops.systems.navigation.relief import PATTERNS
from proxops.systems.shapes import Polyhedron, rigid_motions, vertex_normals

# Points of the surface at which the smooth displacements are computed; between them they are
# interpolated by the same covariance.
_POINTS = 1200
# Modes are kept until they hold this share of the variance; and the greatest number of modes.
_SHARE, _MOST = 0.985, 160
# The truncation error is correlated between frames: the factor on its variance, as noise.
_SEEN_AGAIN = 10.0
# If the modes hold less than this share, what is left out is too large for noise: it is relief.
_NEARLY_ALL = 0.95
# Vertices interpolated at once: limits memory.
_BLOCK = 20_000


class MapError:
    """How far a map's surface may lie from the true one, the same from frame to frame.

    The error is a Gaussian random field along the normals with the covariance
    s^2 exp(-d^2 / (2 l^2)), less what a translation and a small rotation of the body explain: a
    survey registers the map, so its frame is that of the best fit. It is expanded in the
    eigenfunctions of this covariance over the surface (Karhunen-Loeve): few hold nearly all of it.

    Attributes:
      std: standard deviation in m of all of it, before what moves or turns the body is taken off.
      modes: M, their number; 0 if the map has no error.
      table: (V, M) float64: displacement of each vertex along its normal, in m, by each of the
        coefficients, which are independent, with variance 1.
      rest: m^2; the displacement beyond the M counts in each frame as noise of this variance.
      relief, relief_correlation: standard deviation and correlation length in m of what is too fine
        to be estimated, such as boulders, or much that the M leave out. It takes the place of
        `rest`.
    """

    relief, relief_correlation = 0.0, 1.0

    def __init__(self, shape: Polyhedron, std: float = 0.0, correlation: float = 1.0):
        """Takes the map, the standard deviation of its error in m, and correlation length in m."""
        self.std = std
        self.table, self.rest = np.zeros((len(shape.vertices), 0)), 0.0
        if std > 0.0:
            table, share = _smooth_fields(shape, correlation)
            self.table, self.rest = std * table, _SEEN_AGAIN * std**2 * (1.0 - share)
            if share < _NEARLY_ALL:
                self.relief, self.relief_correlation = self._left_out, correlation
        self.modes = self.table.shape[1]

    def with_relief(self, std: float, correlation: float) -> MapError:
        """This error and a relief of a standard deviation and a correlation length in m.

        What the modes leave out counts as relief then. Without relief it is this error itself.
        """
        if std == 0.0:
            return self
        made = copy.copy(self)
        made.std = math.hypot(self.std, std)
        made.relief, made.relief_correlation = math.hypot(std, self._left_out), correlation
        return made

    @classmethod
    def known(cls, table: np.ndarray, rest: float) -> MapError:
        """An error that is not alike everywhere, from its attributes `table` and `rest`."""
        made = cls.__new__(cls)
        made.table, made.rest, made.modes = np.ascontiguousarray(table), rest, table.shape[1]
        made.std = float(np.sqrt(np.mean(made.deviations**2)))
        return made

    @property
    def coefficients(self) -> int:
        """Number of the coefficients that a filter has to estimate: of modes, then of relief."""
        return self.modes + (PATTERNS if self.relief else 0)

    @property
    def deviations(self) -> Values:
        """Standard deviation (V,) in m of each vertex along its normal."""
        return np.sqrt(np.einsum("vm,vm->v", self.table, self.table) + self._left_out**2)

    @property
    def _left_out(self) -> float:
        """Standard deviation in m of the displacement beyond the modes."""
        return math.sqrt(self.rest / _SEEN_AGAIN)


@functools.lru_cache(maxsize=4)
@one_thread()
def _smooth_fields(shape: Polyhedron, correlation: float) -> tuple[np.ndarray, float]:
    """Eigenfunctions (V, M) at the vertices, times the roots of their eigenvalues, and their share.

    The field has variance 1 before the rigid motions are taken out. The share is that of the
    variance that the M functions hold.
    """
    normals, weights = vertex_normals(shape)
    chosen = _spread(weights)
    points = shape.vertices[chosen]
    covariance = _covariance(points, points, correlation)
    left = _without_rigid(points, normals[chosen], shape)
    inner = left @ covariance @ left
    values, vectors = scipy.linalg.eigh(
        inner, subset_by_index=[max(0, len(points) - _MOST), len(points) - 1]
    )
    values, vectors = values[::-1], vectors[:, ::-1]
    total = float(np.trace(inner))
    held = np.cumsum(values) / total
    modes = min(int(np.searchsorted(held, _SHARE)) + 1, values.size)
    values, vectors = values[:modes], vectors[:, :modes]
    # From the points to all vertices: the mean of the field, given its values at the points.
    smooth = covariance + 1e-6 * np.eye(len(points))
    by_point = scipy.linalg.solve(smooth, vectors * np.sqrt(values), assume_a="pos")
    table = np.empty((len(shape.vertices), modes))
    for start in range(0, len(table), _BLOCK):
        block = slice(start, start + _BLOCK)
        table[block] = _covariance(shape.vertices[block], points, correlation) @ by_point
    return table, float(held[modes - 1])


@functools.lru_cache(maxsize=4)
@one_thread()
def shift_of_centre(shape: Polyhedron, std: float, correlation: float) -> float:
    """Computes how far the error of a map may move the centre of mass, if the density is uniform.

    The error is taken as a thin layer on the map. Its mass counts where the surface lies farther
    out, and is missing elsewhere.

    Args:
      shape: the map. std, correlation: of its error, in m.

    Returns:
      The standard deviation in m along the axis (x, y, z) where it is greatest.
    """
    normals, weights = vertex_normals(shape)
    chosen = _spread(weights)
    points = shape.vertices[chosen]
    # Points that were chosen by area stand for the same area.
    areas = weights if len(points) == len(weights) else np.full(len(points), 1.0)
    areas = areas * (weights.sum() / areas.sum())
    # By a height of 1 at each point.
    shifts = (points - shape.centre_of_mass).T * areas / shape.volume
    shifts = shifts @ _without_rigid(points, normals[chosen], shape)
    variances = np.einsum("kn,kn->k", shifts @ _covariance(points, points, correlation), shifts)
    return std * float(np.sqrt(variances.max()))


def _without_rigid(points: np.ndarray, normals: np.ndarray, shape: Polyhedron) -> np.ndarray:
    """The projector (N, N) that takes rigid motions out of displacements along normals (N, 3)."""
    rigid = rigid_motions(points, normals, shape.centre_of_mass, shape.extents.max())
    return np.eye(len(points)) - rigid @ np.linalg.pinv(rigid)


def _spread(weights: np.ndarray) -> np.ndarray:
    """Indices of vertices, spread over the surface by area: all, if there are few."""
    if len(weights) <= _POINTS:
        return np.arange(len(weights))
    cumulated = np.cumsum(weights)
    marks = (np.arange(_POINTS) + 0.5) / _POINTS * cumulated[-1]
    return np.unique(np.searchsorted(cumulated, marks))


def _covariance(first: np.ndarray, second: np.ndarray, correlation: float) -> np.ndarray:
    squares = (first**2).sum(1)[:, None] + (second**2).sum(1)[None] - 2.0 * first @ second.T
    return np.exp(-np.maximum(squares, 0.0) / (2.0 * correlation**2))
