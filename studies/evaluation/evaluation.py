"""Figures of merit over many flights of one controller."""

from __future__ import annotations

import typing
from collections.abc import Mapping, Sequence

import numpy as np

from proxops.diagrams.flight import Row
from proxops.studies.evaluation.sensitivity import rank_drivers
from proxops.studies.evaluation.statistics_of_flights import (
    exact_interval,
    percentile,
    percentile_bound,
    shown_success,
    success_interval,
)

EXPERT = "mpc"
"""The controller that the others are measured against."""


_OF_THE_FLIGHTS = ("flights", "unflyable_worlds", "sensitivity")
# A summary has these if the policy estimates its state.
_ESTIMATE_ERRORS = (
    "estimate_position_error_m_median",
    "estimate_position_error_m_p95",
    "estimate_velocity_error_m_s_median",
    "estimate_velocity_error_m_s_p95",
)
# A summary has these if the flight had a navigation and was long enough for it to settle.
_NAVIGATION_ERRORS = (
    "navigation_position_error_m_median",
    "navigation_position_error_m_p95",
    "navigation_velocity_error_m_s_median",
    "navigation_velocity_error_m_s_p95",
    "navigation_attitude_error_deg_median",
    "navigation_attitude_error_deg_p95",
)


def aggregate(rows: Sequence[Row], expert: Sequence[Row] | None = None) -> dict[str, typing.Any]:
    """Makes one controller's entry of `results.json` from the summaries of its flights.

    Terminal figures and clearances count all flights; delta-v and arrival time count those that
    succeeded. Errors of the policy's estimates and of the navigation are medians over flights of
    each flight's median and p95; `navigation_consistent` and `navigation_following` are means. A
    world that could not be flown is no flight: `unflyable` counts them,
    `unflyable_worlds` has their rows, and no other figure counts them. A figure of no flights is
    None.

    Args:
      rows: one for each flight.
      expert: the MPC's rows of the same transits in the same order. With them the entry compares
        delta-v on the transits in which both succeeded: it has the number of these transits, the
        median of the ratios, and the ratio of the sums.
    """
    flown = [row for row in rows if "unflyable" not in row]
    arrived = [row for row in flown if row["success"]]
    timed = [row for row in flown if row["control_ms_median"] is not None]
    estimated = [row for row in flown if "estimate_position_error_m_median" in row]
    return {
        **_successes(flown),
        "unflyable": len(rows) - len(flown),
        "collisions": sum(row["collided"] for row in flown),
        "keep_out_violations": sum(row["keep_out_violations"] for row in flown),
        **_clearances(flown),
        **_end_errors(flown),
        **_arrival_times(arrived),
        **_delta_v(arrived),
        **(_against_expert(rows, expert) if expert is not None else {}),
        "policy_share": _mean(flown, "policy_share"),
        "policy_share_to_arrival": _mean(flown, "policy_share_to_arrival"),
        "mpc_solves": sum(row["mpc_solves"] for row in flown),
        "control_ms_median": _median(timed, "control_ms_median"),
        "control_ms_mean": _mean(flown, "control_ms_mean"),
        "control_ms_p99": _percentile(timed, "control_ms_p99", 100),
        **{name: _median(estimated, name) for name in _ESTIMATE_ERRORS if estimated},
        **_navigation(flown),
        **_small_commands(flown),
        "flights": flown,
        "unflyable_worlds": [row for row in rows if "unflyable" in row],
    }


def without_flights(result: Mapping[str, typing.Any]) -> dict[str, typing.Any]:
    """A controller's figures without what has a part for each flight or quantity.

    These are the rows of its flights and of its unflyable worlds, and `sensitivity`.
    """
    return {name: value for name, value in result.items() if name not in _OF_THE_FLIGHTS}


def _navigation(flown: Sequence[Row]) -> dict[str, float | None]:
    """Gives the figures of the navigation; {} if no flight had one that settled."""
    settled = [row for row in flown if "navigation_consistent" in row]
    if not settled:
        return {}
    shares = ("navigation_consistent", "navigation_following")
    return {
        **{name: _median(settled, name) for name in _NAVIGATION_ERRORS},
        **{name: _mean(settled, name) for name in shares},
    }


def every_row(result: Mapping[str, typing.Any]) -> list[Row]:
    """Returns the rows that `aggregate` made an entry from: flights and unflyable worlds."""
    rows = [*result["flights"], *result["unflyable_worlds"]]
    return sorted(rows, key=lambda row: row["transit"])


def _successes(flown: Sequence[Row]) -> dict[str, typing.Any]:
    trials = len(flown)
    successes = sum(row["success"] for row in flown)
    wide = sum(row["success_2km"] for row in flown)
    return {
        "transits": trials,
        "successes": successes,
        "success_rate": successes / trials if trials else None,
        "success_rate_interval": success_interval(successes, trials),
        "success_rate_exact_interval": exact_interval(successes, trials),
        "success_shown_90": shown_success(successes, trials),
        "successes_2km": wide,
        "success_rate_2km": wide / trials if trials else None,
        "success_rate_2km_interval": success_interval(wide, trials),
    }


def _clearances(flown: Sequence[Row]) -> dict[str, float | None]:
    name = "min_clearance_m"
    return {
        name: _percentile(flown, name, 0),
        "min_clearance_m_p1": _percentile(flown, name, 1),
        "min_clearance_m_p10": _percentile(flown, name, 10),
        "min_clearance_m_median": _median(flown, name),
    }


def _end_errors(flown: Sequence[Row]) -> dict[str, float | None]:
    name = "terminal_position_error_m"
    return {
        "terminal_position_error_m_median": _median(flown, name),
        "terminal_position_error_m_p90": _percentile(flown, name, 90),
        "terminal_position_error_m_p95": _percentile(flown, name, 95),
        "terminal_position_error_m_p99": _percentile(flown, name, 99),
        "terminal_position_error_m_max": _percentile(flown, name, 100),
        "terminal_speed_m_s_max": _percentile(flown, "terminal_speed_m_s", 100),
    }


def _arrival_times(arrived: Sequence[Row]) -> dict[str, float | None]:
    return {
        "arrival_time_s_median": _median(arrived, "arrival_time_s"),
        "arrival_time_s_p90": _percentile(arrived, "arrival_time_s", 90),
        "arrival_time_s_p99": _percentile(arrived, "arrival_time_s", 99),
        "arrival_time_s_max": _percentile(arrived, "arrival_time_s", 100),
    }


def _delta_v(arrived: Sequence[Row]) -> dict[str, float | None]:
    return {
        "delta_v_m_s_median": _median(arrived, "delta_v_m_s"),
        "delta_v_m_s_mean": _mean(arrived, "delta_v_m_s"),
        "delta_v_m_s_p90": _percentile(arrived, "delta_v_m_s", 90),
        "delta_v_99_m_s": _percentile(arrived, "delta_v_m_s", 99),
        "delta_v_99_m_s_bound": percentile_bound([row["delta_v_m_s"] for row in arrived]),
        "delta_v_m_s_max": _percentile(arrived, "delta_v_m_s", 100),
    }


def aggregate_all(
    groups: Mapping[str, Sequence[Row]],
) -> dict[str, dict[str, typing.Any]]:
    """Aggregates each controller's rows; if the expert is there, compares all others with it.

    Where something was dispersed, an entry also has `sensitivity`; see `rank_drivers`.

    Args:
      groups: the rows of each controller in the order of the transits, by its name.
    """
    expert = groups.get(EXPERT)
    results = {
        name: aggregate(rows, None if name == EXPERT else expert) for name, rows in groups.items()
    }
    for result in results.values():
        if any(row.get("dispersed") for row in result["flights"]):
            result["sensitivity"] = rank_drivers(result["flights"])
    return results


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
    if not rows or not all("small_command_share" in row for row in rows):
        return {}
    shares, steps = ([row[name] for row in rows] for name in ("small_command_share", "steps"))
    return {"small_command_share": float(np.average(shares, weights=steps))}


def command_count(rows: Sequence[Row]) -> int:
    """How often a controller commanded: at each step, and once more at the end of each flight."""
    return sum(row["steps"] + 1 for row in rows)


def delta_v_pairs(rows: Sequence[Row], expert: Sequence[Row]) -> np.ndarray:
    """Returns the delta-v (N, 2) in m/s of a controller and of the MPC, where both succeeded.

    A flight that starts in the goal region needs no delta-v, and is left out. So is a world that
    one of them could not fly.

    Raises:
      ValueError: the rows are not of the same transits.
    """
    pairs = []
    for row, best in zip(rows, expert, strict=True):
        if any(row[name] != best[name] for name in ("seed", "transit")):
            raise ValueError("rows of a controller and of the MPC are of other transits")
        if "unflyable" in row or "unflyable" in best:
            continue
        if row["success"] and best["success"] and best["delta_v_m_s"] > 0.0:
            pairs.append((row["delta_v_m_s"], best["delta_v_m_s"]))
    return np.array(pairs).reshape(-1, 2)


def _percentile(rows: Sequence[Row], name: str, percent: float) -> float | None:
    return percentile([row[name] for row in rows], percent)


def _mean(rows: Sequence[Row], name: str) -> float | None:
    """The mean over the flights that have the figure."""
    values = [row[name] for row in rows if row[name] is not None]
    return float(np.mean(values)) if values else None


def _median(rows: Sequence[Row], name: str) -> float | None:
    return _percentile(rows, name, 50)
