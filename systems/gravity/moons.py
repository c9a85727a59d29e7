"""Moons: they go round the body on Kepler's ellipses, pull as point masses, and have a surface."""

from __future__ import annotations

import dataclasses as dc
import functools
import math
import operator
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from pydrake.systems.framework import LeafSystem

from proxops.systems.common import (
    FAR,
    LONG,
    Matrix3,
    Values,
    Vector3,
    Vectors3,
    config,
    kernel,
    number,
    quaternion_inverse,
    rotated,
    rotation_matrix,
    spread_directions,
)
from proxops.systems.gravity.gravity_field import GRAVITATIONAL_CONSTANT
from proxops.systems.rotation import Spin, SpinModel, spin_model
from proxops.systems.shapes import Polyhedron, ray_caster

_inverse, _rotated = kernel(quaternion_inverse), kernel(rotated)
# Newton's method on Kepler's equation ends at this step (rad), or after so many.
_STEP, _MOST_STEPS = 1e-14, 50
# Vertices of a ball: it is 0.3 % of its radius flat at most.
_POINTS = 1000


@config
class MoonConfig:
    """A moon on an ellipse that stays where it is among the stars.

    Its elements are against the body's equator at the start of a flight: the axes of K, then.
    """

    mass_kg: float = number(0.0, at_least=0.0, at_most=1e25, unit="kg")
    # Of the ball about it that nothing should enter. Without a mesh it is this ball.
    radius_m: float = number(0.0, at_least=0.0, at_most=FAR, unit="m")
    semi_major_axis_m: float = number(1.0, at_least=1e-3, at_most=1e3 * FAR, unit="m")
    period_s: float = number(1.0, at_least=1e-3, at_most=LONG, unit="s")
    eccentricity: float = number(0.0, at_least=0.0, below=1.0)
    # Of the orbit to K's xy-plane; above 90 degrees it goes round the other way.
    inclination_deg: float = number(0.0, at_least=0.0, at_most=180.0, unit="degrees")
    # Of the ascending node from K's x, of the pericentre from the node, and of the moon from the
    # pericentre by mean anomaly.
    node_deg: float = number(0.0, at_least=-360.0, at_most=360.0, unit="degrees")
    pericentre_deg: float = number(0.0, at_least=-360.0, at_most=360.0, unit="degrees")
    mean_anomaly_deg: float = number(0.0, at_least=-360.0, at_most=360.0, unit="degrees")
    # Mesh file in the unit of the body's; its path is relative to the body's YAML file. Its x
    # points at the body and its z along the orbit's pole: it turns once in an orbit.
    mesh: str = ""


# Those of the orbit's plane last.
_ELEMENTS = operator.attrgetter(
    "semi_major_axis_m", "period_s", "eccentricity", "mean_anomaly_deg",
    "node_deg", "inclination_deg", "pericentre_deg",
)  # fmt: skip


class Orbits(NamedTuple):
    """Kepler's ellipses of M moons."""

    semi_major_axes: Values
    """(M,) in m."""
    periods: Values
    """(M,) in s."""
    eccentricities: Values
    """(M,)"""
    anomalies: Values
    """(M,) mean ones at time 0, in rad."""
    axes: np.ndarray
    """(M, 3, 3) of the ellipses in N, in columns; the first goes through the pericentre."""


@functools.lru_cache(maxsize=64)
def _orbits_of(*elements: tuple[float, ...]) -> Orbits:
    columns = np.array(elements).reshape(-1, 7).T.copy()
    turned = np.array([_orbit_axes(*each) for each in columns[4:].T]).reshape(-1, 3, 3)
    axes, periods, eccentricities, anomalies = columns[:4]
    return Orbits(axes, periods, eccentricities, np.radians(anomalies), turned)


def moon_position(moon: MoonConfig, time: float, spin: SpinModel) -> Vector3:
    """Where a moon is (3,) at a time in s, in m from the centre of mass, along the axes of K.

    K turns as `spin` says.
    """
    return np.array(_place(_orbits_of(_ELEMENTS(moon)), 0, spin.attitude(time), float(time)))


@kernel(error_model="numpy")
def _place(orbits, moon, attitude, time):
    """Where a moon is (3 numbers) in m along the axes of K, whose attitude is R_NK.

    Kepler's equation is solved by Newton's method.
    """
    e, size = orbits.eccentricities[moon], orbits.semi_major_axes[moon]
    mean = orbits.anomalies[moon] + 2.0 * math.pi * time / orbits.periods[moon]
    mean -= 2.0 * math.pi * round(mean / (2.0 * math.pi))
    anomaly = mean if e < 0.8 else math.copysign(math.pi, mean)
    for _ in range(_MOST_STEPS):
        step = (anomaly - e * math.sin(anomaly) - mean) / (1.0 - e * math.cos(anomaly))
        anomaly -= step
        if abs(step) < _STEP:
            break
    x = size * (math.cos(anomaly) - e)
    y = size * math.sqrt(1.0 - e * e) * math.sin(anomaly)
    (a, b, _), (c, d, _), (f, g, _) = orbits.axes[moon]
    return _rotated(_inverse(attitude), (a * x + b * y, c * x + d * y, f * x + g * y))


def _orbit_axes(*angles: float) -> np.ndarray:
    """The axes of the orbit (3, 3) in N, in columns; the first goes through the pericentre.

    By the angles of node, inclination and pericentre in degrees.
    """
    (a, b, c), (u, v, w) = np.cos(np.radians(angles)), np.sin(np.radians(angles))
    return np.array(
        [
            [a * c - u * w * b, -a * w - u * c * b, u * v],
            [u * c + a * w * b, -u * w + a * c * b, -a * v],
            [w * v, c * v, b],
        ]
    )


def moon_axes(moon: MoonConfig, time: float, spin: SpinModel) -> Matrix3:
    """R_KM (3, 3): the axes of a moon's mesh in those of K, in columns.

    One side faces the body: x points from the moon to it, z along the orbit's pole. So on an
    ellipse it turns at the pace of its true anomaly, without a libration.
    """
    x = -moon_position(moon, time, spin)
    x /= np.linalg.norm(x)
    z = rotation_matrix(spin.attitude(time)).T @ _orbit_axes(*_ELEMENTS(moon)[-3:])[:, 2]
    return np.column_stack([x, np.cross(z, x), z])


@dataclass(frozen=True)
class Moon:
    """A moon with its surface."""

    config: MoonConfig
    shape: Polyhedron
    """About its centre of mass, in its own axes: see `moon_axes`."""

    def hits(self, start: Vector3, end: Vector3, times: tuple[float, float], spin: Spin) -> bool:
        """Whether a straight way meets the surface.

        Args:
          start, end: (3,) in m from the body's centre of mass, along the axes of K.
          times: in s, at both. spin: how K turns.
        """
        model = spin_model(spin)
        ends = [
            moon_axes(self.config, time, model).T
            @ (place - moon_position(self.config, time, model))
            for place, time in zip((start, end), times, strict=True)
        ]
        way = ends[1] - ends[0]
        length = float(np.linalg.norm(way))
        if length == 0.0:
            return False
        return bool(
            ray_caster(self.shape).distances(np.array(ends[:1]), way[None] / length)[0] <= length
        )

    def distance(
        self, start: Vector3, end: Vector3, times: tuple[float, float], spin: Spin
    ) -> tuple[float, float]:
        """How far from its centre a straight way begins, and passes at least, in m: as `hits`."""
        model = spin_model(spin)
        a, b = (
            place - moon_position(self.config, time, model)
            for place, time in zip((start, end), times, strict=True)
        )
        way = b - a
        square = float(way @ way)
        share = min(max(-float(a @ way) / square, 0.0), 1.0) if square > 0.0 else 0.0
        return float(np.linalg.norm(a)), float(np.linalg.norm(a + share * way))


@functools.lru_cache(maxsize=8)
def ball(radius: float) -> Polyhedron:
    """A ball of a radius in m as a mesh, about the origin: of a moon without a mesh."""
    from scipy.spatial import ConvexHull  # Slow to import.

    points = radius * spread_directions(_POINTS)
    hull = ConvexHull(points)
    facets = hull.simplices.copy()
    outward = np.einsum("fi,fi->f", np.cross(
        points[facets[:, 1]] - points[facets[:, 0]], points[facets[:, 2]] - points[facets[:, 0]]
    ), points[facets[:, 0]])  # fmt: skip
    facets[outward < 0.0] = facets[outward < 0.0][:, ::-1]
    return Polyhedron(points, facets, "ball")


@kernel(error_model="numpy")
def tide_of(mass, moon, position):
    """What a point mass adds to the motion about the body (3 numbers), in m/s^2.

    It is its pull at a position in m less its pull on the body, which falls freely towards it, too.
    `mass` is in kg, `moon` its place in m.
    """
    (a, b, c), (p, q, r) = moon, position
    x, y, z = a - p, b - q, c - r
    here = GRAVITATIONAL_CONSTANT * mass / (x * x + y * y + z * z) ** 1.5
    there = GRAVITATIONAL_CONSTANT * mass / (a * a + b * b + c * c) ** 1.5
    return here * x - there * a, here * y - there * b, here * z - there * c


@kernel(error_model="numpy")
def _tide(masses, orbits, attitude, time, position):
    """That of all moons at a time in s: see `tide_of`."""
    x = y = z = 0.0
    for moon in range(masses.size):
        a, b, c = tide_of(masses[moon], _place(orbits, moon, attitude, time), position)
        x, y, z = x + a, y + b, z + c
    return x, y, z


def tides(moons: Sequence[MoonConfig], times: Values, positions: Vectors3) -> Vectors3:
    """What moons add to the motion about the body (N, 3), in m/s^2 along the axes of N.

    Args:
      moons: the moons. times: (N,) in s. positions: (N, 3) in m along the same axes.
    """
    masses, orbits = np.array([moon.mass_kg for moon in moons]), _orbits_of(*map(_ELEMENTS, moons))
    unturned = (1.0, 0.0, 0.0, 0.0)
    return np.array(
        [
            _tide(masses, orbits, unturned, float(time), position)
            for time, position in zip(times, positions, strict=True)
        ]
    )


def later(moon: MoonConfig, time: float, axes: Matrix3) -> MoonConfig:
    """A moon as it is told from a time in s on, by axes (3, 3) that are in the columns, in N."""
    orbit = axes.T @ _orbit_axes(*_ELEMENTS(moon)[-3:])
    across = math.hypot(orbit[0, 2], orbit[1, 2])
    node, pericentre = math.atan2(orbit[0, 2], -orbit[1, 2]), math.atan2(orbit[2, 0], orbit[2, 1])
    if across < 1e-9:  # In the equator, where there is no node.
        node, pericentre = 0.0, math.atan2(orbit[1, 0], orbit[0, 0])
    return dc.replace(
        moon,
        inclination_deg=math.degrees(math.atan2(across, orbit[2, 2])),
        node_deg=math.degrees(node),
        pericentre_deg=math.degrees(pericentre),
        mean_anomaly_deg=math.remainder(
            moon.mean_anomaly_deg + 360.0 * time / moon.period_s, 360.0
        ),
    )


def greatest_tide(
    moons: Sequence[MoonConfig], far: float, depths: Sequence[float] | None = None
) -> float:
    """A bound of the tide of moons in m/s^2, outside an ellipsoid and up to a distance.

    It is that on the line to each moon, as near as it comes; inf where a moon comes as near.

    Args:
      moons: the moons. far: the distance, in m from the body.
      depths: how far in m each moon is always inside of the ellipsoid; 0: it is not. None: 0.
    """
    total = 0.0
    for moon, depth in zip(moons, depths or [0.0] * len(moons), strict=True):
        nearest = moon.semi_major_axis_m * (1.0 - moon.eccentricity)
        if depth > 0.0:
            pull = 1.0 / depth**2 + 1.0 / nearest**2
        elif nearest <= far:
            return math.inf
        else:
            pull = 1.0 / (nearest - far) ** 2 - 1.0 / nearest**2
        total += GRAVITATIONAL_CONSTANT * moon.mass_kg * pull
    return total


class Moons(LeafSystem):
    """The tide of moons, which go round the body.

    ```
                       ┌───────┐
    position (3), m ──►│ Moons ├─► acceleration (3), m/s^2
                       └───────┘
    ```

    All vectors are along the axes of K; the position is that of the spacecraft from the body's
    centre of mass. The moons move as the time says, and nothing moves them but the body.
    """

    def __init__(self, moons: list[MoonConfig], spin: Spin):
        """Takes the moons, and how K turns."""
        super().__init__()
        self.moons, self.spin = moons, spin_model(spin)
        self._masses = np.array([moon.mass_kg for moon in moons])
        self._orbits = _orbits_of(*map(_ELEMENTS, moons))
        self._port = self.DeclareVectorInputPort("position", 3)
        self.DeclareVectorOutputPort(
            "acceleration", 3, self._calc, {self._port.ticket(), self.time_ticket()}
        )

    def _calc(self, context, output):
        position, time = self._port.Eval(context), context.get_time()
        attitude = self.spin.attitude(time)
        output.SetFromVector(_tide(self._masses, self._orbits, attitude, time, position))
