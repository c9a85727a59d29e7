"""What a lidar does to true ranges: noise, bias, scale, dropout, false returns, misalignment.

All that is random is a pure function of (seed, step). Each effect draws from a stream of its own,
for every ray that truly returns (false returns: for every ray), so that switching one effect on
or off leaves the numbers of the others as they are. The axis of a misalignment
is a function of the seed alone: the mount stays as crooked as it is.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from proxops.systems.common import InputError, generator

NOISE_STREAM, DROPOUT_STREAM, FALSE_RETURN_STREAM, ATTITUDE_STREAM = range(4)
"""Streams of `counter_noise.generator`."""


@dataclass(frozen=True)
class LidarErrors:
    """The errors of a lidar; by default there are none."""

    noise_std: float = 0.0
    """Standard deviation in m of the Gaussian noise of each range."""
    bias: float = 0.0
    """Added to each range, in m."""
    scale_error: float = 0.0
    """Ranges are 1 + this times as long."""
    max_incidence: float = math.pi / 2.0
    """A surface whose normal is further, in rad, from the ray than this returns nothing."""
    dropout: float = 0.0
    """Chance that a return is lost."""
    false_returns: float = 0.0
    """Chance that a ray is answered by nothing real, somewhere up to the maximum range."""
    attitude_error: float = 0.0
    """Angle in rad by which all rays are turned from where they are taken to point."""

    def __post_init__(self) -> None:
        """Raises `InputError` for errors that no lidar has."""

        def need(good: bool, what: str, got: float) -> None:
            if not good:
                raise InputError(f"a lidar needs {what}, got {got}")

        need(0.0 <= self.noise_std < math.inf, "noise_std >= 0", self.noise_std)
        need(math.isfinite(self.bias), "a finite bias", self.bias)
        need(-1.0 < self.scale_error < math.inf, "scale_error > -1", self.scale_error)
        need(
            0.0 < self.max_incidence <= math.pi / 2.0,
            "max_incidence above 0 and up to pi / 2",
            self.max_incidence,
        )
        need(0.0 <= self.dropout <= 1.0, "dropout from 0 to 1", self.dropout)
        need(0.0 <= self.false_returns <= 1.0, "false_returns from 0 to 1", self.false_returns)
        turned = 0.0 <= self.attitude_error <= math.pi
        need(turned, "attitude_error from 0 to pi", self.attitude_error)


def measured_ranges(distances: np.ndarray, errors: LidarErrors, seed: int, step: int) -> np.ndarray:
    """What the lidar reads (K,) in m, float64, for true distances (K,) in m: never negative.

    range = (1 + scale error) distance + bias + noise.
    """
    ranges = distances * (1.0 + errors.scale_error) + errors.bias
    if errors.noise_std > 0.0:
        draws = generator(seed, step, NOISE_STREAM).standard_normal(ranges.size)
        ranges += errors.noise_std * draws
    return np.maximum(ranges, 0.0, out=ranges)


def too_grazing(normals: np.ndarray, directions: np.ndarray, max_incidence: float) -> np.ndarray:
    """Which rays (K,), bool, meet the surface too flatly to return.

    The light that a matt (Lambertian) surface sends back falls as the cosine of the angle of
    incidence, so a receiver with a threshold stops seeing it at an angle: a hard limit. How that
    angle changes with range is neglected.

    Args:
      normals, directions: (K, 3) unit vectors: the surface's normals and the rays.
      max_incidence: the greatest angle between a ray's line and the normal, in rad.
    """
    return np.abs(np.einsum("ki,ki->k", normals, directions)) < math.cos(max_incidence)


def lost_by_chance(count: int, chance: float, seed: int, step: int) -> np.ndarray:
    """Which of `count` returns are lost (count,), bool, each with the given chance."""
    return generator(seed, step, DROPOUT_STREAM).random(count) < chance


def false_ranges(count: int, chance: float, max_range: float, seed: int, step: int) -> np.ndarray:
    """Ranges (count,) in m of returns from nothing, +inf on the rays that have none.

    Dust, glint or the receiver's own noise: on any ray with the given chance, anywhere up to the
    maximum range with equal chance. A lidar takes what answers first, so it reads the lesser of
    this and the true range.
    """
    draws = generator(seed, step, FALSE_RETURN_STREAM).random((2, count))
    return np.where(draws[0] < chance, max_range * draws[1], np.inf)


def misaligned(directions: np.ndarray, angle: float, seed: int) -> np.ndarray:
    """Where rays of nominal unit directions (R, 3) truly point: all turned by `angle`, in rad.

    The axis is drawn from the seed, uniform over the sphere. Rodrigues' rotation formula.
    """
    axis = generator(seed, 0, ATTITUDE_STREAM).standard_normal(3)
    axis /= np.linalg.norm(axis)
    along = (directions @ axis)[:, None] * axis
    across = np.cross(axis, directions)
    return along + math.cos(angle) * (directions - along) + math.sin(angle) * across
