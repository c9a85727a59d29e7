"""Means and standard deviations of positions, velocities, forces and ranges."""

from __future__ import annotations

import dataclasses as dc

import numpy as np


@dc.dataclass(frozen=True)
class Scale:
    """Mean and standard deviation of each component of a quantity, in its SI unit.

    A component that never varies gets the standard deviation 1, so that one can divide by it.
    """

    mean: tuple[float, ...]
    std: tuple[float, ...]


@dc.dataclass(frozen=True)
class Normalisation:
    """Scales of the training part: of states in K, of the MPC's forces in K, of lidar ranges.

    Targets use the scales of states, and commanded forces those of the MPC's forces.
    """

    position: Scale
    """m"""
    velocity: Scale
    """m/s"""
    force: Scale
    """N"""
    range: Scale
    """m, one component; only rays that returned"""

    @classmethod
    def of(cls, tree: dict[str, dict[str, list[float]]]) -> Normalisation:
        """Reads the scales from what `dataclasses.asdict` gave, after its way through JSON."""
        return cls(**{
            name: Scale(tuple(scale["mean"]), tuple(scale["std"])) for name, scale in tree.items()
        })  # fmt: skip


class Moments:
    """Mean and standard deviation of rows that come in portions, in constant memory.

    Portions are combined by the formula of T. F. Chan, G. H. Golub and R. J. LeVeque, Am. Stat. 37
    (1983) 242, which loses no digits when the mean is large.
    """

    def __init__(self, components: int):
        self._count = 0
        self._mean = np.zeros(components)
        self._squares = np.zeros(components)

    def add(self, values: np.ndarray) -> None:
        """Adds rows (N, components)."""
        added = len(values)
        if added == 0:
            return
        values = values.astype(np.float64)
        mean = values.mean(axis=0)
        total = self._count + added
        apart = mean - self._mean
        self._squares += ((values - mean) ** 2).sum(axis=0)
        self._squares += apart**2 * (self._count * added / total)
        self._mean += apart * (added / total)
        self._count = total

    def scale(self) -> Scale:
        """The scale of all rows so far; mean 0 and deviation 1 if there were none."""
        std = np.sqrt(self._squares / max(1, self._count))
        # Rounding gives a constant component a tiny spread, and dividing by it would amplify noise.
        constant = std <= 1e-12 * np.abs(self._mean)
        std[constant] = 1.0
        return Scale(tuple(self._mean.tolist()), tuple(std.tolist()))
