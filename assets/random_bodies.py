"""Generates bodies: a mesh, a density and a spin that are functions of (seed, number) alone.

Each body begins as a smooth surface around an axis: rings whose radii follow a meridian. It is an
ellipsoid, two lobes joined by a neck, or a top with a ridge around its equator. Relief of several
lengths is added along its normals. Densities and spin periods are those of asteroids.
"""

from __future__ import annotations

import dataclasses as dc
import typing
from typing import NamedTuple

import numpy as np
from scipy.spatial.distance import cdist

from proxops.assets.loft import FloatArray, IntArray, geodesic_capsule

if typing.TYPE_CHECKING:
    import trimesh

ELLIPSOID, BINARY, TOP = "lumpy ellipsoid", "contact binary", "top"
KINDS = (ELLIPSOID, BINARY, TOP)
# Shares of the kinds among the bodies.
_SHARES = (0.4, 0.4, 0.2)
# Longest extent in m and density in kg/m^3; both are drawn log-uniformly.
_LENGTHS, _DENSITIES = (200.0, 200e3), (1000.0, 4500.0)
# Spin periods in h, log-uniform. Almost no body longer than 200 m spins faster than the first
# (P. Pravec & A. W. Harris, Icarus 148 (2000)).
_PERIODS = (2.2, 60.0)
# Greatest ratio of the centrifugal acceleration to gravity, anywhere on the surface.
BREAK_UP_SHARE = 0.9
_MOST_FACETS = 2000
_GRAVITY = 6.6743e-11
# The integral of 1 / distance from a corner of an equilateral triangle, over area / distance of its
# centroid.
_CORNER = 4.0 * np.arcsinh(np.sqrt(1.0 / 3.0)) / np.sqrt(3.0)
# Waves that relief is the sum of.
_WAVES = 16
# Points along a meridian, from which its rings are interpolated.
_STATIONS = 4001
# A ring's distance from the next, over its radius, times the number of rings in a cap: a net with
# these distances has equilateral facets.
_ROW = 0.4 * np.pi * np.sqrt(0.75)


@dc.dataclass(frozen=True)
class RandomBody:
    """A generated body of uniform density.

    The origin is the centre of mass. x, y and z are the principal axes, from the least to the
    greatest moment of inertia, and the body spins about z.
    """

    name: str
    kind: str
    """One of `KINDS`."""
    vertices: FloatArray
    """(V, 3) in m."""
    facets: IntArray
    """(F, 3), indices of vertices, counter-clockwise seen from outside; 1,000 to 2,000."""
    density_kg_m3: float
    rotation_period_h: float


class _Tube(NamedTuple):
    """A surface around an axis: sections from tip to tip, in any unit; each column is (S,).

    A section's point at the azimuth A is (along, side + radius wide cos A, up + radius high sin A).
    """

    along: FloatArray
    radius: FloatArray
    wide: FloatArray
    high: FloatArray
    side: FloatArray
    up: FloatArray


def random_body(seed: int, number: int) -> RandomBody:
    """Generates body number `number` of a seed.

    The result depends on the arguments alone, up to what numpy's libraries for linear algebra leave
    open: last bits, and half turns about a principal axis.

    Args:
      seed: seed of the family, from 0 to 2^64 - 1.
      number: number of the body in it, in the same range.

    Raises:
      ValueError: one of them is not in the range.
    """
    if not (0 <= seed < 2**64 and 0 <= number < 2**64):
        raise ValueError(f"seed and number must be from 0 to 2^64 - 1, got {seed} and {number}")
    key = np.array([seed, number], dtype=np.uint64)
    random = np.random.Generator(np.random.Philox(key=key))
    kind = KINDS[int(random.choice(len(KINDS), p=_SHARES))]
    mesh = {ELLIPSOID: _ellipsoid, BINARY: _contact_binary, TOP: _top}[kind](random)
    vertices = _on_principal_axes(mesh)
    vertices *= _log_uniform(random, *_LENGTHS) / np.ptp(vertices, axis=0).max()
    density = _log_uniform(random, *_DENSITIES)
    shortest = max(_PERIODS[0], shortest_period_h(vertices, mesh.faces, density))
    return RandomBody(
        name=f"random-{seed}-{number}",
        kind=kind,
        vertices=vertices,
        facets=np.array(mesh.faces),
        density_kg_m3=density,
        rotation_period_h=_log_uniform(random, shortest, _PERIODS[1]),
    )


def relief(
    points: FloatArray,
    random: np.random.Generator,
    wave_numbers: tuple[float, float] = (3.0, 9.0),
) -> FloatArray:
    """A smooth random function (N,) of points (N, 3); its root mean square is about 1.

    Args:
      points: (N, 3) in any unit.
      random: draws the waves.
      wave_numbers: the least and the greatest, in rad per unit of the points.
    """
    ways = random.standard_normal((_WAVES, 3))
    ways *= random.uniform(*wave_numbers, (_WAVES, 1)) / np.linalg.norm(ways, axis=1, keepdims=True)
    phases = random.uniform(0.0, 2.0 * np.pi, _WAVES)
    return np.sqrt(2.0 / _WAVES) * np.cos(points @ ways.T + phases).sum(axis=1)


def shortest_period_h(vertices: FloatArray, facets: IntArray, density: float) -> float:
    """The period in h at which centrifugal acceleration reaches `BREAK_UP_SHARE` of gravity.

    The sizes of both are compared at the vertices. By Gauss's theorem a body of uniform density has
    at x the gravity -G density ∮ n / |x - y| dS. Each facet counts as if its area were at its
    centroid. A facet that has x as a corner counts more by the factor that holds for an equilateral
    one. For bodies of `random_body` the ratio at the period is 0.88 to 0.90 of exact gravity.

    Args:
      vertices: (V, 3) in m, about the centre of mass; the spin axis is z.
      facets: (F, 3), outward, about equilateral.
      density: in kg/m^3.
    """
    corners = vertices[facets]
    doubled = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    inverse = 1.0 / cdist(vertices, corners.mean(axis=1))
    inverse[facets, np.arange(len(facets))[:, None]] *= _CORNER
    gravity = -_GRAVITY * density * inverse @ (0.5 * doubled)
    arms = np.linalg.norm(vertices[:, :2], axis=1)
    rate = np.sqrt(BREAK_UP_SHARE * (np.linalg.norm(gravity, axis=1) / arms).min())
    return float(2.0 * np.pi / rate / 3600.0)


def _ellipsoid(random: np.random.Generator) -> trimesh.Trimesh:
    """A lumpy ellipsoid, from 1:1:1 to 4:1:1; its mean thickness is 2."""
    longest = _log_uniform(random, 1.0, 4.0)
    flat = np.sqrt(random.uniform(1.0, min(longest, 1.5)))
    angle = np.linspace(0.0, np.pi, _STATIONS)
    one, none = np.ones(_STATIONS), np.zeros(_STATIONS)
    along, radius = -longest / flat * np.cos(angle), np.sin(angle)
    tube = _Tube(along, radius, flat * one, one / flat, none, none)
    return _with_relief(_mesh(tube), random, random.uniform(0.02, 0.09), random.uniform(0.01, 0.03))


def _top(random: np.random.Generator) -> trimesh.Trimesh:
    """A top: a ball, somewhat flattened, with a ridge around its equator; the axis is that of z.

    The ridge falls off with the latitude b as exp(-sqrt(b² + r²) / w): its crest has the radius r.
    """
    colatitude = np.linspace(0.0, np.pi, _STATIONS)
    latitude = 0.5 * np.pi - colatitude
    height, width, crest = random.uniform(0.08, 0.35), random.uniform(0.25, 0.6), 0.12
    distance = 1.0 + height * np.exp((crest - np.hypot(latitude, crest)) / width)
    thick = random.uniform(0.8, 1.0)
    oval = np.sqrt(random.uniform(1.0, 1.15))
    one, none = np.ones(_STATIONS), np.zeros(_STATIONS)
    along, radius = -distance * thick * np.cos(colatitude), distance * np.sin(colatitude)
    radius[[0, -1]] = 0.0
    tube = _Tube(along, radius, oval * one, one / oval, none, none)
    return _with_relief(_mesh(tube), random, random.uniform(0.0, 0.03), random.uniform(0.01, 0.03))


def _contact_binary(random: np.random.Generator) -> trimesh.Trimesh:
    """Two lobes, ellipsoids of revolution before they are bent, and a neck between them.

    The greater lobe has the radius 1 about the axis. The lobes overlap, nearly touch, or are held
    apart by the neck. Within the neck their flattening changes; both ends may bend to one side.
    """
    small = random.uniform(0.5, 1.0)
    half = np.array([1.0, small]) * random.uniform(1.0, 1.6, 2)
    centres = np.array([0.0, half.sum() * random.uniform(0.75, 1.5)])
    neck = small * random.uniform(0.3, 0.7)
    start, end = centres[0] - half[0], centres[1] + half[1]
    along = 0.5 * (start + end) - 0.5 * (end - start) * np.cos(np.linspace(0, np.pi, _STATIONS))
    middle, reach = centres.mean(), 0.5 * (centres[1] - centres[0])
    parts = [
        size * np.sqrt(np.maximum(0.0, 1.0 - ((along - place) / length) ** 2))
        for size, place, length in (
            (1.0, centres[0], half[0]), (small, centres[1], half[1]), (neck, middle, reach),
        )
    ]  # fmt: skip
    radius = np.sum(np.power(parts, 8.0), axis=0) ** 0.125
    radius[[0, -1]] = 0.0
    offset = (along - 0.5 * (centres[0] + half[0] + centres[1] - half[1])) / reach
    flats = np.sqrt(random.uniform(1.0, 1.4, 2))
    wide = flats[0] + (flats[1] - flats[0]) * (0.5 + 0.5 * np.tanh(2.0 * offset))
    bend = random.uniform(0.0, 0.8) * small * (np.hypot(offset, 0.5) - 0.5)
    up = random.uniform(-0.3, 0.3) * neck * np.tanh(2.0 * offset)
    return _with_relief(
        _mesh(_Tube(along, radius, wide, 1.0 / wide, bend, up)),
        random,
        small * random.uniform(0.01, 0.05),
        small * random.uniform(0.01, 0.02),
    )


def _mesh(tube: _Tube) -> trimesh.Trimesh:
    """The tube as a net of rings; the distance between rings is in proportion to their radii.

    So the facets are about equilateral. Near a tip, where rings have ever fewer vertices, the
    distances are equal.
    """
    import trimesh  # It is slow to import, so only when it is needed.

    along, radius = tube.along, tube.radius * np.sqrt(tube.wide * tube.high)
    steps = np.hypot(np.diff(along), np.diff(radius))
    length = np.concatenate([[0.0], np.cumsum(steps)])
    from_end = length[-1] - length
    # Where the caps end: there the distances on both sides are equal.
    first = int(np.argmax(length > _ROW * np.maximum(radius, 1e-12)))
    last = _STATIONS - 1 - int(np.argmax((from_end > _ROW * np.maximum(radius, 1e-12))[::-1]))
    first, last = max(first, 1), min(last, _STATIONS - 2)
    inner = np.concatenate([[0.0], np.cumsum(steps[first:last] / radius[first + 1 : last + 1])])
    rows = inner[-1] / _ROW
    cap = int(np.sqrt(0.1 * _MOST_FACETS / (1.0 + rows)))
    band = 2 * max(1, int(0.5 * cap * rows))
    ring, azimuth, facets = geodesic_capsule(cap, band)
    places = np.concatenate([
        np.linspace(0.0, length[first], cap + 1)[:-1],
        np.interp(np.linspace(0.0, inner[-1], band + 1), inner, length[first : last + 1]),
        np.linspace(length[last], length[-1], cap + 1)[1:],
    ])  # fmt: skip
    sections = _Tube(*(np.interp(places, length, column)[ring] for column in tube))
    vertices = np.stack([
        sections.along,
        sections.side + sections.radius * sections.wide * np.cos(azimuth),
        sections.up + sections.radius * sections.high * np.sin(azimuth),
    ], axis=1)  # fmt: skip
    return trimesh.Trimesh(vertices, facets, process=False)


def _with_relief(
    mesh: trimesh.Trimesh, random: np.random.Generator, lumps: float, rough: float
) -> trimesh.Trimesh:
    """The mesh with relief along its normals; heights are cut smoothly at twice their size.

    Args:
      mesh: a smooth surface; its thickness is about 2.
      random: draws the relief.
      lumps: root mean square of the long waves.
      rough: that of the shorter ones; the shortest are half as long as the body is thick, and have
        half of the height.
    """
    import trimesh  # It is slow to import, so only when it is needed.

    heights = [
        (lumps, (1.2, 2.8)), (rough, (3.0, 5.5)), (0.5 * rough, (6.0, 11.0)),
    ]  # fmt: skip
    moved = np.zeros(len(mesh.vertices))
    for size, numbers in heights:
        moved += 2.0 * size * np.tanh(0.5 * relief(mesh.vertices, random, numbers))
    return trimesh.Trimesh(
        mesh.vertices + moved[:, None] * mesh.vertex_normals, mesh.faces, process=False
    )


def _on_principal_axes(mesh: trimesh.Trimesh) -> FloatArray:
    """The vertices (V, 3) about the centre of mass, the greatest moment of inertia about z."""
    _, columns = np.linalg.eigh(mesh.moment_inertia)
    columns[:, 1] *= np.sign(np.linalg.det(columns))
    return (np.asarray(mesh.vertices) - mesh.center_mass) @ columns


def _log_uniform(random: np.random.Generator, low: float, high: float) -> float:
    return float(low * (high / low) ** random.random())
