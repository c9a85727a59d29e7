"""Constants that bring positions, velocities, forces and ranges to zero mean and unit spread."""

from __future__ import annotations

import dataclasses as dc
import math
import typing

import numpy as np

from proxops.systems.common import InputError

# name: number of components
QUANTITIES = {"position": 3, "velocity": 3, "force": 3, "range": 1}


@dc.dataclass(frozen=True)
class Scale:
    """Mean and standard deviation of each component of a quantity, in its SI unit.

    A component that never varies has the deviation 1, so that it can be divided by.
    """

    mean: tuple[float, ...]
    std: tuple[float, ...]


@dc.dataclass(frozen=True)
class Normalisation:
    """Constants of the training part: of states in K, of the MPC's forces in K, of lidar hits.

    Targets are normalised as states are, and applied forces as the MPC's: they can be compared.
    """

    position: Scale
    """m"""
    velocity: Scale
    """m/s"""
    force: Scale
    """N"""
    range: Scale
    """m, one component; of rays that returned"""

    def to_json(self) -> dict[str, typing.Any]:
        """As plain lists and numbers; `from_json` gives an equal one back."""
        return {
            name: {"mean": list(scale.mean), "std": list(scale.std)}
            for name, scale in ((name, getattr(self, name)) for name in QUANTITIES)
        }

    @classmethod
    def from_json(cls, tree: typing.Any, source: str) -> Normalisation:
        """Reads what `to_json` gave.

        Raises:
          InputError: a quantity is missing or has constants that cannot be; `source` names it.
        """
        scales = {}
        for name, components in QUANTITIES.items():
            try:
                mean = tuple(float(value) for value in tree[name]["mean"])
                std = tuple(float(value) for value in tree[name]["std"])
            except (KeyError, TypeError, ValueError) as error:
                raise InputError(
                    f"{source}: the normalisation of {name} needs lists of numbers, mean and std"
                ) from error
            if len(mean) != components or len(std) != components:
                raise InputError(
                    f"{source}: the normalisation of {name} needs {components} of mean and of std"
                )
            if not all(map(math.isfinite, mean)) or not all(0.0 < s < math.inf for s in std):
                raise InputError(
                    f"{source}: the normalisation of {name} must be finite, std above 0"
                )
            scales[name] = Scale(mean, std)
        return cls(**scales)


class Moments:
    """Mean and standard deviation of rows that come in portions, at constant memory.

    Portions are joined as in T. F. Chan, G. H. Golub, R. J. LeVeque, Am. Stat. 37 (1983) 242:
    no digits are lost when the mean is large.
    """

    def __init__(self, components: int):
        self._count = 0
        self._mean = np.zeros(components)
        self._squares = np.zeros(components)

    def add(self, values: np.ndarray) -> None:
        """Joins rows (N, components)."""
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
        """Of all rows so far; mean 0 and deviation 1 where there were none."""
        std = np.sqrt(self._squares / max(1, self._count))
        # Rounding gives a constant component a tiny spread, which must not blow it up.
        constant = std <= 1e-12 * np.abs(self._mean)
        std[constant] = 1.0
        return Scale(tuple(self._mean.tolist()), tuple(std.tolist()))
