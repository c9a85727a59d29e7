"""`gauss_markov_at`: a slowly varying random vector as a pure function of seed and time."""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence

import numpy as np

from proxops.systems.common import (
    SeededSystem,
    Vector,
    check_not_negative,
    derived_seed,
    finite_vector,
    generator,
)

# The shortest sequence that is drawn: that of a transit of 7,200 s in steps of 10 s fits in it.
_SHORTEST = 1024


def gauss_markov_at(
    time: float, *, std: float, correlation_time: float, period: float, seed: int
) -> Vector:
    """A first-order Gauss-Markov process (3,) at a time, the same for the same seed.

    At the control steps k each axis is the stationary sequence

        n_0 = s w_0,   n_k = r n_(k-1) + s sqrt(1 - r^2) w_k,   r = exp(-period / correlation time)

    with independent standard normal w, so that the correlation of two steps falls exponentially
    with the time between them. Between steps it is linear, so that an integrator sees a continuous
    function; there, the standard deviation is a little lower: at most by a factor of
    sqrt((1 + r) / 2), halfway. It is white at the steps if the correlation time is 0.

    Args:
      time: s; before 0 the value is that at 0.
      std: standard deviation s per axis, in the unit of the result.
      correlation_time, period: s.
      seed: all w are drawn from one generator with this key.
    """
    if std == 0.0:
        return 0.0, 0.0, 0.0
    steps = max(time / period, 0.0)
    step = int(steps)
    kept = math.exp(-period / correlation_time) if correlation_time > 0.0 else 0.0
    sequence = _sequence(seed, kept, max(_SHORTEST, 1 << (step + 1).bit_length()))
    part = steps - step
    (a, b, c), (d, e, f) = sequence[step], sequence[step + 1]
    return std * (a + part * (d - a)), std * (b + part * (e - b)), std * (c + part * (f - c))


def white_noise_at(time: float, *, std: float, period: float, seed: int) -> Vector:
    """Independent normal numbers (3,) of each step, the same for the same seed.

    They are independent of `gauss_markov_at` of the same seed.

    Args:
      time: s; a whole multiple of the period. std: of each number. period: s. seed: of all.
    """
    if std == 0.0:
        return 0.0, 0.0, 0.0
    step = max(round(time / period), 0)
    x, y, z = _sequence(_other_seed(seed), 0.0, max(_SHORTEST, 1 << (step + 1).bit_length()))[step]
    return std * x, std * y, std * z


@functools.lru_cache(maxsize=16)
def _other_seed(seed: int) -> int:
    return derived_seed(seed, 1)


@functools.lru_cache(maxsize=16)
def _sequence(seed: int, kept: float, count: int) -> list[Vector]:
    """The first `count` terms, for a standard deviation of 1.

    They are remembered for speed. A longer sequence begins with the same terms, bit for bit.
    """
    added = math.sqrt(1.0 - kept**2)
    draws = generator(seed, 0).standard_normal((count, 3)).tolist()
    x, y, z = draws[0]
    terms = [(x, y, z)]
    for u, v, w in draws[1:]:
        x, y, z = kept * x + added * u, kept * y + added * v, kept * z + added * w
        terms.append((x, y, z))
    return terms


class SlowVector(SeededSystem):
    """What has a constant vector, and beside it one that varies slowly: `gauss_markov_at`."""

    def __init__(
        self,
        constant: Sequence[float] | np.ndarray,
        std: float,
        correlation_time: float,
        period: float,
        seed: int,
    ):
        """Takes the constant (3,), the deviation, correlation time and period in s, and a seed."""
        super().__init__(period, seed)
        owner = type(self).__name__
        check_not_negative(owner, std=std, correlation_time=correlation_time)
        self.constant = finite_vector(owner, "constant", constant)
        self.std, self.correlation_time = std, correlation_time

    def vector_at(self, context) -> Vector:
        """The sum of both parts at the time of a Context."""
        u, v, w = gauss_markov_at(
            context.get_time(),
            std=self.std,
            correlation_time=self.correlation_time,
            period=self.period,
            seed=self.seed_of(context),
        )
        x, y, z = self.constant
        return x + u, y + v, z + w
