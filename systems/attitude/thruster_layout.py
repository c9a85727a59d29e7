"""`ThrusterLayout`: where the thrusters of a spacecraft are, and what each gives."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from proxops.systems.common import InputError, Values, Vectors3


@dataclass(frozen=True)
class ThrusterLayout:
    """Thrusters that are either on or off, and on for a part of each period. All in S, in SI."""

    places: Vectors3
    """(n, 3) in m from the centre of mass of the data sheet."""
    directions: Vectors3
    """(n, 3) unit vectors: of the force on the spacecraft, so against the plume."""
    forces: Values
    """(n,) in N."""
    least_on_time: float = 0.0
    """s: shorter pulses are not given."""

    def __post_init__(self) -> None:
        """Raises `InputError` if force or torque about an axis cannot be given."""
        n = len(self.forces)
        assert self.places.shape == self.directions.shape == (n, 3)
        for which, ways in (("a force along", self.directions), ("a torque about", self.levers)):
            for axis, name in enumerate("xyz"):
                # Thrusters push only: some must push each way.
                if not (ways[:, axis].max(initial=0.0) > 1e-9 > -1e-9 > ways[:, axis].min()):
                    raise InputError(f"the thrusters cannot give {which} {name} in both directions")

    @property
    def count(self) -> int:
        """n."""
        return len(self.forces)

    @cached_property
    def levers(self) -> Vectors3:
        """(n, 3) in m: torque about the data sheet's centre of mass for 1 N of each thruster."""
        return np.cross(self.places, self.directions)

    def wrenches(self) -> np.ndarray:
        """Force (N) and torque (N m) about the centre of mass, of each that is on: (6, n)."""
        return np.vstack([self.directions.T, self.levers.T]) * self.forces


def lost_directions(wrenches: np.ndarray) -> Vectors3:
    """The directions (k, 3) of S, of +x to -z, in which thrusters cannot push without a torque.

    Args: wrenches (6, n) of the thrusters that work; a column of zeros is none.
    """
    from scipy.optimize import nnls  # Slow to import, and needed only when one has failed.

    axes = np.vstack([np.eye(3), -np.eye(3)])
    rests = np.array([nnls(wrenches, np.append(axis, np.zeros(3)))[1] for axis in axes])
    return axes[rests > 1e-6]
