"""Intervals and bounds of what a number of flights shows.

The figures follow J. M. Hanson and B. B. Beard, Applying Monte Carlo Simulation to Launch Vehicle
Design and Requirements Analysis, NASA/TP-2010-216447. They assume that flights are independent
draws from the same dispersions; they assume no distribution of the figure itself.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

CONFIDENCE = 0.9
"""Confidence of what is said to be shown, and of the bound of a percentile."""


def success_interval(successes: int, trials: int) -> tuple[float, float]:
    """Returns Wilson's score interval of 95 % for a share of successes; (0, 1) without trials."""
    return _interval(successes, trials, "wilson")


def exact_interval(successes: int, trials: int) -> tuple[float, float]:
    """Returns the exact binomial interval of 95 % for a share; (0, 1) without trials.

    It is that of C. J. Clopper and E. S. Pearson, Biometrika 26 (1934) 404: it holds the true
    share with a probability of at least 95 %, whatever this share is.
    """
    return _interval(successes, trials, "exact")


def shown_success(successes: int, trials: int) -> float:
    """Returns the greatest probability of success that flights show with 90 % confidence.

    It is Clopper and Pearson's lower bound, one-sided: with this probability of success, so many
    successes or more have a probability of 0.1. With no failure in n flights it is 0.1^(1/n).

    Args:
      successes: the number of flights that succeeded.
      trials: the number of flights.

    Returns:
      A probability; 0 without a success.
    """
    if successes == 0:
        return 0.0
    from scipy.stats import beta  # It is slow to import, so only when it is needed.

    return float(beta.ppf(1.0 - CONFIDENCE, successes, trials - successes + 1))


def percentile(values: Sequence[float], percent: float) -> float | None:
    """Returns a percentile, interpolated between order statistics; None without values."""
    return float(np.percentile(values, percent)) if len(values) else None


def percentile_bound(values: Sequence[float], share: float = 0.99) -> float | None:
    """Returns an upper bound of a quantile, of 90 % confidence, that assumes no distribution.

    It is the smallest order statistic x_(r) for which r - 1 draws or fewer lie below the quantile
    with a probability of at least the confidence, P(Bin(n, share) < r) >= 0.9: the quantile then is
    at most x_(r) with that confidence. See H. A. David and H. N. Nagaraja, Order Statistics, 3rd
    edition, section 7.1. The 99 % quantile needs 230 values.

    Args:
      values: one figure of each flight.
      share: of the quantile, above 0 and below 1.

    Returns:
      One of the values, or None if there are too few.
    """
    from scipy.stats import binom  # It is slow to import, so only when it is needed.

    count = len(values)
    rank = int(binom.ppf(CONFIDENCE, count, share)) + 1 if count else 1
    return float(np.sort(values)[rank - 1]) if rank <= count else None


def _interval(successes: int, trials: int, method: str) -> tuple[float, float]:
    if trials == 0:
        return 0.0, 1.0
    from scipy.stats import binomtest  # It is slow to import, so only when it is needed.

    interval = binomtest(successes, trials).proportion_ci(0.95, method=method)
    return float(interval.low), float(interval.high)
