"""Checks of arguments that are vectors, and vectors as plain floats."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from proxops.systems.common import LARGEST, InputError

Vector = tuple[float, float, float]
"""Three floats. In code that runs thousands of times a flight they are faster than an array."""


def finite_vector(owner: str, name: str, value: Sequence[float] | np.ndarray) -> Vector:
    """Returns the three numbers of `value` as floats.

    Raises:
      InputError: they are not three finite numbers.
    """
    array = np.asarray(value, dtype=np.float64)
    if array.shape != (3,) or not (np.abs(array) < LARGEST).all():
        raise InputError(f"{owner} needs {name} of three finite numbers, got {value}")
    x, y, z = array.tolist()
    return x, y, z


def check_finite(owner: str, **values: float) -> None:
    """Raises `InputError` unless every value is finite."""
    for name, value in values.items():
        if not abs(value) < LARGEST:
            raise InputError(f"{owner} needs a finite {name}, got {value}")
