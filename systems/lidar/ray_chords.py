"""Rays as chords of an ellipsoid that contains the body: the inputs of a learned lidar."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from proxops.systems.common import Values, Vectors3


class Chords(NamedTuple):
    """The K rays that pass through the ellipsoid, position by position, ray by ray."""

    places: Values
    """(K,) int: index of the ray's position, ascending."""
    rays: Values
    """(K,) int: index of the ray's direction, ascending within a position."""
    ends: np.ndarray
    """(K, 6) float32: points where the ray enters and leaves, scaled to the unit ball."""
    starts: Values
    """(K,) float64: distance in m from the position to the point where the ray enters."""
    lengths: Values
    """(K,) float64: length in m of the chord."""


class ChordFan:
    """Rays in fixed directions, turned as a whole if need be, cut to chords through an ellipsoid.

    What a ray from outside the ellipsoid meets depends on its line alone, so two points on the
    surface describe it. For a position inside the ellipsoid the chord begins at the position.
    """

    def __init__(self, centre: np.ndarray, semi_axes: np.ndarray, directions: np.ndarray):
        """Takes the ellipsoid's centre and semi-axes (3,) in m and unit directions (R, 3), in K."""
        self.centre, self.semi_axes = np.array(centre, float), np.array(semi_axes, float)
        assert self.centre.shape == self.semi_axes.shape == (3,)
        assert (self.semi_axes > 0.0).all()
        directions = np.asarray(directions, dtype=np.float64)
        self._directions = directions
        self._scaled, self._squared = self._in_unit_ball(directions)

    def _in_unit_ball(self, directions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Directions (R, 3) in the ball's coordinates, and the squares (R,) of their lengths."""
        scaled = directions / self.semi_axes
        return scaled, np.einsum("ri,ri->r", scaled, scaled)

    def chords(self, positions: Vectors3, rotation: np.ndarray | None = None) -> Chords:
        """The chords of the rays from positions (N, 3) in m; the memory needed grows with N R.

        With a rotation matrix (3, 3), every ray points along it times its direction.

        With q and e the position and the direction in the unit ball's coordinates, |q + t e|² = 1
        is a quadratic in the distance t.
        """
        q = (positions - self.centre) / self.semi_axes
        scaled, squared = self._scaled, self._squared
        if rotation is not None:
            scaled, squared = self._in_unit_ball(self._directions @ rotation.T)
        half = q @ scaled.T
        rest = np.einsum("ni,ni->n", q, q)[:, None] - 1.0
        discriminant = half * half - squared * rest
        # The chord is ahead if the position is inside (rest < 0) or the ray points inwards (half <
        # 0).
        met = np.flatnonzero((discriminant > 0.0) & ((rest < 0.0) | (half < 0.0)))
        places, rays = np.divmod(met, half.shape[1])
        root = np.sqrt(discriminant.ravel()[met])
        middle, squared, scaled = -half.ravel()[met], squared[rays], scaled[rays]
        starts = np.maximum((middle - root) / squared, 0.0)
        stops = (middle + root) / squared
        first = q[places]
        ends = np.concatenate(
            [first + starts[:, None] * scaled, first + stops[:, None] * scaled], axis=1
        )
        return Chords(places, rays, ends.astype(np.float32), starts, stops - starts)
