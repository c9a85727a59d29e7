"""What so many flights show: against closed forms, brute force and simulated campaigns."""

import math

import numpy as np
import pytest
from scipy.stats import beta

from proxops.studies.figures.intervals import exact_interval, percentile_bound, shown_success


def tail(successes: int, trials: int, share: float) -> float:
    """The probability of so many successes or more, by summing the binomial distribution."""
    return sum(
        math.comb(trials, k) * share**k * (1.0 - share) ** (trials - k)
        for k in range(successes, trials + 1)
    )


@pytest.mark.parametrize(("trials", "share"), [(852, 0.9973), (200, 0.9886), (1, 0.1)])
def test_no_failure_shows(trials: int, share: float) -> None:
    """Hanson & Beard, table 1: 852 flights without a failure show 3 sigma at 90 %."""
    assert shown_success(trials, trials) == pytest.approx(share, abs=5e-5)
    assert shown_success(trials, trials) == pytest.approx(0.1 ** (1.0 / trials), rel=1e-12)


@pytest.mark.parametrize(("successes", "trials"), [(1, 1), (1, 30), (17, 20), (39, 40), (40, 40)])
def test_what_is_shown_leaves_a_tenth(successes: int, trials: int) -> None:
    shown = shown_success(successes, trials)
    assert tail(successes, trials, shown) == pytest.approx(0.1, rel=1e-9)
    assert 0.0 < shown < successes / trials


@pytest.mark.parametrize(("successes", "trials"), [(1, 9), (5, 10), (199, 200), (838, 852)])
def test_exact_interval_of_beta_quantiles(successes: int, trials: int) -> None:
    low, high = exact_interval(successes, trials)
    assert low == pytest.approx(beta.ppf(0.025, successes, trials - successes + 1), rel=1e-9)
    assert high == pytest.approx(beta.ppf(0.975, successes + 1, trials - successes), rel=1e-9)


def test_exact_interval_at_its_ends() -> None:
    assert exact_interval(0, 0) == (0.0, 1.0)
    assert exact_interval(20, 20) == pytest.approx((0.025**0.05, 1.0))
    assert exact_interval(0, 20) == pytest.approx((0.0, 1.0 - 0.025**0.05))


def test_bound_of_the_99th_percentile_needs_230_flights() -> None:
    """All of n draws lie below the quantile with 0.99^n: 0.1 or less from n = 230 on."""
    assert percentile_bound(range(229)) is None
    assert percentile_bound(range(230)) == 229.0
    assert percentile_bound([]) is percentile_bound([1.0]) is None


@pytest.mark.parametrize(("count", "share"), [(23, 0.5), (60, 0.9), (388, 0.99), (852, 0.99)])
def test_bound_is_the_smallest_that_suffices(count: int, share: float) -> None:
    bound = percentile_bound(np.arange(count, 0, -1.0).tolist(), share)
    assert bound is not None
    rank = round(bound)  # The k-th order statistic is k.
    below = [1.0 - tail(r, count, share) for r in (rank, rank - 1)]  # P(Bin < r), P(Bin < r - 1).
    assert below[0] >= 0.9 > below[1]
