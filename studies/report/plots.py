"""Figures of evaluations: end errors, Δv, paths, single flights, and what drives failure."""

from __future__ import annotations

import typing
from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from proxops.diagrams.flight import Row
from proxops.diagrams.logs import WIDE_ARRIVAL, FlightLog
from proxops.diagrams.plots import (
    draw_body,
    frame_plane,
    length_unit,
    plot_clearance,
    plot_distance,
)
from proxops.studies.figures import DUMMY, EXPERT, Ranking, drawn_columns, told_from_chance

# Okabe and Ito's colours, which the colour-blind tell apart; the expert is black.
_COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#8a7a00")
BLUE, ORANGE, BLACK, GREY = _COLOURS[0], _COLOURS[1], "#1d2430", "#b8bec9"
GOAL = "#128a3a"
_STYLES = ("--", "-.", "-")
# The drawing ends at this multiple of starts, goals and keep-out; paths beyond it are cut off.
_ROOM = 1.25
# On a logarithmic scale, smaller end errors (m) are drawn here.
_LEAST_ERROR = 0.1
OUTPUT_NAMES = {
    "failure": "failure",
    "terminal_position_error_m": "end error",
    "touch_miss_m": "miss of the place",
    "delta_v_m_s": "Δv",
}
"""What the outputs of a ranking are called."""
_BARS, _SCATTERED = 12, 4


class Look(typing.NamedTuple):
    """How a controller is drawn in all figures of a report."""

    colour: str
    style: str
    """Style of lines; styles differ, so that both of two curves on the same place can be seen."""


Looks = Mapping[str, Look]
"""The look of each controller, by its name."""


def controller_looks(names: Sequence[str]) -> Looks:
    """Chooses a look for each controller; the expert's line is black and solid."""
    others = [name for name in names if name != EXPERT]
    looks = {
        name: Look(_COLOURS[k % len(_COLOURS)], _STYLES[k % len(_STYLES)])
        for k, name in enumerate(others)
    }
    return {name: looks.get(name, Look(BLACK, "-")) for name in names}


def new_figure(width: float, height: float) -> Figure:
    """An empty figure of a size in inches."""
    return Figure(figsize=(width, height), layout="constrained")


def label_axis(axis: Axes, across: str, up: str) -> None:
    """Names the axes of a plot, and draws a grid."""
    axis.set_xlabel(across)
    axis.set_ylabel(up)
    axis.grid(alpha=0.25)


def add_legend(figure: Figure, columns: int = 2, **options: typing.Any) -> None:
    """Puts a legend below all plots of a figure."""
    figure.legend(loc="outside lower center", ncols=columns, frameon=False, **options)


# --- flights of many controllers ------------------------------------------------------------------


def plot_end_errors(errors: Mapping[str, np.ndarray], radius: float, looks: Looks) -> Figure:
    """Draws the share of flights that end within a distance of the goal, on a logarithmic scale.

    Args:
      errors: distances (N,) in m from the goal at the end, by controller.
      radius: of the goal region, in m; it is marked, and twice the radius too.
    """
    figure = new_figure(8.5, 4.4)
    axis = figure.subplots()
    length, unit = length_unit(100.0 * radius)
    least = 1e-3 * radius  # A logarithmic scale has no zero, and smaller errors do not matter.
    greatest = max(max(values.max() for values in errors.values()) * 2.0, 4.0 * radius)
    for name, values in errors.items():
        found = np.sort(np.maximum(values, least)) / length
        share = np.arange(1, len(found) + 1) / len(found)
        across = np.concatenate([[0.5 * least / length], found, [greatest / length]])
        up = np.concatenate([[0.0], share, share[-1:]])
        colour, style = looks[name]
        axis.step(across, up, where="post", color=colour, linestyle=style, label=name)
    for multiple, style in ((1.0, "--"), (WIDE_ARRIVAL, ":")):
        axis.axvline(multiple * radius / length, color=GOAL, linestyle=style, linewidth=1.0)
    axis.set_xscale("log")
    axis.set_xlim(0.5 * least / length, greatest / length)
    axis.set_ylim(0.0, 1.02)
    label_axis(axis, f"distance to the goal at the end ({unit})", "share of flights")
    add_legend(figure, fontsize="small")
    return figure


def plot_delta_v(pairs: Mapping[str, np.ndarray], looks: Looks) -> Figure:
    """Draws each flight's Δv against the expert's on the same transit.

    Args:
      pairs: (N, 2) in m/s by controller: its own Δv and the expert's.
    """
    figure = new_figure(6.2, 5.8)
    axis = figure.subplots()
    limit = 1.06 * max(float(found.max()) for found in pairs.values())
    low = 0.9 * min(float(found.min()) for found in pairs.values())
    line = np.array([low, limit])
    axis.plot(line, line, color=BLACK, linewidth=1.0, label="as the expert")
    axis.plot(line, 1.1 * line, color=BLACK, linewidth=1.0, linestyle=":", label="10 % more")
    for name, found in pairs.items():
        label = f"{name} ({len(found)})"
        colour = looks[name].colour
        axis.plot(*found.T[::-1], "o", color=colour, alpha=0.6, markersize=4, label=label)
    axis.set_xlim(low, limit)
    axis.set_ylim(low, limit)
    axis.set_aspect("equal")
    label_axis(axis, "Δv of the expert (m/s)", "Δv (m/s)")
    add_legend(figure, fontsize="small")
    return figure


def plot_paths(logs: Mapping[str, Sequence[FlightLog]], looks: Looks) -> Figure:
    """Draws the paths of the same transits by each controller, seen along z and along y.

    Args:
      logs: by controller; all controllers have the same transits.
    """
    count = len(next(iter(logs.values())))
    figure = new_figure(3.4 * count + 0.4, 7.4)
    grid = figure.subplots(2, count, squeeze=False)
    for column in range(count):
        flights = {name: group[column] for name, group in logs.items()}
        for axis, plane in zip(grid[:, column], ("xy", "xz"), strict=True):
            draw_paths(axis, flights, plane, looks)
        transit = next(iter(flights.values())).scenario.transit.index
        grid[0, column].set_title(f"transit {transit}", fontsize="medium")
    ends = (
        Line2D([], [], color="black", marker="o", linestyle="", label="start"),
        Line2D([], [], color=GOAL, marker="*", markersize=11, linestyle="", label="goal"),
    )
    add_legend(figure, 4, handles=[*path_handles(logs, looks), *ends])
    return figure


def path_handles(names: typing.Iterable[str], looks: Looks) -> list[Line2D]:
    """The entries of a legend for the paths of controllers."""
    return [
        Line2D([], [], color=looks[name].colour, linestyle=looks[name].style, label=name)
        for name in names
    ]


def draw_paths(axis: Axes, flights: Mapping[str, FlightLog], plane: str, looks: Looks) -> None:
    """Draws flights of one transit on a plane ("xy", "xz", "yz") with body, keep-out and goal."""
    across, up = ("xyz".index(letter) for letter in plane)
    first = next(iter(flights.values()))
    length, unit = length_unit(float(first.body.shape.extents.max()))
    draw_body(axis, first.body, plane)
    for name, log in flights.items():
        path, (colour, style) = log.dataset["state"].values / length, looks[name]
        axis.plot(path[:, across], path[:, up], color=colour, linestyle=style, linewidth=1.4)
        if log.dataset.attrs["collided"]:
            axis.plot(path[-1, across], path[-1, up], "x", color=colour, markersize=9)
    start, goal = (first.dataset[name].values[0, :3] / length for name in ("state", "target"))
    axis.plot(start[across], start[up], "o", color="black", markersize=5)
    axis.plot(goal[across], goal[up], "*", color=GOAL, markersize=13)
    keep_out = first.body.keep_out_semi_axes.max() / length
    reach = _ROOM * max(np.abs(start).max(), np.abs(goal).max(), keep_out)
    frame_plane(axis, plane, unit, reach)


# --- single flights -------------------------------------------------------------------------------


def plot_flights(logs: Sequence[FlightLog], titles: Sequence[str]) -> Figure:
    """Draws each flight in a row of plots, which tell errors of navigation from those of guidance.

    The plots are: distance to the goal, true and (dashed) estimated; errors of the estimates of
    position and of velocity; clearance of the keep-out. Without estimates there are only the first
    and the last.
    """
    estimated = all("estimate" in log.dataset for log in logs)
    columns = 4 if estimated else 2
    figure = new_figure(3.9 * columns, 2.9 * len(logs))
    rows = np.atleast_1d(figure.subfigures(len(logs), 1))
    for row, log, title in zip(rows, logs, titles, strict=True):
        row.suptitle(title, fontsize="medium")
        axes = row.subplots(1, columns)
        plot_distance(axes[0], log)
        plot_clearance(axes[-1], log)
        if estimated:
            _plot_estimate(axes[0], axes[1], axes[2], log)
    return figure


def _plot_estimate(distance: Axes, position: Axes, velocity: Axes, log: FlightLog) -> None:
    data, arrival = log.dataset, log.scenario.arrival
    length, unit = length_unit(float(log.body.shape.extents.max()))
    minutes = data["time"].values / 60.0
    estimate = data["estimate"].values
    believed = np.linalg.norm((estimate - data["target"].values)[:, :3], axis=1)
    shown = np.maximum(believed, 1e-3 * arrival.radius_m) / length
    distance.plot(minutes, shown, color=ORANGE, linestyle="--", linewidth=1.0)
    error = estimate - data["state"].values
    for axis, part, limit, scale, label in (
        (position, error[:, :3], arrival.radius_m, length, f"error of position ({unit})"),
        (velocity, error[:, 3:], arrival.speed_m_s, 1.0, "error of velocity (m/s)"),
    ):
        sizes = np.maximum(np.linalg.norm(part, axis=1), 1e-3 * limit) / scale
        axis.semilogy(minutes, sizes, color=ORANGE, linewidth=1.0)
        axis.axhline(limit / scale, color=GOAL, linestyle="--", linewidth=1.0)
        axis.margins(x=0.01)
        label_axis(axis, "time (min)", label)


# --- what drives failure --------------------------------------------------------------------------


def strongest(rankings: Mapping[str, Ranking]) -> list[str]:
    """Returns at most four quantities above chance, taken from the outputs' rankings in turns."""
    told = [told_from_chance(ranking) for ranking in rankings.values()]
    turns = range(max(map(len, told), default=0))
    names = [ranked[place] for place in turns for ranked in told if place < len(ranked)]
    return list(dict.fromkeys(names))[:_SCATTERED]


def plot_drivers(rankings: Mapping[str, Ranking]) -> Figure:
    """Draws the twelve strongest quantities of each output as bars, with their 90 % intervals.

    Bars of quantities that stand above chance are blue, the others grey. The hatched bar is the
    median of what chance gives, and the dashed line the greatest of it: see `rank_drivers`.

    Args:
      rankings: of `rank_drivers`, those that are not empty; at least one.
    """
    figure = new_figure(5.6 * len(rankings), 4.6)
    axes = figure.subplots(1, len(rankings), squeeze=False)[0]
    for axis, (output, ranking) in zip(axes, rankings.items(), strict=True):
        [dummy] = [entry for entry in ranking if entry.quantity == DUMMY]
        bars = [entry for entry in ranking if entry is not dummy][: _BARS - 1]
        bars = sorted([*bars, dummy], key=lambda entry: entry.index)
        indices = np.array([entry.index for entry in bars])
        ends = np.array([[entry.low, entry.high] for entry in bars]).T
        drawn = axis.barh(
            ["chance" if entry is dummy else entry.quantity for entry in bars],
            indices,
            xerr=np.abs(ends - indices),
            color=[BLUE if entry.above_chance else GREY for entry in bars],
            error_kw={"elinewidth": 0.8, "ecolor": "#566"},
        )
        drawn[bars.index(dummy)].set_hatch("///")
        axis.axvline(dummy.high, color=BLACK, linestyle="--", linewidth=1.0)
        axis.set_xlim(left=0.0)
        axis.tick_params(axis="y", labelsize="small")
        axis.set_xlabel("PAWN index")
        axis.set_title(OUTPUT_NAMES[output], fontsize="medium")
    return figure


def plot_scatter(rows: Sequence[Row], quantities: Sequence[str]) -> Figure:
    """Draws end error and Δv of all flights against quantities; crosses are failures.

    Args:
      rows: of the flights that were flown.
      quantities: names of `drawn_columns`, at least one.
    """
    columns = drawn_columns(rows)
    failed = np.array([not row["success"] for row in rows])
    errors = np.array([row["terminal_position_error_m"] for row in rows])
    delta_v = np.array([row["delta_v_m_s"] for row in rows])
    figure = new_figure(0.8 + 3.4 * len(quantities), 6.0)
    grid = figure.subplots(2, len(quantities), squeeze=False, sharex="col", sharey="row")
    for axes, name in zip(grid.T, quantities, strict=True):
        found, labels = columns[name].values, columns[name].labels
        for axis, values in zip(axes, (np.maximum(errors, _LEAST_ERROR), delta_v), strict=True):
            axis.plot(found[~failed], values[~failed], ".", color=BLUE, alpha=0.5, markersize=4)
            axis.plot(found[failed], values[failed], "x", color=ORANGE, markersize=5)
            axis.grid(alpha=0.25)
        if labels:
            axes[1].set_xticks(range(len(labels)), labels, fontsize="small")
        axes[1].set_xlabel(name, fontsize="small")
    grid[0, 0].set_yscale("log")
    grid[0, 0].set_ylabel("end error (m)")
    grid[1, 0].set_ylabel("Δv (m/s)")
    return figure
