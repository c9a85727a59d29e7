"""Figures over many flights."""

import math

import numpy as np
import pytest
from flight_rows import row

from proxops.studies.figures.intervals import success_interval
from proxops.studies.figures.results import aggregate, delta_v_pairs


def test_interval_of_published_examples() -> None:
    """Newcombe, Statistics in Medicine 17 (1998) 857, table I: 81 of 263, 15 of 148, 0, 1."""
    assert success_interval(81, 263) == pytest.approx((0.2553, 0.3662), abs=5e-5)
    assert success_interval(15, 148) == pytest.approx((0.0624, 0.1605), abs=5e-5)
    assert success_interval(0, 20) == pytest.approx((0.0, 0.1611), abs=5e-5)
    assert success_interval(1, 29) == pytest.approx((0.0061, 0.1718), abs=5e-5)


@pytest.mark.parametrize(("successes", "trials"), [(1, 2), (3, 7), (49, 50), (398, 400)])
def test_interval_solves_wilson_s_equation(successes: int, trials: int) -> None:
    """E. B. Wilson, J. Am. Stat. Assoc. 22 (1927) 209: |share - p| = z sqrt(p (1 - p) / n)."""
    z, share = 1.959964, successes / trials
    for end in success_interval(successes, trials):
        error = z * math.sqrt(end * (1.0 - end) / trials)
        assert abs(share - end) == pytest.approx(error, rel=1e-6)


def test_aggregate_of_navigation() -> None:
    """Of the flights whose navigation settled: medians of errors, means of shares."""
    names = [
        f"navigation_{part}_{end}"
        for part in ("position_error_m", "velocity_error_m_s", "attitude_error_deg")
        for end in ("median", "p95")
    ]
    rows = [
        row(
            transit=k, navigation_consistent=share, navigation_following=1.0,
            **{name: factor * (1.0 + place) for place, name in enumerate(names)},
        )
        for k, (factor, share) in enumerate([(1.0, 1.0), (2.0, 0.9), (9.0, 0.8)])
    ]  # fmt: skip
    found = aggregate([*rows, row(transit=3, navigation_following=0.5)])
    assert [getattr(found, name) for name in names] == [2.0 * (1.0 + place) for place in range(6)]
    assert found.navigation_consistent == pytest.approx(0.9)
    assert found.navigation_following == 1.0
    assert all(getattr(aggregate([row()]), name) is None for name in names)


def test_aggregate() -> None:
    rows = [
        row(),
        row(transit=1, terminal_position_error_m=3.0, delta_v_m_s=200.0, arrival_time_s=5000.0),
        row(transit=2, terminal_position_error_m=2.0, control_ms_p99=30.0, mpc_solves=10),
        row(
            transit=3, success=False, success_2km=True, keep_out_violations=2,
            terminal_position_error_m=1500.0, arrival_time_s=None, delta_v_m_s=999.0,
            min_clearance_m=-40.0, policy_share=1.0, mpc_solves=0, control_ms_median=None,
            control_ms_p99=None, control_ms_mean=None, policy_share_to_arrival=1.0,
        ),
        row(
            transit=4, success=False, success_2km=False, collided=True, keep_out_violations=1,
            terminal_position_error_m=9e4, terminal_speed_m_s=45.0, arrival_time_s=None,
            min_clearance_m=-2e4, delta_v_m_s=0.0,
        ),
    ]  # fmt: skip
    found = aggregate(rows)
    assert found.transits == 5
    assert found.success_rate == 0.6
    assert found.success_rate_interval == success_interval(3, 5)
    assert found.success_rate_2km == 0.8
    assert found.success_rate_2km_interval == success_interval(4, 5)
    assert found.expert_pairs is found.expert_delta_v_ratio is None
    assert found.collisions == 1
    assert found.keep_out_violations == 3
    assert found.min_clearance_m == -2e4
    assert found.terminal_position_error_m_median == 3.0
    assert found.terminal_position_error_m_max == 9e4
    assert 1500.0 < (found.terminal_position_error_m_p95 or 0.0) < 9e4
    assert found.terminal_speed_m_s_max == 45.0
    # Only flights that arrived count: one that never ends must not look cheap or dear.
    assert found.arrival_time_s_median == 4000.0
    assert found.delta_v_m_s_median == 150.0
    assert found.delta_v_m_s_mean == pytest.approx(500.0 / 3.0)
    assert found.policy_share == 0.2
    assert found.policy_share_to_arrival == 0.2
    assert found.mpc_solves == 460 * 3 + 10
    assert found.control_ms_mean == 5.0
    assert found.control_ms_median == 4.0
    assert found.control_ms_p99 == 30.0
    assert found.flights == rows


@pytest.mark.parametrize("good", [0, 1, 426, 851, 852])
def test_successes_are_counted(good: int) -> None:
    rows = [row(transit=k, success=k < good, success_2km=k < min(good + 1, 852))
            for k in range(852)]  # fmt: skip
    found = aggregate(rows)
    assert (found.successes, found.successes_2km) == (good, min(good + 1, 852))
    assert found.succeeded() == f"{good} of 852"
    assert found.succeeded(wide=True) == f"{min(good + 1, 852)} of 852"
    assert aggregate([]).succeeded() == "0 of 0"


def test_percentiles_and_worst() -> None:
    """101 flights whose figures are 0, 1, … 100: then percentile p is p."""
    rows = [
        row(transit=k, delta_v_m_s=float(k), terminal_position_error_m=float(k),
            arrival_time_s=float(k), min_clearance_m=float(k))
        for k in range(101)
    ]  # fmt: skip
    found = aggregate(rows)
    for name in ("delta_v_m_s_{}", "terminal_position_error_m_{}", "arrival_time_s_{}"):
        p99 = "delta_v_99_m_s" if name.startswith("delta") else name.format("p99")
        keys = (name.format("median"), name.format("p90"), p99, name.format("max"))
        assert [getattr(found, key) for key in keys] == pytest.approx([50.0, 90.0, 99.0, 100.0])
    lows = ("min_clearance_m", "min_clearance_m_p1", "min_clearance_m_p10")
    assert [getattr(found, key) for key in lows] == pytest.approx([0.0, 1.0, 10.0])
    assert found.terminal_position_error_m_p95 == pytest.approx(95.0)
    assert found.min_clearance_m_median == pytest.approx(50.0)
    assert found.delta_v_99_m_s_bound is None  # 230 flights are needed.
    more = aggregate([row(transit=k, delta_v_m_s=float(k)) for k in range(230)])
    assert more.delta_v_99_m_s_bound == 229.0
    assert found.success_shown_90 == pytest.approx(0.1 ** (1 / 101))
    assert found.success_rate_exact_interval == pytest.approx((0.025 ** (1 / 101), 1.0))


# --- against the expert ---------------------------------------------------------------------------


def test_delta_v_against_the_expert_on_the_same_transits() -> None:
    """Only where both succeeded: who gives up must not look thrifty, nor who cuts a corner."""
    expert = [row(transit=k, delta_v_m_s=100.0 + 50.0 * k) for k in range(6)]
    expert[2] = row(transit=2, success=False, delta_v_m_s=1.0)
    rows = [row(transit=k, delta_v_m_s=value) for k, value in enumerate(
        (110.0, 300.0, 220.0, 5.0, 330.0, 700.0)
    )]  # fmt: skip
    rows[3] |= {"success": False, "arrival_time_s": None}
    rows[4] |= {"success": False, "keep_out_violations": 1}
    found = aggregate(rows, expert)
    assert found.expert_pairs == 3
    assert found.expert_delta_v_ratio_median == pytest.approx(2.0)  # Of 1.1, 2.0 and 2.0.
    assert found.expert_delta_v_ratio == pytest.approx(1110.0 / 600.0)
    np.testing.assert_array_equal(
        delta_v_pairs(rows, expert), [[110.0, 100.0], [300.0, 150.0], [700.0, 350.0]]
    )
