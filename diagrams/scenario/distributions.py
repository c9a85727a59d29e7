"""Distributions of a dispersed quantity; each maps a uniform number to a value, within bounds."""

from __future__ import annotations

import math
import typing
from dataclasses import dataclass

from scipy.special import ndtr, ndtri

from proxops.diagrams.yaml_files import is_number
from proxops.systems.common import InputError

# Values are cut at this many standard deviations, so that bounds exist.
_CUT = 3.0


@dataclass(frozen=True)
class Normal:
    """Normal about `mean`, cut at three standard deviations."""

    mean: float
    three_sigma: float

    def __post_init__(self) -> None:
        _check(self.three_sigma >= 0.0, "three_sigma must not be negative", self.three_sigma)

    def value(self, uniform: float) -> float:
        """Gives the value at a share (0 to 1) of the distribution."""
        low = ndtr(-_CUT)
        deviations = ndtri(low + uniform * (1.0 - 2.0 * low))
        return self.mean + self.three_sigma / _CUT * float(deviations)

    def bounds(self) -> tuple[float, float]:
        """Gives the least and the greatest value."""
        return self.mean - self.three_sigma, self.mean + self.three_sigma

    def rms(self, about: float) -> float:
        """Gives the root mean square of what a value differs by from `about`, without the cut."""
        return math.hypot(self.mean - about, self.three_sigma / _CUT)


@dataclass(frozen=True)
class HalfNormal:
    """`least` plus the size of a normal number, cut at three standard deviations."""

    least: float
    three_sigma: float

    def __post_init__(self) -> None:
        _check(self.three_sigma >= 0.0, "three_sigma must not be negative", self.three_sigma)

    def value(self, uniform: float) -> float:
        """Gives the value at a share (0 to 1) of the distribution."""
        deviations = ndtri(0.5 + uniform * (ndtr(_CUT) - 0.5))
        return self.least + self.three_sigma / _CUT * float(deviations)

    def bounds(self) -> tuple[float, float]:
        """Gives the least and the greatest value."""
        return self.least, self.least + self.three_sigma

    def rms(self, about: float) -> float:
        """Gives the root mean square of what a value differs by from `about`, without the cut."""
        off, sigma = self.least - about, self.three_sigma / _CUT
        mean = off + math.sqrt(2.0 / math.pi) * sigma
        return math.hypot(mean, math.sqrt(1.0 - 2.0 / math.pi) * sigma)


@dataclass(frozen=True)
class Uniform:
    """Uniform from `low` to `high`."""

    low: float
    high: float

    def __post_init__(self) -> None:
        _check(self.low <= self.high, "uniform needs its lower end first", [self.low, self.high])

    def value(self, uniform: float) -> float:
        """Gives the value at a share (0 to 1) of the distribution."""
        return self.low + uniform * (self.high - self.low)

    def bounds(self) -> tuple[float, float]:
        """Gives the least and the greatest value."""
        return self.low, self.high

    def rms(self, about: float) -> float:
        """Gives the root mean square of what a value differs by from `about`."""
        middle = 0.5 * (self.low + self.high)
        return math.hypot(middle - about, (self.high - self.low) / math.sqrt(12.0))


@dataclass(frozen=True)
class LogUniform(Uniform):
    """A positive value whose logarithm is uniform, from `low` to `high`."""

    def __post_init__(self) -> None:
        _check(self.low > 0.0, "log_uniform needs positive ends", [self.low, self.high])
        _check(self.low <= self.high, "log_uniform needs its lower end first", self.low)

    def value(self, uniform: float) -> float:
        """Gives the value at a share (0 to 1) of the distribution."""
        return self.low * (self.high / self.low) ** uniform

    def rms(self, about: float) -> float:
        """Gives the root mean square of what a value differs by from `about`."""
        width = math.log(self.high / self.low)
        if width == 0.0:
            return abs(self.low - about)
        mean = (self.high - self.low) / width
        square = 0.5 * (self.high**2 - self.low**2) / width
        return math.sqrt(max(square - 2.0 * about * mean + about**2, 0.0))


@dataclass(frozen=True)
class Choice:
    """One of some values, all equally probable."""

    values: tuple[typing.Any, ...]

    def __post_init__(self) -> None:
        _check(len(self.values) > 0, "choice needs at least one value", list(self.values))

    def value(self, uniform: float) -> typing.Any:
        """Gives the value at a share (0 to 1) of the distribution."""
        return self.values[min(int(uniform * len(self.values)), len(self.values) - 1)]

    def bounds(self) -> tuple[float, float] | None:
        """Gives the least and the greatest value; None if the values are no numbers."""
        numbers = [value for value in self.values if is_number(value)]
        return (min(numbers), max(numbers)) if len(numbers) == len(self.values) else None

    def rms(self, about: float) -> float | None:
        """Gives the root mean square of what a value differs by from `about`; None: no numbers."""
        if self.bounds() is None:
            return None
        off = math.hypot(*(value - about for value in self.values))
        return off / math.sqrt(len(self.values))


class Fixed(Choice):
    """Always the same value, the only one of `values`."""


Distribution = Normal | HalfNormal | Uniform | LogUniform | Choice

KINDS = ("normal", "half_normal", "uniform", "log_uniform", "choice", "fixed")
"""Names of the distributions in a YAML file."""


def parse_distribution(entry: dict[str, typing.Any]) -> Distribution:
    """Makes a distribution from its YAML entry, such as `{normal: 1.0, three_sigma: 0.1}`.

    Raises:
      InputError: the entry names no distribution or several, or a parameter is missing or wrong.
    """
    kinds = [name for name in KINDS if name in entry]
    if len(kinds) != 1:
        raise InputError(f"needs exactly one of {', '.join(KINDS)}, got {entry}")
    strange = [name for name in entry if name not in (*KINDS, "three_sigma")]
    if strange:
        raise InputError(f"has {strange[0]!r}; it takes a distribution, times and source")
    kind, value = kinds[0], entry[kinds[0]]
    if kind in ("normal", "half_normal"):
        if "three_sigma" not in entry:
            raise InputError(f"needs three_sigma, three standard deviations, beside {kind}")
        made = Normal if kind == "normal" else HalfNormal
        return made(finite_number(value, kind), finite_number(entry["three_sigma"], "three_sigma"))
    if "three_sigma" in entry:
        raise InputError(f"has three_sigma, which {kind} does not take")
    if kind in ("uniform", "log_uniform"):
        if not isinstance(value, list) or len(value) != 2:
            raise InputError(f"needs two numbers, {kind}: [low, high], got {value}")
        low, high = (finite_number(each, kind) for each in value)
        return (Uniform if kind == "uniform" else LogUniform)(low, high)
    if kind == "choice":
        if not isinstance(value, list):
            raise InputError(f"needs a list, choice: [value, value], got {value}")
        return Choice(tuple(value))
    return Fixed((value,))


def finite_number(value: typing.Any, what: str) -> float:
    """Gives a number as a float.

    Raises:
      InputError: it is none, or not finite; the message begins with "needs".
    """
    try:
        number = float(value) if is_number(value) else math.nan
    except OverflowError:
        number = math.nan
    if not math.isfinite(number):
        raise InputError(f"needs a finite number for {what}, got {value!r}")
    return number


def _check(good: bool, complaint: str, got: typing.Any) -> None:
    if not good:
        raise InputError(f"{complaint}, got {got}")
