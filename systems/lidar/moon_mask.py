"""`MoonMask`: blanks the returns that come from moons, whose places are known on board."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from pydrake.systems.framework import LeafSystem

from proxops.systems.common import Values, check_positive, kernel, rotation_matrix
from proxops.systems.gravity import MoonConfig, moon_position
from proxops.systems.lidar.lidar_geometry import LidarGeometry
from proxops.systems.rotation import Spin, spin_model


def stretch_of_the_moon(along: Values, away: float, radius: float, body: float) -> float:
    """Where the ball about a moon begins on the line from the body to the moon, in m.

    Along this line body and moon are two stretches that do not overlap. Where the spacecraft is on
    it is what lets the most returns lie in either; what lies in one alone is taken for the body.

    Args:
      along: (N,) in m along the line from the spacecraft, of returns that are not false.
      away: distance in m from body to moon. radius: of the ball about the moon, in m.
      body: radius in m of the ball about the body.
    """
    order = np.sort(along)
    # Places of the body's centre at which one of the stretches begins at a return.
    centres = np.concatenate([order + body, order - away + radius])

    def within(low: Values, high: Values) -> Values:
        return np.searchsorted(order, high, "right") - np.searchsorted(order, low, "left")

    near = centres + away - radius
    counts = within(centres - body, centres + body) + within(near, near + 2.0 * radius)
    return float(near[np.argmax(counts)])


@kernel(error_model="numpy")
def with_neighbours(ranges, planes, near):
    """Which rays (R,), bool, have a neighbour in their plane with a like range, within `near` m.

    A false return rarely has one. The ranges (R,) in m are of `planes` planes.
    """
    frame = ranges.reshape(planes, -1)
    found = np.zeros(frame.shape, dtype=np.bool_)
    for plane in range(planes):
        for ray in range(frame.shape[1]):
            if np.abs(frame[plane, ray] - frame[plane, ray - 1]) < near:
                found[plane, ray] = found[plane, ray - 1] = True
    return found.ravel()


class MoonMask(LeafSystem):
    """Blanks the returns that come from moons.

    ```
    ranges (R), m ──►┌──────────┐
    attitude (4) ───►│ MoonMask ├─► ranges (R), m; +inf: no return, or one of a moon
                     └──────────┘
    ```

    It knows where the moons are and how K turns, as believed, and not where the spacecraft is: see
    `stretch_of_the_moon`. `attitude` is R_KS as believed; it may stay unconnected: then S has the
    axes of K.
    """

    def __init__(
        self, geometry: LidarGeometry, moons: Sequence[MoonConfig], spin: Spin, body: float
    ):
        """Takes the lidar, the moons, how K turns, and the body's greatest radius in m."""
        super().__init__()
        check_positive("MoonMask", body=body)
        self.geometry, self.directions, self.moons = geometry, geometry.directions, moons
        self.spin, self.body = spin_model(spin), body
        size = len(self.directions)
        self._ranges_port = self.DeclareVectorInputPort("ranges", size)
        self._attitude_port = self.DeclareVectorInputPort("attitude", 4)
        depends = {self.all_input_ports_ticket(), self.time_ticket()}
        self.DeclareVectorOutputPort("ranges", size, self._calc, depends)

    def _calc(self, context, output):
        ranges = self._ranges_port.Eval(context).copy()
        rotation = np.eye(3)
        if self._attitude_port.HasValue(context):
            rotation = rotation_matrix(self._attitude_port.Eval(context))
        rays = np.flatnonzero(ranges < np.inf)
        points = self.directions[rays] * ranges[rays, None]
        for moon in self.moons:
            place = moon_position(moon, context.get_time(), self.spin)
            away = math.hypot(*place.tolist())
            along = points @ (rotation.T @ place / away)
            # Where all may lie in the body's stretch, no moon is seen.
            spread = along.max() - along.min() if along.size else 0.0
            if away - moon.radius_m > self.body and spread > 2.0 * self.body:
                self._blank(ranges, rays, along, away, moon.radius_m)
        output.SetFromVector(ranges)

    def _blank(
        self, ranges: Values, rays: Values, along: Values, away: float, radius: float
    ) -> None:
        """Blanks in place the returns of a moon, of rays (K,) that lie `along` (K,) its line."""
        sure = with_neighbours(ranges, self.geometry.planes, self.body)[rays]
        if sure.any():
            low = stretch_of_the_moon(along[sure], away, radius, self.body)
            # Rays at the limb that are not trusted may lie beside the stretch, in the gap.
            spare = min(0.5 * (away - radius - self.body), radius)
            beside = (along < low - spare) | (along > low + 2.0 * radius + spare)
            ranges[rays[~beside]] = np.inf
