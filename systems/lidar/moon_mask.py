"""`MoonMask`: blanks the returns that come from moons, whose places are known on board."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from pydrake.systems.framework import LeafSystem

from proxops.systems.common import Values, Vector3, Vectors3, check_positive, rotation_matrix
from proxops.systems.gravity import MoonConfig, moon_position
from proxops.systems.lidar.lidar_geometry import LidarGeometry
from proxops.systems.rotation import Spin, spin_model


def of_the_moon(points: Vectors3, moon: Vector3, radius: float, body: float) -> Values:
    """Which returns (N,), bool, come from a moon, wherever the spacecraft is.

    Along the line from the body to the moon, body and moon are two stretches that do not overlap,
    as far apart as they are. Where the spacecraft is on that line is what lets the most returns lie
    in either.

    Args:
      points: (N, 3) in m from the spacecraft, along the axes of K.
      moon: (3,) in m from the body's centre. radius: of the ball about it, in m.
      body: radius in m of the ball about the body.
    """
    away = float(np.linalg.norm(moon))
    if away - radius <= body or not len(points):
        return np.zeros(len(points), dtype=bool)
    along = points @ (moon / away)
    order = np.sort(along)
    # Places of the body's centre at which one of the stretches begins at a return.
    centres = np.concatenate([order + body, order - away + radius])

    def within(low: Values, high: Values) -> Values:
        return np.searchsorted(order, high, "right") - np.searchsorted(order, low, "left")

    near, far = centres + away - radius, centres + away + radius
    counts = within(centres - body, centres + body) + within(near, far)
    best = int(np.argmax(counts))
    return (along >= near[best]) & (along <= far[best])


class MoonMask(LeafSystem):
    """Blanks the returns that come from moons.

    ```
    ranges (R), m ──►┌──────────┐
    attitude (4) ───►│ MoonMask ├─► ranges (R), m; +inf: no return, or one of a moon
                     └──────────┘
    ```

    It knows where the moons are and how K turns, as believed, and not where the spacecraft is: see
    `of_the_moon`. `attitude` is R_KS as believed; it may stay unconnected: then S has K's axes.
    """

    def __init__(
        self, geometry: LidarGeometry, moons: Sequence[MoonConfig], spin: Spin, body: float
    ):
        """Takes the lidar's geometry, the moons, how K turns, and the body's greatest radius in m."""
        super().__init__()
        check_positive("MoonMask", body=body)
        self.directions, self.moons = geometry.directions, moons
        self.spin, self.body = spin_model(spin), body
        size = len(self.directions)
        self._ranges_port = self.DeclareVectorInputPort("ranges", size)
        self._attitude_port = self.DeclareVectorInputPort("attitude", 4)
        depends = {self.all_input_ports_ticket(), self.time_ticket()}
        self.DeclareVectorOutputPort("ranges", size, self._calc, depends)

    def _calc(self, context, output):
        ranges = self._ranges_port.Eval(context).copy()
        rays = np.flatnonzero(np.isfinite(ranges))
        points = ranges[rays, None] * self.directions[rays]
        if self._attitude_port.HasValue(context):
            points = points @ rotation_matrix(self._attitude_port.Eval(context)).T
        for moon in self.moons:
            place = moon_position(moon, context.get_time(), self.spin)
            ranges[rays[of_the_moon(points, place, moon.radius_m, self.body)]] = np.inf
        output.SetFromVector(ranges)
