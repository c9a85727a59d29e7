"""Compiled: the point of a mesh that is nearest to a point, among a few facets."""

import numpy as np

from proxops.systems.common import kernel


@kernel(error_model="numpy")
def _weights(point, a, b, c):
    """Barycentric weights of the point of a triangle that is nearest to a point.

    Ericson, Real-Time Collision Detection, 2005, section 5.1.5.
    """
    ab, ac, ap = b - a, c - a, point - a
    d1 = ab[0] * ap[0] + ab[1] * ap[1] + ab[2] * ap[2]
    d2 = ac[0] * ap[0] + ac[1] * ap[1] + ac[2] * ap[2]
    if d1 <= 0.0 and d2 <= 0.0:
        return 1.0, 0.0, 0.0
    bp = point - b
    d3 = ab[0] * bp[0] + ab[1] * bp[1] + ab[2] * bp[2]
    d4 = ac[0] * bp[0] + ac[1] * bp[1] + ac[2] * bp[2]
    if d3 >= 0.0 and d4 <= d3:
        return 0.0, 1.0, 0.0
    vc = d1 * d4 - d3 * d2
    if vc <= 0.0 and d1 >= 0.0 and d3 <= 0.0:
        v = d1 / (d1 - d3)
        return 1.0 - v, v, 0.0
    cp = point - c
    d5 = ab[0] * cp[0] + ab[1] * cp[1] + ab[2] * cp[2]
    d6 = ac[0] * cp[0] + ac[1] * cp[1] + ac[2] * cp[2]
    if d6 >= 0.0 and d5 <= d6:
        return 0.0, 0.0, 1.0
    vb = d5 * d2 - d1 * d6
    if vb <= 0.0 and d2 >= 0.0 and d6 <= 0.0:
        w = d2 / (d2 - d6)
        return 1.0 - w, 0.0, w
    va = d3 * d6 - d5 * d4
    if va <= 0.0 and d4 - d3 >= 0.0 and d5 - d6 >= 0.0:
        w = (d4 - d3) / ((d4 - d3) + (d5 - d6))
        return 0.0, 1.0 - w, w
    whole = va + vb + vc
    return va / whole, vb / whole, vc / whole


@kernel(error_model="numpy")
def nearest_of(points, candidates, vertices, facets, chosen, places):
    """Fills in the nearest facet (K,) and the weights (K, 3) of its corners for points (K, 3).

    Args:
      points: (K, 3). candidates: (K, C) int: facets to look at.
      vertices, facets: the mesh.
      chosen, places: filled in.
    """
    for k in range(points.shape[0]):
        least = np.inf
        for f in candidates[k]:
            a, b, c = vertices[facets[f, 0]], vertices[facets[f, 1]], vertices[facets[f, 2]]
            u, v, w = _weights(points[k], a, b, c)
            square = 0.0
            for i in range(3):
                square += (points[k, i] - u * a[i] - v * b[i] - w * c[i]) ** 2
            if square < least:
                least = square
                chosen[k] = f
                places[k, 0], places[k, 1], places[k, 2] = u, v, w
