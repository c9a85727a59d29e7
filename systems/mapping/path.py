"""`Path`: the spacecraft's positions in N as a spline in time, and what its dynamics say of it."""

from __future__ import annotations

import itertools
from typing import NamedTuple

import numpy as np
from scipy.interpolate import BSpline

from proxops.systems.common import Values

DEGREE = 5
"""Of the polynomials between knots; a free orbit is smooth."""
# Places between two knots at which the equation of motion is asked for: as many as a polynomial's
# second derivative has coefficients, so that even one alone is determined.
_PLACES = 4
_NONE = np.zeros(0)


class Basis(NamedTuple):
    """The B-splines that are not zero at T times."""

    first: Values
    """(T,) int: the first of the coefficients that count."""
    values: np.ndarray
    """(T, DEGREE + 1): their weights."""


class Path(NamedTuple):
    """Positions in N: sum_j B_j(t) c_j, with the coefficients c_j kept apart.

    They are continuous; velocities may jump at kinks, and elsewhere all but the highest derivatives
    are continuous.
    """

    knots: Values
    """(J + DEGREE + 1,) in s: a kink is there DEGREE times."""
    kinks: Values
    """(B,) in s, ascending, within the path."""

    @classmethod
    def between(cls, start: float, end: float, spacing: float, kinks: Values = _NONE) -> Path:
        """A path from start to end in s, with knots at about a spacing in s.

        Kinks (B,) are in s, ascending, between start and end.
        """
        ends = np.r_[start, kinks, end]
        parts = [np.full(DEGREE, start)]
        for first, last in itertools.pairwise(ends):
            count = max(1, round((last - first) / spacing))
            parts += [np.linspace(first, last, count + 1)[:-1], np.full(DEGREE - 1, last)]
        return cls(np.r_[np.concatenate(parts), end, end], kinks)

    @property
    def size(self) -> int:
        """J, the number of coefficients of each axis."""
        return len(self.knots) - DEGREE - 1

    @property
    def places(self) -> Values:
        """Times in s, evenly between the knots, at which the equation of motion is asked for."""
        inner = np.unique(self.knots)
        shares = (np.arange(_PLACES) + 0.5) / _PLACES
        return (inner[:-1, None] + shares * np.diff(inner)[:, None]).ravel()

    @property
    def steps(self) -> Values:
        """Time in s for which each of the places stands."""
        return np.repeat(np.diff(np.unique(self.knots)) / _PLACES, _PLACES)

    @property
    def jumps(self) -> np.ndarray:
        """By how much the derivatives of all B-splines jump at the kinks: (B, J) in 1/s."""
        before = np.nextafter(self.kinks, -np.inf)
        return self.matrix(self.kinks, 1) - self.matrix(before, 1)

    def basis(self, times: Values) -> Basis:
        """The B-splines that are not zero at times (T,) in s within the path."""
        matrix = BSpline.design_matrix(times, self.knots, DEGREE)
        return Basis(
            matrix.indices[:: DEGREE + 1].astype(np.int64), matrix.data.reshape(-1, DEGREE + 1)
        )

    def matrix(self, times: Values, derivative: int = 0) -> np.ndarray:
        """The values (T, J) of all B-splines at times (T,) in s, or those of their derivatives."""
        splines = BSpline(self.knots, np.eye(self.size), DEGREE)
        return splines(times, derivative)
