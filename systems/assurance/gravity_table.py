"""`GravityTable`: gravity outside an ellipsoid by interpolation, in a hundredth of the time."""

from __future__ import annotations

import functools

import numpy as np

from proxops.systems.assurance import _braking_kernel as kernel
from proxops.systems.gravity import Field, FieldKey, TabulatedField

# Spacing of the nodes, where the ellipsoid is the unit ball. The error of Kleopatra's table is then
# below 5e-5 m/s^2 outside the keep-out ellipsoid, and 5e-6 on average.
_SPACING = 0.05
# Levels at which the gradient is sampled, number of points at each, and the factor that covers the
# gaps between the points.
_LEVELS = (1.1, 1.25, 1.5, 2.0, 3.0)
_POINTS = 400
_GAPS = 1.05
# At this distance, in greatest semi-axes, the field is that of a point mass.
_FAR = 1e4


class GravityTable:
    """A field's acceleration everywhere outside an ellipsoid, by cubic interpolation.

    The space outside is mapped to the unit ball by inversion: with w = (x/a, y/b, z/c), a point's
    place in the table is w / |w|^2. The table holds the difference between the field and that of a
    point mass. Far away is near the table's centre, where that difference vanishes as the fourth
    power of the distance from the centre. So the nodes are dense where gravity varies most, and the
    table has no outer end.
    """

    def __init__(self, field: Field, semi_axes: np.ndarray):
        """Takes the field and the semi-axes (3,) in m of an ellipsoid that contains the body."""
        axes = np.asarray(semi_axes, dtype=np.float64)
        far = _FAR * axes.max() * np.array([[0.0, 0.0, 1.0]])
        gravity = float(field.evaluate(far).potential[0]) * far[0, 2]
        count = int(1.0 / (kernel.LOWEST_LEVEL * _SPACING)) + 3
        line = _SPACING * np.arange(-count, count + 1)
        places = np.stack(np.meshgrid(line, line, line, indexing="ij"), axis=-1)
        square = np.sum(places**2, axis=-1)
        # Only the nodes that interpolation in the ball uses: 64 about each place.
        reach = 1.0 / kernel.LOWEST_LEVEL + 2.0 * np.sqrt(3.0) * _SPACING
        needed = (square > 0.0) & (square < reach**2)
        points = places[needed] / square[needed][:, None] * axes
        pull = field.evaluate(points).acceleration
        central = -gravity * points / np.linalg.norm(points, axis=1)[:, None] ** 3
        self.nodes = np.zeros((*square.shape, 4))
        """(2 n + 1, 2 n + 1, 2 n + 1, 4) in m/s^2; the fourth column is 0, for alignment."""
        self.nodes[needed, :3] = pull - central
        self.scales = np.array([*axes, gravity, _SPACING])
        """(5,): semi-axes in m, G m in m^3/s^2, spacing of the nodes."""
        # The components of gravity are harmonic, so each is greatest on the surface; and so is the
        # norm of the gradient.
        near = np.abs(np.sqrt(square) - 1.0) < 0.5 * _SPACING
        surface = places[near] / np.sqrt(square[near])[:, None] * axes
        found = field.evaluate(surface)
        sizes = np.abs(found.acceleration)
        self.greatest = sizes.max(axis=0)
        """(3,) in m/s^2: the greatest size of each component of the field outside the ellipsoid, as
        sampled: it may be up to 1 % more."""
        self.places = surface[sizes.argmax(axis=0)]
        """(3, 3) in m: where on the ellipsoid each component is greatest."""
        self.strongest = _GAPS * float(np.linalg.norm(found.acceleration, axis=1).max())
        """The greatest size of the field outside the ellipsoid, in m/s^2."""
        steep = [np.linalg.norm(found.gradient, ord=2, axis=(1, 2)).max()]
        unit = places[near] / np.sqrt(square[near])[:, None]
        some = unit[:: max(len(unit) // _POINTS, 1)]
        for level in _LEVELS:
            gradient = field.evaluate(level * some * axes).gradient
            steep.append(level**3 * np.linalg.norm(gradient, ord=2, axis=(1, 2)).max())
        self.steepness = _GAPS * float(max(steep))
        """In 1/s^2: outside, at the level L, the spectral norm of the gradient is at most this over
        the cube of L, as sampled up to level 3."""
        # Between the nodes, where cubics are worst.
        between = np.concatenate([level * some * axes for level in (1.0, *_LEVELS)])
        error = self.acceleration(between) - field.evaluate(between).acceleration
        self.error = _GAPS * float(np.linalg.norm(error, axis=1).max())
        """The greatest error of the table outside the ellipsoid, in m/s^2, as sampled."""

    def acceleration(self, points: np.ndarray) -> np.ndarray:
        """The field (N, 3) in m/s^2 at points (N, 3) in m outside the ellipsoid."""
        out = np.empty((len(points), 3))
        for point, row in zip(np.asarray(points, dtype=np.float64), out, strict=True):
            kernel.interpolate(point[0], point[1], point[2], self.scales, self.nodes, row)
        return out


def gravity_table(field: Field, semi_axes: np.ndarray) -> GravityTable:
    """The table of a field; a process makes each table once (about a second for Kleopatra)."""
    if isinstance(field, TabulatedField):
        field = field.exact
    return _table(FieldKey.of(field), tuple(map(float, semi_axes)))


@functools.lru_cache(maxsize=4)
def _table(key: FieldKey, semi_axes: tuple[float, ...]) -> GravityTable:
    return GravityTable(key.field, np.array(semi_axes))
