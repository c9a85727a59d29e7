"""`Returns`: what a survey measured, and what it knew beside: the input of the batch estimator."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from proxops.systems.common import Values, Vectors3


class Returns(NamedTuple):
    """The returns of F frames, in order, and what was known when they were measured.

    N is the inertial frame in which the spacecraft knows its attitude. Its z axis is the believed
    spin axis.
    """

    times: Values
    """(F,) in s, ascending."""
    attitudes: np.ndarray
    """(F, 3, 3): R_NS as the spacecraft knows it."""
    thrusts: Vectors3
    """(F, 3): acceleration in m/s^2 in N that the commands give from this frame to the next."""
    frames: Values
    """(K,) int: the frame of each return, ascending."""
    directions: Vectors3
    """(K, 3): the unit vector along the ray, in S."""
    ranges: Values
    """(K,) in m."""

    def chosen(self, returns: Values) -> Returns:
        """Those of the returns that an index or a mask (K,) takes; the frames stay."""
        return self._replace(
            frames=self.frames[returns],
            directions=self.directions[returns],
            ranges=self.ranges[returns],
        )

    @property
    def rays(self) -> Vectors3:
        """(K, 3): the measured ranges as vectors from the spacecraft, in N."""
        along = np.einsum("kij,kj->ki", self.attitudes[self.frames], self.directions)
        return self.ranges[:, None] * along

    @property
    def driven(self) -> Vectors3:
        """(F, 3) in m in N: how far the commanded thrust alone has moved the spacecraft."""
        steps = np.diff(self.times, append=self.times[-1])[:, None]
        gained = np.cumsum(self.thrusts * steps, axis=0)
        before = np.vstack([np.zeros(3), gained[:-1]])
        moved = np.cumsum((before + 0.5 * self.thrusts * steps) * steps, axis=0)
        return np.vstack([np.zeros(3), moved[:-1]])
