"""`Returns`: what a survey measured, and what it knew beside: the input of the batch estimator."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from proxops.systems.common import Values, Vectors3


class Burns(NamedTuple):
    """Short burns, each as a kick in its middle."""

    times: Values
    """(B,) in s, ascending."""
    kicks: Values
    """(B,) in m/s: by how much they are to change the velocity."""

    def within(self, start: float, end: float) -> Burns:
        """Those between two times in s."""
        kept = (self.times > start) & (self.times < end)
        return Burns(self.times[kept], self.kicks[kept])


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

    def burns(self, longest: float) -> Burns:
        """The burns of the commands, cut where they last longer than `longest` in s."""
        sizes = np.linalg.norm(self.thrusts, axis=1)
        index = np.flatnonzero(sizes)
        period = float(np.median(np.diff(self.times)))
        times, kicks = self.times[index] + 0.5 * period, sizes[index] * period
        burns = []
        while len(times):
            one = times < times[0] + longest
            burns.append((np.average(times[one], weights=kicks[one]), kicks[one].sum()))
            times, kicks = times[~one], kicks[~one]
        return Burns(*np.reshape(burns, (-1, 2)).T)

    @property
    def driven(self) -> Vectors3:
        """(F, 3) in m in N: how far the commanded thrust alone has moved the spacecraft."""
        steps = np.diff(self.times, append=self.times[-1])[:, None]
        gained = np.cumsum(self.thrusts * steps, axis=0)
        before = np.vstack([np.zeros(3), gained[:-1]])
        moved = np.cumsum((before + 0.5 * self.thrusts * steps) * steps, axis=0)
        return np.vstack([np.zeros(3), moved[:-1]])
