"""Figures of merit over many flights of one controller."""

from __future__ import annotations

import math
import typing
from collections.abc import Sequence

import numpy as np

Row = dict[str, typing.Any]

# Of a summary, if the policy estimates its state.
_ESTIMATE_ERRORS = (
    "estimate_position_error_m_median",
    "estimate_position_error_m_p95",
    "estimate_velocity_error_m_s_median",
    "estimate_velocity_error_m_s_p95",
)


def wilson_interval(successes: int, trials: int, z: float = 1.959964) -> tuple[float, float]:
    """Wilson's score interval of a share (95 % by default); (0, 1) without trials.

    E. B. Wilson, J. Am. Stat. Assoc. 22 (1927) 209.
    """
    if trials == 0:
        return 0.0, 1.0
    share = successes / trials
    scale = 1.0 + z * z / trials
    centre = (share + z * z / (2 * trials)) / scale
    half = z / scale * math.sqrt(share * (1 - share) / trials + z * z / (4 * trials**2))
    # At the ends rounding must not leave the share itself outside.
    low = 0.0 if successes == 0 else centre - half
    high = 1.0 if successes == trials else centre + half
    return low, high


def aggregate(rows: Sequence[Row]) -> dict[str, typing.Any]:
    """One controller's entry of `results.json` from its flights' summaries.

    Terminal figures are over all flights, delta-v and arrival time over those that arrived. Errors
    of the policy's estimates are medians over flights of the median and p95 of each.
    """
    successes = sum(row["success"] for row in rows)
    arrived = [row for row in rows if row["success"]]
    timed = [row for row in rows if row["control_ms_median"] is not None]
    estimated = [row for row in rows if "estimate_position_error_m_median" in row]
    return {
        "transits": len(rows),
        "success_rate": successes / len(rows),
        "success_rate_interval": wilson_interval(successes, len(rows)),
        "success_rate_2km": sum(row["success_2km"] for row in rows) / len(rows),
        "collisions": sum(row["collided"] for row in rows),
        "keep_out_violations": sum(row["keep_out_violations"] for row in rows),
        "min_clearance_m": min(row["min_clearance_m"] for row in rows),
        "terminal_position_error_m_median": _median(rows, "terminal_position_error_m"),
        "terminal_position_error_m_p95": _percentile(rows, "terminal_position_error_m", 95),
        "terminal_position_error_m_max": _percentile(rows, "terminal_position_error_m", 100),
        "terminal_speed_m_s_max": _percentile(rows, "terminal_speed_m_s", 100),
        "arrival_time_s_median": _median(arrived, "arrival_time_s"),
        "delta_v_m_s_median": _median(arrived, "delta_v_m_s"),
        "delta_v_m_s_mean": float(np.mean([row["delta_v_m_s"] for row in arrived]))
        if arrived
        else None,
        "policy_share": float(np.mean([row["policy_share"] for row in rows])),
        "policy_share_to_arrival": _mean(rows, "policy_share_to_arrival"),
        "mpc_solves": sum(row["mpc_solves"] for row in rows),
        "control_ms_median": _median(timed, "control_ms_median"),
        "control_ms_mean": _mean(rows, "control_ms_mean"),
        "control_ms_p99": _percentile(timed, "control_ms_p99", 100),
        **{name: _median(estimated, name) for name in _ESTIMATE_ERRORS if estimated},
        "flights": list(rows),
    }


def _percentile(rows: Sequence[Row], name: str, percent: float) -> float | None:
    values = [row[name] for row in rows]
    return float(np.percentile(values, percent)) if values else None


def _mean(rows: Sequence[Row], name: str) -> float | None:
    """Over the flights that have the figure."""
    values = [row[name] for row in rows if row[name] is not None]
    return float(np.mean(values)) if values else None


def _median(rows: Sequence[Row], name: str) -> float | None:
    return _percentile(rows, name, 50)
