"""Checks of constructor arguments: plain messages for values that make no sense."""

from __future__ import annotations

import numbers
import typing
from collections.abc import Iterable, Sequence

import numpy as np

from proxops.systems.common.array_types import Matrix3, Vector3
from proxops.systems.common.errors import InputError

LARGEST = 1e15
"""No length, time, mass, force or speed of a spacecraft, in SI units, is as large as this."""

Vector = tuple[float, float, float]
"""Three floats. In code that runs thousands of times a flight they are faster than an array."""


def vector_of(values: Iterable[float]) -> Vector:
    """The three numbers of a sequence or an array (3,) as floats."""
    x, y, z = map(float, values)
    return x, y, z


def check_type(owner: str, *kinds: type, **values: typing.Any) -> None:
    """Raises `InputError` unless every value is of one of the kinds; float means any real number.

    Args:
      owner: what the values belong to; it begins the message.
      values: by their names.
    """
    taken = tuple(numbers.Real if kind is float else kind for kind in kinds)
    for name, value in values.items():
        if not isinstance(value, taken):
            wanted = " or ".join("number" if kind is float else kind.__name__ for kind in kinds)
            raise InputError(f"{owner} needs a {wanted} as {name}, got a {type(value).__name__}")


def check_positive(owner: str, **values: float) -> None:
    """Raises `InputError` unless every value is above 0 and below `LARGEST`.

    Args:
      owner: what the values belong to; it begins the message.
      values: by their names.
    """
    for name, value in values.items():
        check_type(owner, float, **{name: value})
        if not 0.0 < value < LARGEST:
            raise InputError(f"{owner} needs {name} above 0 and below {LARGEST:g}, got {value}")


def check_not_negative(owner: str, **values: float) -> None:
    """Raises `InputError` unless every value is at least 0 and below `LARGEST`."""
    for name, value in values.items():
        check_type(owner, float, **{name: value})
        if not 0.0 <= value < LARGEST:
            raise InputError(f"{owner} needs {name} from 0 to below {LARGEST:g}, got {value}")


def checked_semi_axes(owner: str, axes: typing.Any) -> Vector3:
    """The semi-axes (3,) of an ellipsoid, in m.

    Raises:
      InputError: they are not three, or one is not above 0 and below `LARGEST`.
    """
    found = np.array(axes, dtype=np.float64)
    if found.shape != (3,):
        raise InputError(f"{owner} needs three semi-axes, got {axes}")
    check_positive(owner, **dict(zip("xyz", found.tolist(), strict=True)))
    return found


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


def check_inertia(owner: str, inertia) -> Matrix3:
    """The inertia (3, 3) in kg m^2, about the centre of mass.

    Raises:
      InputError: it is not symmetric, or a moment is not positive or exceeds the sum of the others,
        which no distribution of mass can have.
    """
    matrix = np.array(inertia, dtype=np.float64)
    shaped = matrix.shape == (3, 3)
    if not shaped or np.abs(matrix - matrix.T).max() > 1e-9 * np.abs(matrix).max():
        raise InputError(f"{owner} needs a symmetric inertia of 3 x 3 numbers, got {inertia}")
    moments = np.linalg.eigvalsh(matrix)
    if not moments[0] > 0.0:
        raise InputError(f"{owner}: the inertia's moments must be positive, got {moments}")
    if moments[2] > (1.0 + 1e-9) * (moments[0] + moments[1]):
        a, b, c = moments
        raise InputError(
            f"{owner}: no body has the principal moments {a:.4g}, {b:.4g} and {c:.4g} kg m^2: the "
            "greatest exceeds the sum of the others"
        )
    return matrix
