"""`EnclosingEllipsoid`: the smallest axis-aligned ellipsoid about the origin around a body."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy  # Its parts are imported when they are used.
from pydrake.solvers import ClarabelSolver, MathematicalProgram

from proxops.systems.common import InputError, Vector3, Vectors3


@dataclass(frozen=True)
class EnclosingEllipsoid:
    """An ellipsoid about the origin, with proof that it contains all points and is small."""

    semi_axes: Vector3
    """(3,) in m along x, y, z, the margin included."""
    margin: float
    """Share by which each semi-axis is longer than that of the smallest ellipsoid."""
    level: float
    """The largest (x/a)^2 + (y/b)^2 + (z/c)^2 of all points. It is below 1: all are inside."""
    farthest: int
    """Index of the point with that value."""
    volume_bound: float
    """Lower bound in m^3 of the volume of any such ellipsoid that contains the points."""

    @property
    def volume(self) -> float:
        """Volume in m^3."""
        return float(4.0 / 3.0 * np.pi * self.semi_axes.prod())

    @property
    def volume_over_bound(self) -> float:
        """The volume without the margin over its lower bound: nearly 1 for the smallest one."""
        return self.volume / (1.0 + self.margin) ** 3 / self.volume_bound


def smallest_ellipsoid(points: Vectors3, margin: float = 0.0) -> EnclosingEllipsoid:
    """The ellipsoid of least volume that contains points (N, 3) in m, with a margin.

    In w = 1/a^2 the points' levels are linear, and the volume is proportional to the product of
    w^(-1/2). So the program maximises the geometric mean of w subject to Q w <= 1, with Q the
    squared coordinates. The multipliers u >= 0 of a solution, scaled to a sum of 3, give a lower
    bound of every such ellipsoid's volume: by the inequality of the means,
    prod (w) <= prod (1 / (Q' u)).

    Args:
      points: (N, 3) in m.
      margin: share by which each semi-axis is made longer.

    Raises:
      InputError: the margin is negative, or the points lie in a plane through the origin.
    """
    if not 0.0 <= margin < np.inf:
        raise InputError(f"the margin must be a share that is not negative, got {margin}")
    reach = np.abs(points).max(axis=0)
    if not (np.isfinite(reach).all() and reach.min() > 1e-9 * reach.max()):
        raise InputError("the points lie in a plane: no smallest ellipsoid contains them")
    # An ellipsoid that contains the corners of the convex hull of the points and their mirror
    # images contains all points.
    folded = np.abs(points / reach)
    signs = np.array([[i, j, k] for i in (-1, 1) for j in (-1, 1) for k in (-1, 1)])
    hull = scipy.spatial.ConvexHull((folded[:, None] * signs).reshape(-1, 3)).vertices
    squares = folded[np.unique(hull // len(signs))] ** 2
    program = MathematicalProgram()
    w = program.NewContinuousVariables(3, "w")
    program.AddMaximizeGeometricMeanCost(w, 1.0)
    upper = np.ones(len(squares))
    holds = program.AddLinearConstraint(squares, np.full(len(squares), -np.inf), upper, w)
    result = ClarabelSolver().Solve(program)
    if not result.is_success():
        raise InputError("no smallest ellipsoid was found")
    # Scaled so that all points are inside, whatever the solver's rounding.
    weights = result.GetSolution(w)
    weights /= (squares @ weights).max()
    semi_axes = (1.0 + margin) * (1.0 + 1e-12) * reach / np.sqrt(weights)
    levels = np.sum((points / semi_axes) ** 2, axis=1)
    prices = np.abs(result.GetDualSolution(holds))
    bound = np.sqrt(np.prod(prices * 3.0 / prices.sum() @ squares)) * reach.prod()
    return EnclosingEllipsoid(
        semi_axes=semi_axes,
        margin=margin,
        level=float(levels.max()),
        farthest=int(levels.argmax()),
        volume_bound=float(4.0 / 3.0 * np.pi * bound),
    )
