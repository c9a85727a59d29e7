"""Factors between a body and a spacecraft and those for which the pilot's recipe was made."""

from __future__ import annotations

import dataclasses as dc

import numpy as np

from proxops.diagrams.yaml_files import parse_mapping
from proxops.training.data.flight_columns import Setting

# The length that positions are scaled by, as a share of the keep-out's greatest semi-axis.
_LENGTH_SHARE = 0.7
# At Kleopatra: that length in m, and the default spacecraft's thrust in N, and in N per kg.
_LENGTH, _FORCE, _ACCELERATION = _LENGTH_SHARE * 140e3, 7.0, 0.07


@dc.dataclass(frozen=True)
class Scaling:
    """Factors for numbers that were chosen at Kleopatra; all are 1 there."""

    length: float = 1.0
    speed: float = 1.0
    acceleration: float = 1.0
    force: float = 1.0


def body_length(keep_out_semi_axes: np.ndarray) -> float:
    """A body's size in m, roughly, from the semi-axes (3,) of its keep-out ellipsoid."""
    return _LENGTH_SHARE * float(np.max(keep_out_semi_axes))


def scaling_for(length: float, mass: float, thrust_limit: float) -> Scaling:
    """The factors for a body and a spacecraft.

    The factor of speeds is that of the speeds which these accelerations reach over these lengths.

    Args:
      length: the body's size in m, see `body_length`.
      mass: of the spacecraft in kg.
      thrust_limit: per axis in N.
    """
    ratio, acceleration = length / _LENGTH, thrust_limit / mass / _ACCELERATION
    speed = float(np.sqrt(ratio * acceleration))
    return Scaling(ratio, speed, acceleration, thrust_limit / _FORCE)


def keep_out_of(setting: Setting) -> np.ndarray:
    """Semi-axes (3,) in m of the keep-out ellipsoid of the flights' body."""
    axes = parse_mapping(setting.body, "the body")["keep_out_semi_axes_m"]
    return np.array(axes, dtype=float)


def scaling_of(setting: Setting) -> Scaling:
    """The factors for the body and the spacecraft of flights."""
    length = body_length(keep_out_of(setting))
    return scaling_for(length, setting.mass_kg, setting.thrust_limit_n)
