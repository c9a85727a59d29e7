"""`LidarErrors`: how measured ranges differ from true ones, and functions that apply the errors.

All random numbers are a pure function of (seed, step). Each effect draws from a stream of its own,
for every ray that truly returns (false returns: for every ray). So switching one effect on or off
leaves the numbers of the others as they are. Where an effect changes which rays return, the k-th
return still gets the k-th number.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from proxops.systems.common import (
    FAR,
    LARGEST,
    InputError,
    Values,
    Vectors3,
    check_not_negative,
    config,
    generator,
    number,
)

NOISE_STREAM, DROPOUT_STREAM, FALSE_RETURN_STREAM, FRAME_LOSS_STREAM = range(4)
"""Streams of `counter_noise.generator`."""


@config
class TrueLidarConfig:
    """How the true lidar differs from the one on the data sheet."""

    # This length is added to every range.
    bias_m: float = number(0.0, at_least=-FAR, at_most=FAR, unit="m")
    # Every range is multiplied by 1 + scale_error.
    scale_error: float = number(0.0, above=-1.0, at_most=1e3)
    # True standard deviation of the noise, over lidar.noise_std_m.
    noise: float = number(1.0, at_least=0.0, at_most=1e6)
    # Probability that a return is lost.
    dropout: float = number(0.0, at_least=0.0, at_most=1.0)
    # Probability that a ray has a false return, at a random range.
    false_returns: float = number(0.0, at_least=0.0, at_most=1.0)
    # Full angle of a beam's cone. The range is that of the nearest surface in it.
    beam_width_rad: float = number(0.0, at_least=0.0, at_most=0.1, unit="rad")
    # Probability that a whole frame is lost.
    frame_loss: float = number(0.0, at_least=0.0, at_most=1.0)
    # So many frames in a row are lost, from this control step on.
    outage_steps: int = number(0, at_least=0, at_most=1_000_000)
    outage_from_step: int = number(0, at_least=0, at_most=1_000_000)
    # Control steps from measuring a frame to having it.
    latency_steps: int = number(0, at_least=0, at_most=1000)

    def errors(self, noise_std: float) -> LidarErrors:
        """Gives the errors of a lidar whose data sheet has this deviation of the noise, in m."""
        return LidarErrors(
            noise_std=self.noise * noise_std,
            bias=self.bias_m,
            scale_error=self.scale_error,
            dropout=self.dropout,
            false_returns=self.false_returns,
            beam_width=self.beam_width_rad,
            frame_loss=self.frame_loss,
            outage=(self.outage_from_step, self.outage_from_step + self.outage_steps),
        )


@dataclass(frozen=True)
class LidarErrors:
    """The errors of a lidar, in SI units: see `TrueLidarConfig`. By default none."""

    noise_std: float = 0.0
    """Standard deviation in m of the Gaussian noise of each range."""
    bias: float = 0.0
    scale_error: float = 0.0
    max_incidence: float = math.pi / 2.0
    """A surface returns nothing if the angle between the ray's line and its normal, in rad, is
    greater than this. Of a beam with a width, the ray is the cone's axis."""
    dropout: float = 0.0
    false_returns: float = 0.0
    beam_width: float = 0.0
    frame_loss: float = 0.0
    outage: tuple[int, int] = (0, 0)
    """Frames of this step and on, and before that one, are lost."""

    def __post_init__(self) -> None:
        """Raises `InputError` for errors that no lidar has."""
        check_not_negative("a lidar", noise_std=self.noise_std)
        for good, what, got in (
            (abs(self.bias) < LARGEST, "a finite bias", self.bias),
            (-1.0 < self.scale_error < LARGEST, "scale_error above -1", self.scale_error),
            (
                0.0 < self.max_incidence <= math.pi / 2.0,
                "max_incidence above 0 and up to pi / 2",
                self.max_incidence,
            ),
            (0.0 <= self.dropout <= 1.0, "dropout from 0 to 1", self.dropout),
            (0.0 <= self.false_returns <= 1.0, "false_returns from 0 to 1", self.false_returns),
            (0.0 <= self.beam_width <= 0.1, "beam_width from 0 to 0.1 rad", self.beam_width),
            (0.0 <= self.frame_loss <= 1.0, "frame_loss from 0 to 1", self.frame_loss),
        ):
            if not good:
                raise InputError(f"a lidar needs {what}, got {got}")


class TrueReturns(NamedTuple):
    """The K rays of a frame that meet a surface."""

    rays: Values
    """(K,) int: index of the ray, ascending."""
    distances: Values
    """(K,) float64: distance in m to the surface."""
    grazing: Values | None = None
    """(K,) bool: whether the ray meets the surface at too flat an angle to return. None: no ray
    does."""


DEFAULT_ERRORS = LidarErrors(noise_std=50.0)
"""Range noise of 50 m and nothing else."""


def measured_ranges(distances: Values, errors: LidarErrors, seed: int, step: int) -> Values:
    """What the lidar reads (K,) in m, float64, for true distances (K,) in m: never negative.

    range = (1 + scale error) distance + bias + noise.
    """
    ranges = distances * (1.0 + errors.scale_error) + errors.bias
    if errors.noise_std > 0.0:
        draws = generator(seed, step, NOISE_STREAM).standard_normal(ranges.size)
        ranges += errors.noise_std * draws
    return np.maximum(ranges, 0.0, out=ranges)


def too_grazing(normals: Vectors3, directions: Vectors3, max_incidence: float) -> Values:
    """Which rays (K,), bool, meet the surface at too flat an angle to return.

    A matt (Lambertian) surface reflects less light the flatter a ray meets it, as the cosine of the
    angle of incidence. A receiver with a threshold sees nothing beyond some angle: a hard limit.
    The limit's change with range is neglected.

    Args:
      normals, directions: (K, 3) unit vectors: the surface's normals and the rays.
      max_incidence: the greatest angle between a ray's line and the normal, in rad.
    """
    return np.abs(np.einsum("ki,ki->k", normals, directions)) < math.cos(max_incidence)


def false_ranges(
    count: int, probability: float, max_range: float, seed: int, step: int
) -> np.ndarray:
    """Ranges (count,) in m of false returns, +inf on the rays that have none.

    Dust, glint or the receiver's own noise cause them. Each ray has one with the given probability,
    at a range that is uniform up to the maximum range. A lidar takes the first return, so it reads
    the lesser of the false and the true range.
    """
    random = generator(seed, step, FALSE_RETURN_STREAM)
    ranges = np.full(count, np.inf)
    false = random.random(count) < probability
    ranges[false] = max_range * random.random(np.count_nonzero(false))
    return ranges


def received_ranges(
    returns: TrueReturns, count: int, max_range: float, errors: LidarErrors, seed: int, step: int
) -> np.ndarray:
    """The frame (count,) in m, float64, that a lidar measures; +inf: no return.

    Args:
      returns: what rays meet a surface. count: number of rays.
      max_range: m, a surface beyond returns nothing.
      errors: those of the ranges; seed and step of their random numbers follow.
    """
    ranges = np.full(count, np.inf)
    if errors.outage[0] <= step < errors.outage[1]:
        return ranges
    chance = errors.frame_loss
    if chance > 0.0 and generator(seed, step, FRAME_LOSS_STREAM).random() < chance:
        return ranges
    near = returns.distances <= max_range
    # Noise is drawn for every return in range before any is lost, so that dropout leaves the
    # noise of the others as it is.
    found = measured_ranges(returns.distances[near], errors, seed, step)
    if returns.grazing is not None:
        found[returns.grazing[near]] = np.inf
    if errors.dropout > 0.0:
        chances = generator(seed, step, DROPOUT_STREAM).random(found.size)
        found[chances < errors.dropout] = np.inf
    ranges[returns.rays[near]] = found
    if errors.false_returns > 0.0:
        false = false_ranges(count, errors.false_returns, max_range, seed, step)
        ranges = np.minimum(ranges, false)
    return ranges


def check_false_returns(errors: LidarErrors, max_range: float) -> None:
    """Raises `InputError` if there are false returns at an infinite greatest range."""
    if errors.false_returns > 0.0 and not max_range < math.inf:
        raise InputError("a lidar with false_returns needs a finite max_range")


def check_rays(errors: LidarErrors, owner: str) -> None:
    """Raises `InputError` if beams have a width, for a lidar that knows rays alone."""
    if errors.beam_width > 0.0:
        raise InputError(f"{owner} knows rays without a width: leave out beam_width, or use Lidar")
