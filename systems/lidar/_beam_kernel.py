"""Compiled kernel of beams: the point of a mesh that is nearest in a cone about each ray.

Many functions share these arguments:

* ``p``: the position (3,) in m. ``dx, dy, dz``: the unit direction of a beam's axis.
* ``cone`` (3,): sine, cosine and squared tangent of the cone's half angle.
* ``mesh``: vertices (V, 3) in m, facets (F, 3), outward unit normals (F, 3), and for each facet the
  facets (F, 3) across its edges, of which edge k runs from corner k to the next.
"""

import math

import numpy as np

from proxops.systems.common import kernel

_compiled = kernel(error_model="numpy")
_inlined = kernel(error_model="numpy", forceinline=True)


@_inlined
def _from(v, p, vertices):
    """A vertex as seen from the position."""
    return vertices[v, 0] - p[0], vertices[v, 1] - p[1], vertices[v, 2] - p[2]


@_inlined
def _turned(x, y, z, m):
    """A matrix (3, 3) times a vector."""
    return (
        m[0, 0] * x + m[0, 1] * y + m[0, 2] * z,
        m[1, 0] * x + m[1, 1] * y + m[1, 2] * z,
        m[2, 0] * x + m[2, 1] * y + m[2, 2] * z,
    )


@_inlined
def _edge_range(ax, ay, az, ex, ey, ez, dx, dy, dz, tan2):
    """Distance to the nearest point in the cone of a + s e, 0 <= s <= 1; +inf if there is none.

    A point x is in the cone if |x|² - (x·d)² <= tan² (x·d)²: a quadratic in s.
    """
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
def _plane_range(f, p, dx, dy, dz, cone, mesh):
    """Distance to the plane of a facet in the cone; +inf if the nearest point is off the facet.

    The nearest direction in the cone is the axis turned towards the plane's normal, by the cone's
    half angle at most.
    """
    vertices, facets, normals, _ = mesh
    nx, ny, nz = normals[f, 0], normals[f, 1], normals[f, 2]
    ax, ay, az = _from(facets[f, 0], p, vertices)
    height = nx * ax + ny * ay + nz * az
    if height < 0.0:
        nx, ny, nz, height = -nx, -ny, -nz, -height
    across = nx * dx + ny * dy + nz * dz
    if across >= cone[1]:
        ux, uy, uz, closing = nx, ny, nz, 1.0
    else:
        # Of the normal's part across the axis, |part| = rest.
        rest = math.sqrt(1.0 - across * across)
        closing = across * cone[1] + rest * cone[0]
        if not (rest > 0.0 and closing > 0.0):
            return math.inf
        turn = cone[0] / rest
        keep = cone[1] - turn * across
        ux, uy, uz = keep * dx + turn * nx, keep * dy + turn * ny, keep * dz + turn * nz
    positive = negative = False
    for k in range(3):
        ax, ay, az = _from(facets[f, k], p, vertices)
        bx, by, bz = _from(facets[f, (k + 1) % 3], p, vertices)
        side = (ay * bz - az * by) * ux + (az * bx - ax * bz) * uy + (ax * by - ay * bx) * uz
        positive, negative = positive or side > 0.0, negative or side < 0.0
    return math.inf if positive and negative else height / closing


@_compiled
def _patch_range(seed, mark, p, dx, dy, dz, cone, mesh, faces, seen, queue):
    """Distance to the nearest point in the cone of the surface that is connected to a facet in it.

    It goes from facet to facet across each edge that the cone touches, as long as facets turn the
    same side to the position (`faces`). `seen` (F,) gets the mark, another one for each call;
    `queue` (F,) is room to work in.
    """
    vertices, facets, _, neighbours = mesh
    nearest = math.inf
    queue[0], seen[seed], count, done = seed, mark, 1, 0
    while done < count:
        f = queue[done]
        done += 1
        nearest = min(nearest, _plane_range(f, p, dx, dy, dz, cone, mesh))
        for k in range(3):
            ax, ay, az = _from(facets[f, k], p, vertices)
            bx, by, bz = _from(facets[f, (k + 1) % 3], p, vertices)
            reach = _edge_range(ax, ay, az, bx - ax, by - ay, bz - az, dx, dy, dz, cone[2])
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


@_compiled
def _follow_axes(p, rotation, fan, cone, mesh, faces, seen, queue, hit_rays, hit_facets, ranges):
    """Shortens ranges by the surfaces that the axes meet."""
    rays = fan.shape[1]
    for k in range(len(hit_rays)):
        ray = hit_rays[k]
        i, j = ray // rays, ray % rays
        dx, dy, dz = _turned(fan[i, j, 0], fan[i, j, 1], fan[i, j, 2], rotation)
        reach = _patch_range(hit_facets[k], k, p, dx, dy, dz, cone, mesh, faces, seen, queue)
        ranges[ray] = min(ranges[ray], reach)


@_compiled
def _follow_silhouettes(p, rotation, fan, half, cone, mesh, edges, faces, seen, queue, ranges):
    """Shortens ranges by the surfaces whose silhouettes lie in a cone."""
    ends, beside = edges
    planes, rays, _ = fan.shape
    spacing, back, mark = 2.0 * math.pi / rays, rotation.T, planes * rays
    for e in range(len(ends)):
        one, other = beside[e, 0], beside[e, 1]
        if faces[one] == faces[other]:
            continue
        ax, ay, az = _turned(*_from(ends[e, 0], p, mesh[0]), back)
        bx, by, bz = _turned(*_from(ends[e, 1], p, mesh[0]), back)
        far2 = max(ax * ax + ay * ay + az * az, bx * bx + by * by + bz * bz)
        slab = cone[0] * math.sqrt(far2)
        for i in range(planes):
            first, last = _rays_beside(
                (ax, ay, az), (bx, by, bz), fan[i, 0, 0], fan[i, 0, 1], half, slab, spacing
            )
            for j in range(first, last + 1):
                ux, uy, uz = fan[i, j % rays, 0], fan[i, j % rays, 1], fan[i, j % rays, 2]
                ex, ey, ez = bx - ax, by - ay, bz - az
                if _edge_range(ax, ay, az, ex, ey, ez, ux, uy, uz, cone[2]) < math.inf:
                    front = one if faces[one] else other
                    dx, dy, dz = _turned(ux, uy, uz, rotation)
                    reach = _patch_range(front, mark, p, dx, dy, dz, cone, mesh, faces, seen, queue)
                    ray = i * rays + j % rays
                    ranges[ray] = min(ranges[ray], reach)
                    mark += 1


@_compiled
def nearest_in_beams(p, rotation, fan, half, mesh, levels, edges, hit_rays, hit_facets, ranges):
    """Shortens the ranges (planes * rays,) in m of all rays to the nearest point in their cones.

    The nearest point lies on the surface that the axis meets, or on one that reaches into the cone
    from the side. The edge of the latter is a silhouette: an edge between a facet that faces the
    position and one that does not. So both kinds of surface are followed: from the facets that the
    axes meet, and from the silhouettes that lie in a cone.

    Args:
      p, rotation: the position (3,) in m in K and R_KS (3, 3).
      fan: the directions (planes, rays, 3) in S, evenly spaced in each plane from the xy-plane on.
      half: half of the beam's full angle, in rad.
      mesh: see above. levels: n·v (F,) of each facet. edges: their ends (E, 2) and facets (E, 2).
      hit_rays, hit_facets: (K,) the rays whose axes meet the mesh, and the facets.
      ranges: the ranges of the axes, +inf where they meet nothing.
    """
    normals, count = mesh[2], len(levels)
    cone = math.sin(half), math.cos(half), math.tan(half) ** 2
    faces, seen = np.empty(count, dtype=np.bool_), np.full(count, -1)
    queue = np.empty(count, dtype=np.int64)
    for f in range(count):
        level = normals[f, 0] * p[0] + normals[f, 1] * p[1] + normals[f, 2] * p[2]
        faces[f] = level > levels[f]
    _follow_axes(p, rotation, fan, cone, mesh, faces, seen, queue, hit_rays, hit_facets, ranges)
    _follow_silhouettes(p, rotation, fan, half, cone, mesh, edges, faces, seen, queue, ranges)
