"""Compiled kernel of beams: the point of a mesh that is nearest in a cone about each ray.

Many functions share these arguments:

* ``p``: the position (3,) in m. ``d``: the unit direction (3 numbers) of a beam's axis.
* ``cone``: a `Cone`. ``mesh``: a `Mesh`. ``lidar``: a `Fan`. ``work``: a `_Work`.
"""

import math
from typing import NamedTuple

import numpy as np

from proxops.systems.common import kernel, turned_vector


class Cone(NamedTuple):
    """Of the cone's half angle."""

    sine: float
    cosine: float
    tangent2: float
    """Squared tangent."""


class Mesh(NamedTuple):
    """A closed surface."""

    vertices: np.ndarray
    """(V, 3) in m."""
    facets: np.ndarray
    normals: np.ndarray
    """(F, 3) each; outward unit normals."""
    neighbours: np.ndarray
    """(F, 3) the facets across each facet's edges, of which edge k runs from corner k to the
    next."""
    levels: np.ndarray
    """(F,) n.v of each facet."""
    ends: np.ndarray
    beside: np.ndarray
    """(E, 2) ends and facets of each edge."""


class Fan(NamedTuple):
    """The rays as they leave the lidar."""

    directions: np.ndarray
    """(planes, rays, 3) in S, evenly spaced in each plane from the xy-plane on, or pixels."""
    half: float
    """Half of a beam's full angle, in rad."""
    spread: float
    """Of pixels: the tangent of half the field of view about z; 0: planes all around."""


class _Work(NamedTuple):
    """Room to work in, for each facet (F,)."""

    faces: np.ndarray
    """Whether it faces the position."""
    seen: np.ndarray
    """The last mark that it got."""
    queue: np.ndarray


_compiled = kernel(error_model="numpy")
_inlined = kernel(error_model="numpy", forceinline=True)


@_inlined
def _from(v, p, vertices):
    """A vertex as seen from the position."""
    return vertices[v, 0] - p[0], vertices[v, 1] - p[1], vertices[v, 2] - p[2]


@_inlined
def _edge_range(a, e, d, tan2):
    """Distance to the nearest point in the cone of a + s e, 0 <= s <= 1; +inf if there is none.

    A point x is in the cone if |x|² - (x·d)² <= tan² (x·d)²: a quadratic in s.
    """
    (ax, ay, az), (ex, ey, ez), (dx, dy, dz) = a, e, d
    ad, ed = ax * dx + ay * dy + az * dz, ex * dx + ey * dy + ez * dz
    aa, ae = ax * ax + ay * ay + az * az, ax * ex + ay * ey + az * ez
    ee, grow = ex * ex + ey * ey + ez * ez, 1.0 + tan2
    second, first = ee - grow * ed * ed, ae - grow * ad * ed
    zeroth = aa - grow * ad * ad
    root2 = first * first - second * zeroth
    # The line passes the cone by, or runs along its side.
    if second == 0.0 or (second > 0.0 and root2 < 0.0):
        return math.inf
    root = math.sqrt(max(root2, 0.0))
    low, high = (-first - root) / second, (-first + root) / second
    if second < 0.0:
        # The line leaves the cone through neither side: it is inside from its only entry on.
        low, high = (low, math.inf) if ed > 0.0 else (-math.inf, high)
    low, high = max(low, 0.0), min(high, 1.0)
    # The quadratic cone has a second half behind the position.
    if not low <= high or ad + 0.5 * (low + high) * ed <= 0.0:
        return math.inf
    s = min(max(-ae / ee, low), high)
    return math.sqrt(max(aa + s * (2.0 * ae + s * ee), 0.0))


@_inlined
def _plane_range(f, p, d, cone, mesh):
    """Distance to the plane of a facet in the cone; +inf if the nearest point is off the facet.

    The nearest direction in the cone is the axis turned towards the plane's normal, by the cone's
    half angle at most.
    """
    vertices, facets, normals = mesh.vertices, mesh.facets, mesh.normals
    dx, dy, dz = d
    nx, ny, nz = normals[f, 0], normals[f, 1], normals[f, 2]
    ax, ay, az = _from(facets[f, 0], p, vertices)
    height = nx * ax + ny * ay + nz * az
    if height < 0.0:
        nx, ny, nz, height = -nx, -ny, -nz, -height
    across = nx * dx + ny * dy + nz * dz
    if across >= cone.cosine:
        ux, uy, uz, closing = nx, ny, nz, 1.0
    else:
        # Of the normal's part across the axis, |part| = rest.
        rest = math.sqrt(1.0 - across * across)
        closing = across * cone.cosine + rest * cone.sine
        if not (rest > 0.0 and closing > 0.0):
            return math.inf
        turn = cone.sine / rest
        keep = cone.cosine - turn * across
        ux, uy, uz = keep * dx + turn * nx, keep * dy + turn * ny, keep * dz + turn * nz
    positive = negative = False
    for k in range(3):
        ax, ay, az = _from(facets[f, k], p, vertices)
        bx, by, bz = _from(facets[f, (k + 1) % 3], p, vertices)
        side = (ay * bz - az * by) * ux + (az * bx - ax * bz) * uy + (ax * by - ay * bx) * uz
        positive, negative = positive or side > 0.0, negative or side < 0.0
    return math.inf if positive and negative else height / closing


@_compiled
def _patch_range(seed, mark, p, d, cone, mesh, work):
    """Distance to the nearest point in the cone of the surface that is connected to a facet in it.

    It goes from facet to facet across each edge that the cone touches, as long as facets turn the
    same side to the position. `work.seen` gets the mark, another one for each call.
    """
    vertices, facets, neighbours = mesh.vertices, mesh.facets, mesh.neighbours
    faces, seen, queue = work
    nearest = math.inf
    queue[0], seen[seed], count, done = seed, mark, 1, 0
    while done < count:
        f = queue[done]
        done += 1
        nearest = min(nearest, _plane_range(f, p, d, cone, mesh))
        for k in range(3):
            ax, ay, az = _from(facets[f, k], p, vertices)
            bx, by, bz = _from(facets[f, (k + 1) % 3], p, vertices)
            reach = _edge_range((ax, ay, az), (bx - ax, by - ay, bz - az), d, cone.tangent2)
            if reach < math.inf:
                nearest = min(nearest, reach)
                g = neighbours[f, k]
                if seen[g] != mark and faces[g] == faces[seed]:
                    queue[count], seen[g] = g, mark
                    count += 1
    return nearest


@_inlined
def _rays_beside(a, b, cosine, sine, half, slab, spacing):
    """The rays of one plane, first and last, in whose cones the segment from a to b may lie.

    a and b are in S. The part of the segment that lies within `slab` of the plane is cut out; it
    sweeps less than half a turn about the plane's axis. (0, -1) means no ray.
    """
    off_a, off_b = cosine * a[1] - sine * a[0], cosine * b[1] - sine * b[0]
    if min(off_a, off_b) > slab or max(off_a, off_b) < -slab:
        return 0, -1
    low, high = 0.0, 1.0
    if off_a != off_b:
        one, other = (-slab - off_a) / (off_b - off_a), (slab - off_a) / (off_b - off_a)
        low, high = max(low, min(one, other)), min(high, max(one, other))
    flat_a, flat_b = cosine * a[0] + sine * a[1], cosine * b[0] + sine * b[1]
    start = math.atan2(a[2] + low * (b[2] - a[2]), flat_a + low * (flat_b - flat_a))
    stop = math.atan2(a[2] + high * (b[2] - a[2]), flat_a + high * (flat_b - flat_a))
    sweep = stop - start
    if sweep > math.pi:
        sweep -= 2.0 * math.pi
    elif sweep < -math.pi:
        sweep += 2.0 * math.pi
    start += min(sweep, 0.0)
    first = math.ceil((start - half) / spacing)
    return first, math.floor((start + abs(sweep) + half) / spacing)


@_inlined
def _pixels_beside(a, b, count, spread, margin):
    """The pixels along one axis, first and last, in whose cones a segment may lie.

    a and b are its ends along the axis, over those along z. (0, -1) means no pixel.
    """
    scale = 0.5 * count / spread
    first = math.ceil((min(a, b) - margin) * scale + 0.5 * (count - 1.0))
    last = math.floor((max(a, b) + margin) * scale + 0.5 * (count - 1.0))
    return max(first, 0), min(last, count - 1)


@_compiled
def _follow_axes(pose, fan, cone, mesh, work, hits, ranges):
    """Shortens ranges by the surfaces that the axes meet."""
    (p, rotation), (hit_rays, hit_facets) = pose, hits
    rays = fan.shape[1]
    for k in range(len(hit_rays)):
        ray = hit_rays[k]
        i, j = ray // rays, ray % rays
        d = turned_vector(rotation, fan[i, j, 0], fan[i, j, 1], fan[i, j, 2])
        reach = _patch_range(hit_facets[k], k, p, d, cone, mesh, work)
        ranges[ray] = min(ranges[ray], reach)


@_compiled
def _follow_silhouettes(pose, lidar, cone, mesh, work, ranges):
    """Shortens ranges by the surfaces whose silhouettes lie in a cone."""
    (p, rotation), fan, half, spread = pose, lidar.directions, lidar.half, lidar.spread
    vertices, ends, beside, faces = mesh.vertices, mesh.ends, mesh.beside, work.faces
    planes, rays, _ = fan.shape
    spacing, back, mark = 2.0 * math.pi / rays, rotation.T, planes * rays
    # How far a cone reaches across the flat field at its corners.
    corner = math.sqrt(2.0) * spread
    margin = math.tan(min(math.atan(corner) + half, 1.57)) - corner
    for e in range(len(ends)):
        one, other = beside[e, 0], beside[e, 1]
        if faces[one] == faces[other]:
            continue
        ax, ay, az = turned_vector(back, *_from(ends[e, 0], p, vertices))
        bx, by, bz = turned_vector(back, *_from(ends[e, 1], p, vertices))
        far2 = max(ax * ax + ay * ay + az * az, bx * bx + by * by + bz * bz)
        slab = cone.sine * math.sqrt(far2)
        low, high, first, last = 0, planes - 1, 0, rays - 1
        if spread > 0.0:
            if max(az, bz) <= 0.0:
                continue
            # An edge that passes the lidar by may be seen anywhere.
            if min(az, bz) > 0.0:
                low, high = _pixels_beside(ax / az, bx / bz, planes, spread, margin)
                first, last = _pixels_beside(ay / az, by / bz, rays, spread, margin)
        for i in range(low, high + 1):
            if spread == 0.0:
                first, last = _rays_beside(
                    (ax, ay, az), (bx, by, bz), fan[i, 0, 0], fan[i, 0, 1], half, slab, spacing
                )
            for j in range(first, last + 1):
                u = fan[i, j % rays, 0], fan[i, j % rays, 1], fan[i, j % rays, 2]
                along = bx - ax, by - ay, bz - az
                if _edge_range((ax, ay, az), along, u, cone.tangent2) < math.inf:
                    front = one if faces[one] else other
                    d = turned_vector(rotation, u[0], u[1], u[2])
                    reach = _patch_range(front, mark, p, d, cone, mesh, work)
                    ray = i * rays + j % rays
                    ranges[ray] = min(ranges[ray], reach)
                    mark += 1


@_compiled
def nearest_in_beams(pose, lidar, mesh, hits, ranges):
    """Shortens the ranges (planes * rays,) in m of all rays to the nearest point in their cones.

    The nearest point lies on the surface that the axis meets, or on one that reaches into the cone
    from the side. The edge of the latter is a silhouette: an edge between a facet that faces the
    position and one that does not. So both kinds of surface are followed: from the facets that the
    axes meet, and from the silhouettes that lie in a cone.

    Args:
      pose: the position (3,) in m in K and R_KS (3, 3).
      lidar: a `Fan`. mesh: a `Mesh`.
      hits: (K,) the rays whose axes meet the mesh, and the facets.
      ranges: the ranges of the axes, +inf where they meet nothing.
    """
    p, half, normals, levels = pose[0], lidar.half, mesh.normals, mesh.levels
    count = len(levels)
    cone = Cone(math.sin(half), math.cos(half), math.tan(half) ** 2)
    faces, seen = np.empty(count, dtype=np.bool_), np.full(count, -1)
    queue = np.empty(count, dtype=np.int64)
    for f in range(count):
        level = normals[f, 0] * p[0] + normals[f, 1] * p[1] + normals[f, 2] * p[2]
        faces[f] = level > levels[f]
    work = _Work(faces, seen, queue)
    _follow_axes(pose, lidar.directions, cone, mesh, work, hits, ranges)
    _follow_silhouettes(pose, lidar, cone, mesh, work, ranges)
