"""`GravityTable`: gravity outside an ellipsoid by interpolation, in a hundredth of the time."""

from __future__ import annotations

import dataclasses as dc
import functools

import numpy as np

from proxops.systems.assurance import _braking_kernel as kernel
from proxops.systems.common import keep_arrays, kept_arrays, name_of
from proxops.systems.gravity import Field, FieldKey, GravityField, TabulatedField

# Of the files on disk, and their kind. Whoever changes how a table is made, or a last bit of the
# exact field, raises the format.
_FORMAT, _KIND = 2, "assurance"
# Spacing of the nodes, where the ellipsoid is the unit ball. The error of Kleopatra's table is then
# below 5e-5 m/s^2 outside the keep-out ellipsoid, and 5e-6 on average.
_SPACING = 0.05
# Nodes on either side of the centre.
_COUNT = int(1.0 / (kernel.LOWEST_LEVEL * _SPACING)) + 3
# Levels at which the gradient is sampled, number of points at each, and the factor that covers the
# gaps between the points.
_LEVELS = (1.1, 1.25, 1.5, 2.0, 3.0)
_POINTS = 400
_GAPS = 1.05
# At this distance, in greatest semi-axes, the field is that of a point mass.
_FAR = 1e4


@dc.dataclass(frozen=True, eq=False)
class GravityTable:
    """A field's acceleration everywhere outside an ellipsoid, by cubic interpolation.

    The space outside is mapped to the unit ball by inversion: with w = (x/a, y/b, z/c), a point's
    place in the table is w / |w|^2. The table holds the difference between the field and that of a
    point mass. Far away is near the table's centre, where that difference vanishes as the fourth
    power of the distance from the centre. So the nodes are dense where gravity varies most, and the
    table has no outer end. `gravity_table` makes one.
    """

    nodes: np.ndarray
    """(2 n + 1, 2 n + 1, 2 n + 1, 4) in m/s^2; the fourth column is 0, for alignment."""
    scales: np.ndarray
    """(5,): semi-axes in m, G m in m^3/s^2, spacing of the nodes."""
    greatest: np.ndarray
    """(3,) in m/s^2: the greatest size of each component of the field outside the ellipsoid, as
    sampled: it may be up to 1 % more."""
    places: np.ndarray
    """(3, 3) in m: where on the ellipsoid each component is greatest."""
    strongest: float
    """The greatest size of the field outside the ellipsoid, in m/s^2."""
    steepness: float
    """In 1/s^2: outside, at the level L, the spectral norm of the gradient is at most this over the
    cube of L, as sampled up to level 3."""
    error: float = np.nan
    """The greatest error of the table outside the ellipsoid, in m/s^2, as sampled."""

    def acceleration(self, points: np.ndarray) -> np.ndarray:
        """The field (N, 3) in m/s^2 at points (N, 3) in m outside the ellipsoid."""
        out = np.empty((len(points), 3))
        for point, row in zip(np.asarray(points, dtype=np.float64), out, strict=True):
            kernel.interpolate(point[0], point[1], point[2], self.scales, self.nodes, row)
        return out


def gravity_table(field: Field, semi_axes: np.ndarray) -> GravityTable:
    """The table of a field outside the ellipsoid with semi-axes (3,) in m, which holds the body.

    To make that of Kleopatra takes a second or more. A process makes each table once; those of
    polyhedra are kept in the user's cache folder.
    """
    if isinstance(field, TabulatedField):
        field = field.exact
    return _table(FieldKey.of(field), tuple(map(float, semi_axes)))


@functools.lru_cache(maxsize=4)
def _table(key: FieldKey, semi_axes: tuple[float, ...]) -> GravityTable:
    field = key.field
    if not isinstance(field, GravityField):
        return _made(field, np.array(semi_axes))
    name = name_of(_FORMAT, *key.identity, *semi_axes)
    found = _kept(name)
    if found is None:
        found = _made(field, np.array(semi_axes))
        keep_arrays(_KIND, name, vars(found))
    return found


def _kept(name: str) -> GravityTable | None:
    """The table kept under a name, if the compiled kernel, which checks no index, can read it."""
    arrays = kept_arrays(_KIND, name)
    side = 2 * _COUNT + 1
    shapes = {
        "nodes": (side, side, side, 4), "scales": (5,), "greatest": (3,), "places": (3, 3),
        "strongest": (), "steepness": (), "error": (),
    }  # fmt: skip
    if arrays is None or {each: value.shape for each, value in arrays.items()} != shapes:
        return None
    if any(value.dtype != np.float64 or not np.isfinite(value).all() for value in arrays.values()):
        return None
    return GravityTable(
        arrays["nodes"], arrays["scales"], arrays["greatest"], arrays["places"],
        *(float(arrays[each]) for each in ("strongest", "steepness", "error")),
    )  # fmt: skip


def _made(field: Field, axes: np.ndarray) -> GravityTable:
    far = _FAR * axes.max() * np.array([[0.0, 0.0, 1.0]])
    gravity = float(field.evaluate(far).potential[0]) * far[0, 2]
    line = _SPACING * np.arange(-_COUNT, _COUNT + 1)
    places = np.stack(np.meshgrid(line, line, line, indexing="ij"), axis=-1)
    square = np.sum(places**2, axis=-1)
    # Only the nodes that interpolation in the ball uses: 64 about each place.
    reach = 1.0 / kernel.LOWEST_LEVEL + 2.0 * np.sqrt(3.0) * _SPACING
    needed = (square > 0.0) & (square < reach**2)
    points = places[needed] / square[needed][:, None] * axes
    pull = field.evaluate(points).acceleration
    central = -gravity * points / np.linalg.norm(points, axis=1)[:, None] ** 3
    nodes = np.zeros((*square.shape, 4))
    nodes[needed, :3] = pull - central
    # The components of gravity are harmonic, so each is greatest on the surface; and so is the norm
    # of the gradient.
    near = np.abs(np.sqrt(square) - 1.0) < 0.5 * _SPACING
    unit = places[near] / np.sqrt(square[near])[:, None]
    surface = unit * axes
    found = field.evaluate(surface)
    sizes = np.abs(found.acceleration)
    steep = [np.linalg.norm(found.gradient, ord=2, axis=(1, 2)).max()]
    some = unit[:: max(len(unit) // _POINTS, 1)]
    for level in _LEVELS:
        gradient = field.evaluate(level * some * axes).gradient
        steep.append(level**3 * np.linalg.norm(gradient, ord=2, axis=(1, 2)).max())
    table = GravityTable(
        nodes=nodes,
        scales=np.array([*axes, gravity, _SPACING]),
        greatest=sizes.max(axis=0),
        places=surface[sizes.argmax(axis=0)],
        strongest=_GAPS * float(np.linalg.norm(found.acceleration, axis=1).max()),
        steepness=_GAPS * float(max(steep)),
    )
    # Between the nodes, where cubics are worst.
    between = np.concatenate([level * some * axes for level in (1.0, *_LEVELS)])
    error = table.acceleration(between) - field.evaluate(between).acceleration
    return dc.replace(table, error=_GAPS * float(np.linalg.norm(error, axis=1).max()))
