"""Places on a map that can be touched: slope, roughness, room, hover thrust, free way and light.

A place is a point of the map's surface, about which a disc of `SiteLimits.radius_m` is looked at.
The plane that lies closest to the surface in this disc is the place's tangent plane, and its normal
the direction from which the place is approached. Everything is in K.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from proxops.systems.common import InputError, Values, Vector3, Vectors3, config, number
from proxops.systems.shapes import Polyhedron, ray_caster

# Points of the disc; and rays along the cone of the free way, on rings of these shares of its
# half-angle.
_POINTS, _AROUND, _RINGS = 61, 24, (1.0 / 3.0, 2.0 / 3.0, 1.0)
# From how far over the disc the surface is looked at, and where the free way begins, in radii.
_OVER, _BEGIN = 4.0, 1e-2
# Places that are measured in one go, to bound the memory.
_BLOCK = 2000
_GOLDEN = np.pi * (3.0 - np.sqrt(5.0))
LIMITS = ("slope", "roughness", "height", "hover", "way", "light")
"""What a place is measured by, in the order of `use_of_limits`."""


@config
class SiteLimits:
    """What a place must be like so that it can be touched."""

    # The disc about the place that must be even: half the span of the spacecraft, and what it may
    # miss the place by.
    radius_m: float = number(5.0, above=0.0, at_most=1e6, unit="m")
    # Greatest angle between the normal and the plumb line.
    slope_deg: float = number(30.0, above=0.0, at_most=180.0, unit="degrees")
    # Greatest rms of the surface about its plane.
    roughness_m: float = number(0.5, above=0.0, at_most=1e6, unit="m")
    # Greatest height of the surface over its plane: what the arm keeps the bus away by.
    height_m: float = number(1.5, above=0.0, at_most=1e6, unit="m")
    # Greatest share of the thrust limit that hovering takes, along any axis.
    hover_share: float = number(0.5, above=0.0, at_most=1.0)
    # The way down: half-angle of a cone about the normal, and its length.
    cone_deg: float = number(20.0, above=0.0, below=90.0, unit="degrees")
    length_m: float = number(125.0, above=0.0, at_most=1e6, unit="m")


class Sites(NamedTuple):
    """N places and what they are like."""

    positions: Vectors3
    """(N, 3) in m: on the surface."""
    normals: Vectors3
    """(N, 3) unit vectors, away from the body, of the tangent planes."""
    slope: Values
    """(N,) in rad: angle between the apparent gravity and the inward normal."""
    roughness: Values
    """(N,) in m: rms of the surface over the tangent plane in the disc."""
    height: Values
    """(N,) in m: the greatest height of the surface over the tangent plane in the disc."""
    hover: Values
    """(N,) in N: the greatest force along an axis of K that hovering takes."""
    free: Values
    """(N,) bool: no other part of the surface reaches into the way down."""
    light: Values
    """(N,) in rad: the Sun's greatest elevation over the tangent plane; pi / 2 without a Sun."""

    @property
    def latitudes(self) -> Values:
        """(N,) in degrees, from the centre of mass."""
        across = np.linalg.norm(self.positions[:, :2], axis=1)
        return np.degrees(np.arctan2(self.positions[:, 2], across))

    @property
    def longitudes(self) -> Values:
        """(N,) in degrees, east of x."""
        return np.degrees(np.arctan2(self.positions[:, 1], self.positions[:, 0]))

    def taken(self, which: Values) -> Sites:
        """The sites of some indices, or of a mask."""
        return Sites(*(column[which] for column in self))


class SiteWorld(NamedTuple):
    """What places are measured in, besides the surface."""

    acceleration: Callable[[Vectors3], Vectors3]
    """The apparent gravity (N, 3) in m/s^2 at positions (N, 3): gravity and centrifugal."""
    mass: float
    """Of the spacecraft, in kg."""
    suns: Vectors3
    """(M, 3) unit vectors to the Sun at the times that are looked at; M may be 0: no Sun."""


def map_sites(
    shape: Polyhedron, limits: SiteLimits, world: SiteWorld, most: int = 6000
) -> tuple[Sites, Values]:
    """Measures a map at the middles of its facets.

    Args:
      shape: the map. limits: they say what is looked at. world: gravity, spacecraft and Sun.
      most: facets that are looked at; of a map that has more, one in so many.

    Returns:
      The places, and the facets (N,) in whose middles they are.
    """
    step = -(-len(shape.facets) // most)
    facets = np.arange(0, len(shape.facets), step)
    middles = shape.vertices[shape.facets[facets]].mean(axis=1)
    return measured_sites(shape, middles, shape.normals[facets], limits, world), facets


def measured_sites(
    shape: Polyhedron, positions: Vectors3, normals: Vectors3, limits: SiteLimits, world: SiteWorld
) -> Sites:
    """Measures places.

    Args:
      shape: the map. positions, normals: (N, 3) on its surface, in m, and of the facets there.
      limits: they say what is looked at. world: gravity, spacecraft and Sun.
    """
    parts = []
    for first in range(0, len(positions), _BLOCK):
        block = slice(first, first + _BLOCK)
        parts.append(_measured(shape, positions[block], normals[block], limits))
    normals, roughness, height, free = (np.concatenate(part) for part in zip(*parts, strict=True))
    apparent = world.acceleration(positions)
    # Both products, because an arc cosine would lose the digits of small slopes.
    along = -np.einsum("ni,ni->n", apparent, normals)
    across = np.linalg.norm(np.cross(apparent, normals), axis=1)
    light = np.full(len(positions), np.pi / 2.0)
    if len(world.suns):
        light = np.arcsin(np.clip((normals @ world.suns.T).max(axis=1), -1.0, 1.0))
    hover = world.mass * np.abs(apparent).max(axis=1)
    slope = np.arctan2(across, along)
    return Sites(positions, normals, slope, roughness, height, hover, free, light)


def _measured(
    shape: Polyhedron, positions: Vectors3, normals: Vectors3, limits: SiteLimits
) -> tuple[Vectors3, Values, Values, Values]:
    """Normal, roughness, height and free way of some places: see `Sites`."""
    caster, count = ray_caster(shape), len(positions)
    first, second = tangents(normals)
    # Even over the disc: Vogel's spiral.
    turns, radii = np.arange(_POINTS), np.sqrt((np.arange(_POINTS) + 0.5) / _POINTS)
    flat = limits.radius_m * np.stack(
        [radii * np.cos(_GOLDEN * turns), radii * np.sin(_GOLDEN * turns)], axis=1
    )
    over = _OVER * limits.radius_m
    across = flat[:, 0, None] * first[:, None] + flat[:, 1, None] * second[:, None]
    starts = positions[:, None] + across + over * normals[:, None]
    down = np.repeat(-normals, _POINTS, axis=0)
    # What goes down further than that counts as so deep.
    reached = np.minimum(caster.distances(starts.reshape(-1, 3), down), 2.0 * over)
    heights = over - reached.reshape(count, _POINTS)
    terms = np.column_stack([flat, np.ones(_POINTS)])
    planes = heights @ np.linalg.pinv(terms).T
    steep = np.sqrt(1.0 + planes[:, 0] ** 2 + planes[:, 1] ** 2)
    rest = (heights - planes @ terms.T) / steep[:, None]
    fitted = normals - planes[:, :1] * first - planes[:, 1:2] * second
    fitted /= steep[:, None]
    free = _free(caster, positions, fitted, limits)
    return fitted, np.sqrt(np.mean(rest**2, axis=1)), rest.max(axis=1), free


def _free(caster, positions: Vectors3, normals: Vectors3, limits: SiteLimits) -> Values:
    """(N,) bool: whether rays along cones about the normals meet nothing."""
    first, second = tangents(normals)
    angles = 2.0 * np.pi * np.arange(_AROUND) / _AROUND
    way = np.ones(len(positions), dtype=bool)
    starts = np.repeat(positions + _BEGIN * limits.radius_m * normals, _AROUND, axis=0)
    for share in _RINGS:
        tilt = np.radians(limits.cone_deg) * share
        rays = np.cos(tilt) * normals[:, None] + np.sin(tilt) * (
            np.cos(angles)[:, None] * first[:, None] + np.sin(angles)[:, None] * second[:, None]
        )
        met = caster.distances(starts, rays.reshape(-1, 3)).reshape(-1, _AROUND)
        way &= (met * np.cos(tilt) > limits.length_m).all(axis=1)
    return way


def tangents(normals: Vectors3) -> tuple[Vectors3, Vectors3]:
    """Two unit vectors (N, 3) each that make a right-handed frame with unit normals (N, 3)."""
    axis = np.eye(3)[np.abs(normals).argmin(axis=1)]
    first = np.cross(axis, normals)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    return first, np.cross(normals, first)


def use_of_limits(sites: Sites, limits: SiteLimits, thrust: float) -> np.ndarray:
    """How much of each limit places use: (N, 6), in the order of `LIMITS`.

    A place can be touched if nothing is above 1. Way and light are 0, or infinite where it has
    none.

    Args:
      sites: the places. limits: of them. thrust: the limit along an axis in N.
    """
    none = np.array([0.0, np.inf])
    return np.column_stack(
        [
            np.degrees(sites.slope) / limits.slope_deg,
            sites.roughness / limits.roughness_m,
            np.maximum(sites.height, 0.0) / limits.height_m,
            sites.hover / (limits.hover_share * thrust),
            none[np.where(sites.free, 0, 1)],
            none[np.where(sites.light > 0.0, 0, 1)],
        ]
    )


def best_sites(sites: Sites, use: np.ndarray, count: int, apart: float) -> Values:
    """Indices (K,) of the best places, the best first, K at most `count`.

    The best is the one that stays the farthest from its limits: whose greatest use of one is least.

    Args:
      sites: the places. use: (N, 6), `use_of_limits`. apart: least distance of two, in m.
    """
    worst = use.max(axis=1)
    order = np.argsort(worst, kind="stable")
    found: list[int] = []
    for k in order[worst[order] <= 1.0].tolist():
        away = np.linalg.norm(sites.positions[found] - sites.positions[k], axis=1)
        if (away >= apart).all():
            found.append(k)
        if len(found) == count:
            break
    return np.array(found, dtype=np.int64)


def why_not(sites: Sites, use: np.ndarray, k: int, limits: SiteLimits, thrust: float) -> list[str]:
    """What place number k lacks so that it can be touched, each in words; empty: it can be."""
    share = limits.hover_share
    words = (
        f"its slope is {np.degrees(sites.slope[k]):.1f}°, above {limits.slope_deg:g}°",
        f"its roughness is {sites.roughness[k]:.2g} m, above {limits.roughness_m:g} m",
        f"terrain stands {sites.height[k]:.2g} m over its plane, above {limits.height_m:g} m",
        f"hovering takes {sites.hover[k]:.3g} N along an axis, above {share:g} of {thrust:g} N",
        f"terrain reaches into a cone of {limits.cone_deg:g}° over it: it is in a concavity",
        "the Sun never rises there",
    )
    return [text for text, used in zip(words, use[k], strict=True) if used > 1.0]


def nearest_site(sites: Sites, use: np.ndarray, position: Vector3) -> int | None:
    """Index of the place that can be touched and is nearest to a position (3,) in m; None: none."""
    can = np.flatnonzero(use.max(axis=1) <= 1.0)
    if not can.size:
        return None
    return int(can[np.linalg.norm(sites.positions[can] - position, axis=1).argmin()])


def place_below(shape: Polyhedron, latitude: float, longitude: float) -> tuple[Vector3, int]:
    """The outermost point (3,) of a map in a direction from the origin of K, and its facet.

    Args:
      shape: the map. latitude: in degrees. longitude: in degrees, east of x.

    Raises:
      InputError: the latitude is beyond 90 degrees, or the map has no surface there.
    """
    if not (abs(latitude) <= 90.0 and abs(longitude) <= 360.0):
        raise InputError(
            f"latitude {latitude:g}°, longitude {longitude:g}°: they must be -90 to 90 and -360 "
            "to 360"
        )
    north, east = np.radians([latitude, longitude])
    out = np.array([np.cos(north) * np.cos(east), np.cos(north) * np.sin(east), np.sin(north)])
    start = 2.0 * float(np.linalg.norm(shape.vertices, axis=1).max()) * out
    found = ray_caster(shape).first_hits(start, -out[None])
    if found.facets[0] < 0:
        raise InputError(f"the map has no surface at {latitude:g}°, {longitude:g}°")
    return start - found.distances[0] * out, int(found.facets[0])


def place_near(shape: Polyhedron, position: Vector3, tolerance: float) -> tuple[Vector3, int]:
    """The point (3,) of a map that is nearest to a position (3,) in m, and its facet.

    Raises:
      InputError: it is farther away than a tolerance in m; the message gives it.
    """
    points = nearest_points(shape.vertices[shape.facets], position)
    away = np.linalg.norm(points - position, axis=1)
    facet = int(away.argmin())
    if away[facet] > tolerance:
        there = ", ".join(f"{x:.2f}" for x in points[facet])
        raise InputError(
            f"the position is {away[facet]:.4g} m off the map, whose nearest point is {there} m"
        )
    return points[facet], facet


def nearest_points(corners: np.ndarray, position: Vector3) -> Vectors3:
    """The nearest point (F, 3) of each facet, with corners (F, 3, 3), to a position (3,)."""
    import trimesh  # It is slow to import, so only when it is needed.

    return trimesh.triangles.closest_point(corners, np.tile(position, (len(corners), 1)))
