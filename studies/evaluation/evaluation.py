"""Figures of merit over many flights of one controller."""

from __future__ import annotations

import typing
from collections.abc import Mapping, Sequence

import numpy as np

EXPERT = "mpc"
"""The controller that the others are measured against."""

Row = dict[str, typing.Any]

# A summary has these if the policy estimates its state.
_ESTIMATE_ERRORS = (
    "estimate_position_error_m_median",
    "estimate_position_error_m_p95",
    "estimate_velocity_error_m_s_median",
    "estimate_velocity_error_m_s_p95",
)


def success_interval(successes: int, trials: int) -> tuple[float, float]:
    """Returns Wilson's score interval of 95 % for a share of successes; (0, 1) without trials."""
    if trials == 0:
        return 0.0, 1.0
    from scipy.stats import binomtest  # It is slow to import, so only when it is needed.

    interval = binomtest(successes, trials).proportion_ci(0.95, method="wilson")
    return float(interval.low), float(interval.high)


def aggregate(rows: Sequence[Row], expert: Sequence[Row] | None = None) -> dict[str, typing.Any]:
    """Makes one controller's entry of `results.json` from the summaries of its flights.

    Terminal figures count all flights; delta-v and arrival time count those that succeeded. Errors
    of the policy's estimates are medians over flights of each flight's median and p95.

    Args:
      rows: one for each flight.
      expert: the MPC's rows of the same transits in the same order. With them the entry compares
        delta-v on the transits in which both succeeded: it has the number of these transits, the
        median of the ratios, and the ratio of the sums.
    """
    successes = sum(row["success"] for row in rows)
    wide_successes = sum(row["success_2km"] for row in rows)
    arrived = [row for row in rows if row["success"]]
    timed = [row for row in rows if row["control_ms_median"] is not None]
    estimated = [row for row in rows if "estimate_position_error_m_median" in row]
    return {
        "transits": len(rows),
        "success_rate": successes / len(rows),
        "success_rate_interval": success_interval(successes, len(rows)),
        "success_rate_2km": wide_successes / len(rows),
        "success_rate_2km_interval": success_interval(wide_successes, len(rows)),
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
        **(_against_expert(rows, expert) if expert is not None else {}),
        "policy_share": float(np.mean([row["policy_share"] for row in rows])),
        "policy_share_to_arrival": _mean(rows, "policy_share_to_arrival"),
        "mpc_solves": sum(row["mpc_solves"] for row in rows),
        "control_ms_median": _median(timed, "control_ms_median"),
        "control_ms_mean": _mean(rows, "control_ms_mean"),
        "control_ms_p99": _percentile(timed, "control_ms_p99", 100),
        **{name: _median(estimated, name) for name in _ESTIMATE_ERRORS if estimated},
        **_small_commands(rows),
        "flights": list(rows),
    }


def aggregate_all(
    groups: Mapping[str, Sequence[Row]],
) -> dict[str, dict[str, typing.Any]]:
    """Aggregates each controller's rows; if the expert is there, compares all others with it.

    Args:
      groups: the rows of each controller in the order of the transits, by its name.
    """
    expert = groups.get(EXPERT)
    return {
        name: aggregate(rows, None if name == EXPERT else expert) for name, rows in groups.items()
    }


def _against_expert(rows: Sequence[Row], expert: Sequence[Row]) -> dict[str, typing.Any]:
    pairs = delta_v_pairs(rows, expert)
    ratios = pairs[:, 0] / pairs[:, 1]
    return {
        "expert_pairs": len(pairs),
        "expert_delta_v_ratio_median": float(np.median(ratios)) if len(pairs) else None,
        "expert_delta_v_ratio": float(np.divide(*pairs.sum(axis=0))) if len(pairs) else None,
    }


def _small_commands(rows: Sequence[Row]) -> dict[str, float]:
    """The share of all steps with a small command; empty if a row does not have its own share."""
    if not all("small_command_share" in row for row in rows):
        return {}
    shares, steps = ([row[name] for row in rows] for name in ("small_command_share", "steps"))
    return {"small_command_share": float(np.average(shares, weights=steps))}


def delta_v_pairs(rows: Sequence[Row], expert: Sequence[Row]) -> np.ndarray:
    """Returns the delta-v (N, 2) in m/s of a controller and of the MPC, where both succeeded.

    A flight that starts in the goal region needs no delta-v, and is left out.

    Raises:
      ValueError: the rows are not of the same transits.
    """
    pairs = []
    for row, best in zip(rows, expert, strict=True):
        if any(row[name] != best[name] for name in ("seed", "transit")):
            raise ValueError("rows of a controller and of the MPC are of other transits")
        if row["success"] and best["success"] and best["delta_v_m_s"] > 0.0:
            pairs.append((row["delta_v_m_s"], best["delta_v_m_s"]))
    return np.array(pairs).reshape(-1, 2)


def _percentile(rows: Sequence[Row], name: str, percent: float) -> float | None:
    values = [row[name] for row in rows]
    return float(np.percentile(values, percent)) if values else None


def _mean(rows: Sequence[Row], name: str) -> float | None:
    """The mean over the flights that have the figure."""
    values = [row[name] for row in rows if row[name] is not None]
    return float(np.mean(values)) if values else None


def _median(rows: Sequence[Row], name: str) -> float | None:
    return _percentile(rows, name, 50)
