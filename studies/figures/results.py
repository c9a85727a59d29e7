"""`Result`: what the flights of one controller show, a field for each figure."""

from __future__ import annotations

import dataclasses as dc
import typing
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from proxops.diagrams.flight import Row
from proxops.diagrams.logs import WIDE_ARRIVAL, length_text, three_digits
from proxops.diagrams.scenario import ArrivalConfig
from proxops.studies.figures.intervals import (
    exact_interval,
    percentile,
    percentile_bound,
    shown_success,
    success_interval,
)
from proxops.studies.figures.sensitivity import Ranked, Ranking, rank_drivers, told_from_chance
from proxops.training.reports import DASH, interval_text

EXPERT = "mpc"
"""The controller that the others are measured against."""

Interval = Sequence[float]
Number = float | None


class _Flights(typing.NamedTuple):
    """What the figures are made from."""

    flown: Sequence[Row]
    arrived: Sequence[Row]
    """Those that succeeded."""
    settled: Sequence[Row]
    """Those with a navigation that had time to settle."""
    unflyable: int
    pairs: np.ndarray | None
    """See `delta_v_pairs`; None without an expert."""

    def values(self, name: str, group: str = "flown") -> list[float]:
        """One figure of the flights of a group that have it."""
        return [row[name] for row in getattr(self, group) if row.get(name) is not None]

    def count(self, name: str) -> int:
        """The sum of a figure of all flights that is a number of something, or true or false."""
        return int(sum(self.values(name)))

    def ratio(self, of: Callable[[np.ndarray], typing.Any]) -> Number:
        """A ratio of delta-v to the expert's; None where nothing is compared."""
        return None if self.pairs is None or not len(self.pairs) else float(of(self.pairs))


Text = Callable[[typing.Any, "Result"], str]
"""Shows a figure of a result."""


# --- how figures are shown ------------------------------------------------------------------------


def _fixed(form: str, scale: float = 1.0) -> Text:
    return lambda value, _: format(scale * value, form)


def _digits(value: float, _: Result) -> str:
    return three_digits(value)


def _length(value: float, _: Result) -> str:
    return length_text(value)


def _interval(value: Interval, _: Result) -> str:
    return interval_text(value)


def _of_all(value: int, result: Result) -> str:
    return f"{value} of {result.transits}"


def _if_any(value: int, _: Result) -> str:
    return str(value) if value else DASH


def _all_or_none(value: int, result: Result) -> bool | None:
    return True if value == result.transits else None if value else False


def _none(value: int, _: Result) -> bool:
    return value == 0


_WHOLE, _SECONDS, _RATIO = _fixed("d", 1), _fixed(".0f"), _fixed(".3f")
_PERCENT, _MILLISECONDS = _fixed(".1f", 100.0), _fixed(".2f")
_SHARE = _fixed(".3g", 100.0)


class _Shown(typing.NamedTuple):
    """How a field of `Result` is made, and its line in the table; with no label there is none."""

    make: Callable[[_Flights], typing.Any]
    label: str = ""
    text: Text = _WHOLE
    first: str = ""
    """What the figure is about, if it is one of the first ten."""
    good: Callable[[typing.Any, Result], bool | None] | None = None


# --- how figures are made -------------------------------------------------------------------------


def _figure(
    make: Callable[[_Flights], typing.Any], *shown: typing.Any, **more: typing.Any
) -> typing.Any:
    """A figure; after what makes it, the fields of `_Shown`."""
    return dc.field(default=None, metadata={"shown": _Shown(make, *shown, **more)})


def _percentile(
    name: str, percent: float, label: str = "", text=_digits, group="flown", **more
) -> typing.Any:
    return _figure(lambda each: percentile(each.values(name, group), percent), label, text, **more)


def _mean(name: str, label: str = "", group: str = "flown") -> typing.Any:
    def make(flights: _Flights) -> Number:
        values = flights.values(name, group)
        return float(np.mean(values)) if values else None

    return _figure(make, label, _PERCENT)


def _sum(name: str, label: str, text: Text = _WHOLE, **more) -> typing.Any:
    """None if there are flights and none has it."""

    def make(flights: _Flights) -> int | None:
        return flights.count(name) if flights.values(name) or not flights.flown else None

    return _figure(make, label, text, **more)


def _of_trials(
    name: str, make: Callable[[int, int], typing.Any], label="", text=_interval, **more
) -> typing.Any:
    def made(flights: _Flights) -> typing.Any:
        known = flights.values(name) or not flights.flown
        return make(flights.count(name), len(flights.flown)) if known else None

    return _figure(made, label, text, **more)


def _clearance(percent: float, label: str) -> typing.Any:
    return _percentile("min_clearance_m", percent, label, _length)


def _end(percent: float, label: str, **more) -> typing.Any:
    return _percentile("terminal_position_error_m", percent, label, **more)


def _delta_v(percent: float, label: str, **more) -> typing.Any:
    return _percentile("delta_v_m_s", percent, label, group="arrived", **more)


def _arrival(percent: float, label: str, **more) -> typing.Any:
    return _percentile("arrival_time_s", percent, label, _SECONDS, "arrived", **more)


def _navigation(name: str, label: str = "", text: Text = _digits, **more) -> typing.Any:
    return _percentile(f"navigation_{name}", 50, label, text, "settled", **more)


def _survey(name: str, percent: float, label: str, text: Text = _SHARE, **more) -> typing.Any:
    return _percentile(f"survey_{name}", percent, label, text, **more)


def _rate(successes: int, trials: int) -> Number:
    return successes / trials if trials else None


def _share_of_small(flights: _Flights) -> Number:
    """Of all steps."""
    shares = flights.values("small_command_share")
    if not shares or len(shares) < len(flights.flown):
        return None
    return float(np.average(shares, weights=[row["steps"] for row in flights.flown]))


# --- the figures ----------------------------------------------------------------------------------


@dc.dataclass(frozen=True)
class Result:
    """What the flights of one controller show; an entry of `results.json`.

    Each field says how it is made from the rows of flights, and its line in the table. Terminal
    figures and clearances count all flights; delta-v and arrival time those that succeeded. Errors
    of a policy's estimates and of the navigation are medians over flights of each flight's median
    and p95; the shares of the navigation are means over the flights in which it settled. A world
    that could not be flown is no flight: `unflyable` counts them, and no other figure does. Figures
    over the expert's are of the transits in which both succeeded. A figure of no flights is None.
    """

    # fmt: off
    transits: int = _figure(lambda each: len(each.flown))
    unflyable: int = _figure(lambda each: each.unflyable, "worlds that can't be flown", _if_any)
    successes: int = _sum("success", "success (within {near})", _of_all,
                          first="success", good=_all_or_none)
    success_rate: Number = _of_trials("success", _rate)
    success_rate_interval: Interval = _of_trials("success", success_interval,
                                                 "95 % interval of success", first="success")
    success_rate_exact_interval: Interval = _of_trials("success", exact_interval,
                                                       "exact 95 % interval of success")
    success_shown_90: float = _of_trials("success", shown_success,
                                         "success, with 90 % confidence (%)",
                                         _fixed(".2f", 100.0))
    successes_2km: int = _sum("success_2km", "success (within {wide})", _of_all,
                              good=_all_or_none)
    success_rate_2km: Number = _of_trials("success_2km", _rate)
    success_rate_2km_interval: Interval = _of_trials("success_2km", success_interval,
                                                     "95 % interval of that")
    collisions: int = _sum("collided", "collisions", first="safety", good=_none)
    keep_out_violations: int | None = _sum("keep_out_violations", "keep-out violations",
                                           first="safety", good=_none)
    ended_early: int = _figure(lambda each: sum("ended_early" in row for row in each.flown),
                               "ended early", _if_any, good=_none)
    touches: int | None = _sum("touched", "touched", _of_all, first="success", good=_all_or_none)
    touches_safe: int | None = _sum("safe", "home again, and only the head touched", _of_all,
                                    first="safety", good=_all_or_none)
    touch_miss_m_median: Number = _percentile("touch_miss_m", 50, "miss of the site (m)",
                                              first="accuracy")
    touch_miss_m_p99: Number = _percentile("touch_miss_m", 99, "miss, 99th percentile (m)")
    touch_miss_m_max: Number = _percentile("touch_miss_m", 100, "miss, greatest (m)")
    touch_down_m_s_median: Number = _percentile("touch_down_m_s", 50, "speed down (m/s)")
    touch_across_m_s_max: Number = _percentile("touch_across_m_s", 100,
                                               "speed across, greatest (m/s)")
    touch_tilt_deg_max: Number = _percentile("touch_tilt_deg", 100,
                                             "arm off the normal, greatest (deg)")
    touch_later_rate_deg_s_max: Number = _percentile(
        "touch_later_rate_deg_s", 100, "rate 10 s after the touch, greatest (deg/s)")
    touch_policy_share: Number = _mean("touch_policy_share", "descent flown by the policy (%)")
    survey_map_rms_of_size_median: Number = _survey("map_rms_of_size", 50,
                                                    "map, rms over the size (%)", first="map")
    survey_map_rms_of_size_max: Number = _survey("map_rms_of_size", 100, "map, greatest (%)",
                                                 first="map")
    survey_within_3_sigma_min: Number = _survey("within_3_sigma", 0,
                                                "surface within 3 sigma, least (%)", first="map")
    survey_gravity_error_median: Number = _survey("gravity_error", 50, "GM off (%)", first="map")
    survey_gravity_error_max: Number = _survey("gravity_error", 100, "GM off, greatest (%)")
    survey_pole_error_deg_max: Number = _survey("pole_error_deg", 100,
                                                "pole off, greatest (deg)", _digits)
    survey_rate_error_max: Number = _survey("rate_error", 100, "spin rate off, greatest (%)")
    survey_hours_median: Number = _survey("hours", 50, "survey in orbit (h)", _digits)
    survey_delta_v_m_s_median: Number = _survey("delta_v_m_s", 50, "survey, Δv (m/s)", _digits,
                                                first="map")
    survey_delta_v_m_s_max: Number = _survey("delta_v_m_s", 100, "survey, Δv, greatest (m/s)",
                                             _digits)
    survey_wall_s_median: Number = _survey("wall_s", 50, "survey, computed in (s)", _SECONDS)
    min_clearance_m: Number = _clearance(0, "least clearance of the keep-out ellipsoid")
    min_clearance_m_p1: Number = _clearance(1, "least clearance, 1st percentile")
    min_clearance_m_p10: Number = _clearance(10, "least clearance, 10th percentile")
    min_clearance_m_median: Number = _clearance(50, "least clearance, median")
    terminal_position_error_m_median: Number = _end(50, "distance to the goal at the end (m)",
                                                    first="accuracy")
    terminal_position_error_m_p90: Number = _end(90, "end error, 90th percentile (m)")
    terminal_position_error_m_p95: Number = _end(95, "end error, 95th percentile (m)")
    terminal_position_error_m_p99: Number = _end(99, "end error, 99th percentile (m)")
    terminal_position_error_m_max: Number = _end(100, "end error, greatest (m)")
    terminal_speed_m_s_max: Number = _percentile("terminal_speed_m_s", 100,
                                                 "end speed, greatest (m/s)")
    delta_v_m_s_mean: Number = _mean("delta_v_m_s", group="arrived")
    delta_v_m_s_median: Number = _delta_v(50, "Δv (m/s)", first="propellant")
    delta_v_m_s_p90: Number = _delta_v(90, "Δv, 90th percentile (m/s)")
    delta_v_99_m_s: Number = _delta_v(99, "Δv, 99th percentile (m/s)")
    delta_v_99_m_s_bound: Number = _figure(
        lambda each: percentile_bound(each.values("delta_v_m_s", "arrived")),
        "Δv, 99th percentile, at most (m/s)", _digits)
    delta_v_m_s_max: Number = _delta_v(100, "Δv, greatest (m/s)")
    expert_delta_v_ratio_median: Number = _figure(
        lambda each: each.ratio(lambda pairs: np.median(pairs[:, 0] / pairs[:, 1])),
        "Δv over the MPC's", _RATIO, first="propellant")
    expert_delta_v_ratio: Number = _figure(
        lambda each: each.ratio(lambda pairs: np.divide(*pairs.sum(axis=0))),
        "Δv over the MPC's, of sums", _RATIO)
    expert_pairs: int | None = _figure(
        lambda each: None if each.pairs is None else len(each.pairs), "transits compared")
    arrival_time_s_median: Number = _arrival(50, "time until arrival (s)", first="time")
    arrival_time_s_p90: Number = _arrival(90, "time until arrival, 90th percentile (s)")
    arrival_time_s_p99: Number = _arrival(99, "time until arrival, 99th percentile (s)")
    arrival_time_s_max: Number = _arrival(100, "time until arrival, greatest (s)")
    estimate_position_error_m_median: Number = _percentile(
        "estimate_position_error_m_median", 50, "policy's position error, median (m)")
    estimate_position_error_m_p95: Number = _percentile(
        "estimate_position_error_m_p95", 50, "policy's position error, 95th percentile (m)")
    estimate_velocity_error_m_s_median: Number = _percentile(
        "estimate_velocity_error_m_s_median", 50, "policy's velocity error, median (m/s)")
    estimate_velocity_error_m_s_p95: Number = _percentile(
        "estimate_velocity_error_m_s_p95", 50, "policy's velocity error, 95th percentile (m/s)")
    navigation_position_error_m_median: Number = _navigation(
        "position_error_m_median", "navigation, position error (m)", first="navigation")
    navigation_position_error_m_p95: Number = _navigation(
        "position_error_m_p95", "navigation, its 95th percentile (m)")
    navigation_velocity_error_m_s_median: Number = _navigation(
        "velocity_error_m_s_median", "navigation, velocity error (m/s)")
    navigation_velocity_error_m_s_p95: Number = _navigation("velocity_error_m_s_p95")
    navigation_attitude_error_deg_median: Number = _navigation(
        "attitude_error_deg_median", "navigation, attitude error (deg)", _fixed(".4f"))
    navigation_attitude_error_deg_p95: Number = _navigation("attitude_error_deg_p95")
    navigation_consistent: Number = _mean("navigation_consistent", "navigation, within 3 sigma (%)",
                                          "settled")
    navigation_following: Number = _mean("navigation_following", group="settled")
    assured_share: Number = _mean("assured_share", "steps judged by runtime assurance (%)")
    policy_share: Number = _mean("policy_share", "steps flown by the policy (%)")
    policy_share_to_arrival: Number = _mean("policy_share_to_arrival")
    small_command_share: Number = _figure(
        _share_of_small, "steps below 3 % of the thrust limit (%)", _PERCENT)
    mpc_solves: int = _sum("mpc_solves", "times that the MPC was solved")
    control_ms_mean: Number = _mean("control_ms_mean")
    control_ms_median: Number = _percentile(
        "control_ms_median", 50, "computing a control step (ms)", _MILLISECONDS, first="time")
    control_ms_p99: Number = _percentile(
        "control_ms_p99", 100, "control step, greatest p99 (ms)", _MILLISECONDS)
    # fmt: on
    drivers: Mapping[str, Sequence[str]] | None = None
    """By output what drives it by more than chance, strongest first; None: nothing was dispersed.
    """
    sensitivity: Mapping[str, Ranking] | None = None
    """See `rank_drivers`."""
    flights: Sequence[Row] = ()
    unflyable_worlds: Sequence[Row] = ()
    """Rows of worlds that could not be flown."""

    @property
    def rows(self) -> list[Row]:
        """Rows of flights and of unflyable worlds in the order of the transits."""
        return sorted([*self.flights, *self.unflyable_worlds], key=lambda row: row["transit"])

    @property
    def figures(self) -> dict[str, typing.Any]:
        """The result as JSON holds it, without what has a part for each flight or quantity."""
        left = ("sensitivity", "flights", "unflyable_worlds")
        return {name: value for name, value in vars(self).items() if name not in left}

    def succeeded(self, *, wide: bool = False) -> str:
        """How many flights succeeded, such as "199 of 200"; `wide`: within twice the limits."""
        return _of_all(self.successes_2km if wide else self.successes, self)


Results = Mapping[str, Result]
"""The result of each controller, by its name."""


def aggregate(rows: Sequence[Row], expert: Sequence[Row] | None = None) -> Result:
    """Makes one controller's result from the rows of its flights.

    Args:
      rows: one for each flight or unflyable world.
      expert: the MPC's rows of the same transits in the same order.
    """
    flown = [row for row in rows if "unflyable" not in row]
    flights = _Flights(
        flown,
        [row for row in flown if row["success"]],
        [row for row in flown if "navigation_consistent" in row],
        len(rows) - len(flown),
        None if expert is None else delta_v_pairs(rows, expert),
    )
    made = {each.name: each.metadata["shown"].make(flights) for each in _SHOWN_FIELDS}
    unflyable = [row for row in rows if "unflyable" in row]
    return Result(**made, flights=flown, unflyable_worlds=unflyable)


_SHOWN_FIELDS = [field for field in dc.fields(Result) if field.metadata]
# What a stranger asks first, and all else.
_GROUPS = ("success", "safety", "map", "propellant", "accuracy", "navigation", "time", "")
# By the start of a field's name.
_NOTES = {
    "success_rate_interval": "Where no other is named, a figure is the median over flights. The "
    "95 % interval is Wilson's: with more flights it is narrower.",
    "success_rate_exact_interval": "The exact interval is Clopper and Pearson's.",
    "success_shown_90": "If the true probability of success were lower than what is shown with "
    "90 % confidence, a result this good would have a chance below 10 %.",
    "delta_v": "Δv and the time until arrival count the flights that succeeded.",
    "delta_v_99_m_s_bound": "“At most” is an upper bound with 90 % confidence; it needs 230 "
    "flights that succeeded.",
    "expert": "Δv over the MPC's counts the transits in which both succeeded.",
    "estimate": "The policy's errors are those of the state that it estimates from the lidar.",
    "navigation": "The navigation estimates the state from the lidar; its errors count the flights "
    "in which it found its place.",
    "control_ms": "Computing a control step counts the controller, without the first step of a "
    "flight, which loads or compiles.",
}


def aggregate_all(groups: Mapping[str, Sequence[Row]]) -> dict[str, Result]:
    """Aggregates each controller's rows; if the expert is there, compares all others with it.

    Where something was dispersed, a result also has `sensitivity` and `drivers`.

    Args:
      groups: the rows of each controller in the order of the transits, by its name.
    """
    expert = groups.get(EXPERT)
    results = {
        name: aggregate(rows, None if name == EXPERT else expert) for name, rows in groups.items()
    }
    for name, result in results.items():
        # A survey has no end, and a mission that ended early none either.
        ended = [row for row in result.flights if "terminal_position_error_m" in row]
        if any(row.get("dispersed") for row in ended):
            ranked = rank_drivers(ended)
            drivers = {output: told_from_chance(each) for output, each in ranked.items() if each}
            results[name] = dc.replace(result, sensitivity=ranked, drivers=drivers)
    return results


def results_from_json(content: Mapping[str, Mapping[str, typing.Any]]) -> dict[str, Result]:
    """Reads results, with or without their flights; leaves out what is no field of `Result`."""
    known = {field.name for field in dc.fields(Result)}
    results = {}
    for name, entry in content.items():
        fields = {key: value for key, value in entry.items() if key in known}
        if fields.get("sensitivity") is not None:
            fields["sensitivity"] = {
                output: [Ranked(**each) for each in ranking]
                for output, ranking in fields["sensitivity"].items()
            }
        results[name] = Result(**fields)
    return results


class FigureRow(typing.NamedTuple):
    """A line of the table of figures."""

    group: str
    """What the figure is about, if it is one of the first ten; else ""."""
    label: str
    cells: Sequence[str]
    """The figure of each controller."""
    good: Sequence[bool | None]
    """Whether each is good; None: neither good nor bad."""
    notes: Sequence[str]
    """Sentences that explain the figure."""


def figure_rows(results: Results, arrival: ArrivalConfig | None) -> list[FigureRow]:
    """Makes the table's lines: the first ten figures in their groups, then all others.

    Lines without a figure are left out. `arrival` is None where nothing is to arrive.
    """
    limits = {}
    if arrival is not None:
        limits = {"near": arrival_text(arrival), "wide": arrival_text(arrival, WIDE_ARRIVAL)}
    figures = [(field.name, field.metadata["shown"]) for field in _SHOWN_FIELDS]
    lines = []
    for name, figure in sorted(figures, key=lambda each: _GROUPS.index(each[1].first)):
        if figure.label:
            values = [(getattr(result, name), result) for result in results.values()]
            cells = [DASH if each[0] is None else figure.text(*each) for each in values]
            good = [
                figure.good(*each) if figure.good and each[1].transits else None for each in values
            ]
            notes = [note for start, note in _NOTES.items() if name.startswith(start)]
            label = (
                figure.label.format(**limits) if limits else figure.label.partition(" (within")[0]
            )
            lines.append(FigureRow(figure.first, label, cells, good, notes))
    return [line for line in lines if any(cell != DASH for cell in line.cells)]


def arrival_text(arrival: ArrivalConfig, multiple: float = 1.0) -> str:
    """The limits of arrival times a multiple, for instance "1 km, 1 m/s"."""
    radius = multiple * arrival.radius_m
    place = f"{radius:g} m" if radius < 1e3 else f"{radius / 1e3:g} km"
    return f"{place}, {multiple * arrival.speed_m_s:g} m/s"


def command_count(rows: Sequence[Row]) -> int:
    """How often a controller commanded: at each step, and once more at the end of each flight."""
    return sum(row["steps"] + 1 for row in rows)


def delta_v_pairs(rows: Sequence[Row], expert: Sequence[Row]) -> np.ndarray:
    """Returns the delta-v (N, 2) in m/s of a controller and of the MPC, where both succeeded.

    A flight that starts in the goal region needs no delta-v, and is left out. So is a world that
    one of them could not fly.
    """
    pairs = []
    for row, best in zip(rows, expert, strict=True):
        assert all(row[name] == best[name] for name in ("seed", "transit")), "other transits"
        if "unflyable" in row or "unflyable" in best:
            continue
        if row["success"] and best["success"] and best["delta_v_m_s"] > 0.0:
            pairs.append((row["delta_v_m_s"], best["delta_v_m_s"]))
    return np.array(pairs).reshape(-1, 2)
