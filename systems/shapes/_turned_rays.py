"""Compiled kernel: which rays of a fan, turned as a whole, may meet a mesh."""

import math

import numpy as np

from proxops.systems.common import kernel, turned_vector


@kernel(error_model="numpy")
def turned_rays(positions, centre, axes, margin, rotation, directions):
    """The K turned rays that meet an ellipsoid around the mesh, position by position, ray by ray.

    With the semi-axes A, q = A⁻¹ (position - centre) and e = A⁻¹ R d, a ray meets the ellipsoid if
    -q·e is at least √(q² - 1) |e|, the length of a tangent from q. From inside, all rays do.

    Args:
      positions: (N, 3) in m. centre, axes: (3,) in m, of the ellipsoid.
      margin: what the cosine of the tangent's angle may lack.
      rotation: R (3, 3). directions: d (R, 3), unit vectors.

    Returns:
      Indices of positions and of rays (K,), and origins and directions R d (K, 3) in single
      precision.
    """
    size = len(directions)
    places = np.empty(len(positions) * size, dtype=np.int64)
    rays = np.empty(len(positions) * size, dtype=np.int64)
    count = 0
    # A⁻¹ R, row by row.
    m00, m01, m02 = rotation[0, 0] / axes[0], rotation[0, 1] / axes[0], rotation[0, 2] / axes[0]
    m10, m11, m12 = rotation[1, 0] / axes[1], rotation[1, 1] / axes[1], rotation[1, 2] / axes[1]
    m20, m21, m22 = rotation[2, 0] / axes[2], rotation[2, 1] / axes[2], rotation[2, 2] / axes[2]
    for n in range(len(positions)):
        qx = (positions[n, 0] - centre[0]) / axes[0]
        qy = (positions[n, 1] - centre[1]) / axes[1]
        qz = (positions[n, 2] - centre[2]) / axes[2]
        squared = qx * qx + qy * qy + qz * qz
        tangent = math.sqrt(max(squared - 1.0, 0.0)) - margin * math.sqrt(squared)
        # q in the fan's axes: half of the rays point away, and cost three products each.
        wx = qx * m00 + qy * m10 + qz * m20
        wy = qx * m01 + qy * m11 + qz * m21
        wz = qx * m02 + qy * m12 + qz * m22
        for r in range(size):
            x, y, z = directions[r, 0], directions[r, 1], directions[r, 2]
            along = -(wx * x + wy * y + wz * z)
            if tangent > 0.0:
                if along < 0.0:
                    continue
                ex = m00 * x + m01 * y + m02 * z
                ey = m10 * x + m11 * y + m12 * z
                ez = m20 * x + m21 * y + m22 * z
                if along * along < tangent * tangent * (ex * ex + ey * ey + ez * ez):
                    continue
            places[count], rays[count] = n, r
            count += 1
    origins = np.empty((count, 3), dtype=np.float32)
    turned = np.empty((count, 3), dtype=np.float32)
    for k in range(count):
        n, r = places[k], rays[k]
        x, y, z = directions[r, 0], directions[r, 1], directions[r, 2]
        turned[k, 0], turned[k, 1], turned[k, 2] = turned_vector(rotation, x, y, z)
        for i in range(3):
            origins[k, i] = positions[n, i]
    return places[:count].copy(), rays[:count].copy(), origins, turned
