"""The table of an evaluation's figures, and how a flight ended in words."""

from __future__ import annotations

import typing
from collections.abc import Callable, Mapping

from proxops.diagrams.flight import Row
from proxops.diagrams.logs import WIDE_ARRIVAL, length_text, three_digits
from proxops.diagrams.scenario import ArrivalConfig
from proxops.training.reports import DASH, interval_text, number_text

Result = Mapping[str, typing.Any]
Results = Mapping[str, Result]
"""The figures of each controller by its name, as in `results.json`."""


def figure_rows(results: Results, arrival: ArrivalConfig) -> list[tuple[str, list[str]]]:
    """Makes the table's lines: a label, and each controller's figure.

    Lines without a figure are left out. Worlds that could not be flown are counted apart and in no
    other figure. Delta-v and arrival count the flights that succeeded, and delta-v over the
    expert's the transits in which both succeeded. "At most" is a 90 % confidence bound. Position
    off and velocity off are errors of a policy's estimates: medians over flights of each flight's
    median and p95. Steps are timed where the MPC or a network computes; the greatest p99 is that of
    one flight.
    """
    near, wide = (arrival_text(arrival, scale) for scale in (1.0, WIDE_ARRIVAL))
    rows = [
        (label.format(near=near, wide=wide), [tell(result) for result in results.values()])
        for label, tell in _FIGURES
    ]
    return [(label, cells) for label, cells in rows if any(cell != DASH for cell in cells)]


def arrival_text(arrival: ArrivalConfig, multiple: float = 1.0) -> str:
    """The limits of arrival times a multiple, for instance "1 km, 1 m/s"."""
    radius = multiple * arrival.radius_m
    place = f"{radius:g} m" if radius < 1e3 else f"{radius / 1e3:g} km"
    return f"{place}, {multiple * arrival.speed_m_s:g} m/s"


def successes_text(result: Result, *, wide: bool = False) -> str:
    """How many flights of a controller succeeded, for instance "199 of 200".

    Args:
      result: its figures, as `aggregate_all` makes them.
      wide: counts arrivals within twice the limits, too.
    """
    return f"{result['successes_2km' if wide else 'successes']} of {result['transits']}"


def outcome(row: Row) -> str:
    """How a flight ended, in a few words."""
    if row["collided"]:
        return "collision"
    if row["keep_out_violations"]:
        return "inside the keep-out"
    if row["success"]:
        return "arrived"
    return "no arrival" if row["arrival_time_s"] is None else "arrived too late"


def _number(key: str, form: str, scale: float = 1.0) -> Callable[[Result], str]:
    return lambda result: number_text(result.get(key), form, scale)


def _interval(key: str) -> Callable[[Result], str]:
    return lambda result: interval_text(result[key])


def _unflyable(result: Result) -> str:
    return str(result["unflyable"]) if result["unflyable"] else DASH


def _digits(key: str, tell: Callable[[float], str] = three_digits) -> Callable[[Result], str]:
    return lambda result: DASH if result.get(key) is None else tell(result[key])


_FIGURES: tuple[tuple[str, Callable[[Result], str]], ...] = (
    ("worlds that can't be flown", _unflyable),
    ("success ({near})", successes_text),
    ("95 % interval", _interval("success_rate_interval")),
    ("exact 95 % interval", _interval("success_rate_exact_interval")),
    ("shown with 90 % confidence (%)", _number("success_shown_90", ".2f", 100.0)),
    ("success ({wide})", lambda result: successes_text(result, wide=True)),
    ("95 % interval", _interval("success_rate_2km_interval")),
    ("collisions", _number("collisions", "d", 1)),
    ("keep-out violations", _number("keep_out_violations", "d", 1)),
    ("least clearance", _digits("min_clearance_m", length_text)),
    ("least clearance, p1", _digits("min_clearance_m_p1", length_text)),
    ("least clearance, p10", _digits("min_clearance_m_p10", length_text)),
    ("least clearance, median", _digits("min_clearance_m_median", length_text)),
    ("end error, median (m)", _digits("terminal_position_error_m_median")),
    ("end error, p90 (m)", _digits("terminal_position_error_m_p90")),
    ("end error, p95 (m)", _digits("terminal_position_error_m_p95")),
    ("end error, p99 (m)", _digits("terminal_position_error_m_p99")),
    ("end error, greatest (m)", _digits("terminal_position_error_m_max")),
    ("end speed, greatest (m/s)", _digits("terminal_speed_m_s_max")),
    ("delta-v, median (m/s)", _digits("delta_v_m_s_median")),
    ("delta-v, p90 (m/s)", _digits("delta_v_m_s_p90")),
    ("delta-v, p99 (m/s)", _digits("delta_v_99_m_s")),
    ("delta-v, p99, at most (m/s)", _digits("delta_v_99_m_s_bound")),
    ("delta-v, greatest (m/s)", _digits("delta_v_m_s_max")),
    ("over the expert's, median", _number("expert_delta_v_ratio_median", ".3f")),
    ("over the expert's, of sums", _number("expert_delta_v_ratio", ".3f")),
    ("transits compared", _number("expert_pairs", "d", 1)),
    ("arrival, median (s)", _number("arrival_time_s_median", ".0f")),
    ("arrival, p90 (s)", _number("arrival_time_s_p90", ".0f")),
    ("arrival, p99 (s)", _number("arrival_time_s_p99", ".0f")),
    ("arrival, greatest (s)", _number("arrival_time_s_max", ".0f")),
    ("position off, median (m)", _digits("estimate_position_error_m_median")),
    ("position off, p95 (m)", _digits("estimate_position_error_m_p95")),
    ("velocity off, median (m/s)", _digits("estimate_velocity_error_m_s_median")),
    ("velocity off, p95 (m/s)", _digits("estimate_velocity_error_m_s_p95")),
    ("navigation off, median (m)", _digits("navigation_position_error_m_median")),
    ("navigation off, p95 (m)", _digits("navigation_position_error_m_p95")),
    ("its velocity off, median (m/s)", _digits("navigation_velocity_error_m_s_median")),
    ("its attitude off, median (deg)", _number("navigation_attitude_error_deg_median", ".4f")),
    ("steps within its 3 sigma (%)", _number("navigation_consistent", ".1f", 100.0)),
    ("policy's share (%)", _number("policy_share", ".1f", 100.0)),
    ("steps below 3 % of the thrust limit (%)", _number("small_command_share", ".1f", 100.0)),
    ("MPC solves", _number("mpc_solves", "d", 1)),
    ("step, median (ms)", _number("control_ms_median", ".2f")),
    ("step, greatest p99 (ms)", _number("control_ms_p99", ".2f")),
)
