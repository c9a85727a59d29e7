"""`Path`: the spacecraft's positions in N as a spline in time, and what its dynamics say of it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.interpolate import BSpline

from proxops.systems.common import Values

DEGREE = 5
"""Of the polynomials between knots; a free orbit is smooth."""
# Places between two knots at which the equation of motion is asked for.
_PLACES = 2


class Basis(NamedTuple):
    """The B-splines that are not zero at T times."""

    first: Values
    """(T,) int: the first of the coefficients that count."""
    values: np.ndarray
    """(T, DEGREE + 1): their weights."""


class Path(NamedTuple):
    """Positions in N: sum_j B_j(t) c_j, with the coefficients c_j kept apart."""

    knots: Values
    """(J + DEGREE + 1,) in s."""

    @classmethod
    def between(cls, start: float, end: float, spacing: float) -> Path:
        """A path from start to end in s, with knots at about a spacing in s."""
        inner = np.linspace(start, end, max(2, round((end - start) / spacing) + 1))
        ends = np.full(DEGREE, 1.0)
        return cls(np.r_[start * ends, inner, end * ends])

    @property
    def size(self) -> int:
        """J, the number of coefficients of each axis."""
        return len(self.knots) - DEGREE - 1

    @property
    def places(self) -> Values:
        """Times in s, evenly between the knots, at which the equation of motion is asked for."""
        inner = self.knots[DEGREE:-DEGREE]
        shares = (np.arange(_PLACES) + 0.5) / _PLACES
        return (inner[:-1, None] + shares * np.diff(inner)[:, None]).ravel()

    @property
    def step(self) -> float:
        """Time in s between two of the places."""
        return float(self.knots[DEGREE + 1] - self.knots[DEGREE]) / _PLACES

    def basis(self, times: Values) -> Basis:
        """The B-splines that are not zero at times (T,) in s within the path."""
        matrix = BSpline.design_matrix(times, self.knots, DEGREE)
        return Basis(
            matrix.indices[:: DEGREE + 1].astype(np.int64), matrix.data.reshape(-1, DEGREE + 1)
        )

    def matrix(self, times: Values, derivative: int = 0) -> np.ndarray:
        """The values (T, J) of all B-splines at times (T,) in s, or those of their derivatives."""
        splines = BSpline(self.knots, np.eye(self.size), DEGREE)
        return (splines.derivative(derivative) if derivative else splines)(times)
