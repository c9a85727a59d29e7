"""Figures of an evaluation: end errors, Δv, paths, and single flights in detail."""

from __future__ import annotations

import typing
from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from proxops.diagrams.logs import WIDE_ARRIVAL, FlightLog
from proxops.diagrams.plots import (
    draw_body,
    frame_plane,
    length_unit,
    plot_clearance,
    plot_distance,
)
from proxops.studies.evaluation.evaluation import EXPERT

# Okabe and Ito's colours, which the colour-blind tell apart; the expert is black.
_COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#8a7a00")
_BLACK = "#1d2430"
_STYLES = ("--", "-.", "-")
_GOAL = "#128a3a"
# The drawing ends at this multiple of starts, goals and keep-out; paths beyond it are cut off.
_ROOM = 1.25


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
    return {name: looks.get(name, Look(_BLACK, "-")) for name in names}


def plot_end_errors(errors: Mapping[str, np.ndarray], radius: float, looks: Looks) -> Figure:
    """Draws the share of flights that end within a distance of the goal, on a logarithmic scale.

    Args:
      errors: distances (N,) in m from the goal at the end, by controller.
      radius: of the goal region, in m; it is marked, and twice the radius too.
    """
    figure = Figure(figsize=(8.5, 4.4), layout="constrained")
    axis = figure.subplots()
    length, unit = length_unit(100.0 * radius)
    least = 1e-3 * radius  # A logarithmic scale has no zero, and smaller errors do not matter.
    greatest = max((values.max() for values in errors.values() if values.size), default=radius)
    greatest = max(2.0 * greatest, 4.0 * radius)
    for name, values in errors.items():
        found = np.sort(np.maximum(values, least)) / length
        share = np.arange(1, len(found) + 1) / max(1, len(found))
        across = np.concatenate([[0.5 * least / length], found, [greatest / length]])
        up = np.concatenate([[0.0], share, share[-1:]])
        colour, style = looks[name]
        axis.step(across, up, where="post", color=colour, linestyle=style, label=name)
    for multiple, style in ((1.0, "--"), (WIDE_ARRIVAL, ":")):
        axis.axvline(multiple * radius / length, color=_GOAL, linestyle=style, linewidth=1.0)
    axis.set_xscale("log")
    axis.set_xlim(0.5 * least / length, greatest / length)
    axis.set_ylim(0.0, 1.02)
    axis.set_xlabel(f"distance to the goal at the end ({unit})")
    axis.set_ylabel("share of flights")
    axis.grid(alpha=0.25)
    figure.legend(loc="outside lower center", ncols=2, frameon=False, fontsize="small")
    return figure


def plot_delta_v(pairs: Mapping[str, np.ndarray], looks: Looks) -> Figure:
    """Draws each flight's Δv against the expert's on the same transit.

    Args:
      pairs: (N, 2) in m/s by controller: its own Δv and the expert's.
    """
    figure = Figure(figsize=(6.2, 5.8), layout="constrained")
    axis = figure.subplots()
    limit = 1.06 * max(float(found.max()) for found in pairs.values())
    low = 0.9 * min(float(found.min()) for found in pairs.values())
    line = np.array([low, limit])
    axis.plot(line, line, color=_BLACK, linewidth=1.0, label="as the expert")
    axis.plot(line, 1.1 * line, color=_BLACK, linewidth=1.0, linestyle=":", label="10 % more")
    for name, found in pairs.items():
        label = f"{name} ({len(found)})"
        colour = looks[name].colour
        axis.plot(*found.T[::-1], "o", color=colour, alpha=0.6, markersize=4, label=label)
    axis.set_xlim(low, limit)
    axis.set_ylim(low, limit)
    axis.set_aspect("equal")
    axis.set_xlabel("Δv of the expert (m/s)")
    axis.set_ylabel("Δv (m/s)")
    axis.grid(alpha=0.25)
    figure.legend(loc="outside lower center", ncols=2, frameon=False, fontsize="small")
    return figure


def plot_paths(logs: Mapping[str, Sequence[FlightLog]], looks: Looks) -> Figure:
    """Draws the paths of the same transits by each controller, seen along z and along y.

    Args:
      logs: by controller; all controllers have the same transits.
    """
    count = len(next(iter(logs.values())))
    figure = Figure(figsize=(3.4 * count + 0.4, 7.4), layout="constrained")
    grid = figure.subplots(2, count, squeeze=False)
    for column in range(count):
        flights = {name: group[column] for name, group in logs.items()}
        for axis, plane in zip(grid[:, column], ("xy", "xz"), strict=True):
            draw_paths(axis, flights, plane, looks)
        transit = next(iter(flights.values())).scenario.transit.index
        grid[0, column].set_title(f"transit {transit}", fontsize="medium")
    handles = [
        *(
            Line2D([], [], color=looks[name].colour, linestyle=looks[name].style, label=name)
            for name in logs
        ),
        Line2D([], [], color="black", marker="o", linestyle="", label="start"),
        Line2D([], [], color=_GOAL, marker="*", markersize=11, linestyle="", label="goal"),
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=4, frameon=False)
    return figure


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
    start, goal = (
        first.dataset[name].values[0, :3] / length for name in ("state", "target")
    )  # fmt: skip
    axis.plot(start[across], start[up], "o", color="black", markersize=5)
    axis.plot(goal[across], goal[up], "*", color=_GOAL, markersize=13)
    keep_out = first.body.keep_out_semi_axes.max() / length
    reach = _ROOM * max(np.abs(start).max(), np.abs(goal).max(), keep_out)
    frame_plane(axis, plane, unit, reach)


def plot_flights(logs: Sequence[FlightLog], titles: Sequence[str]) -> Figure:
    """Draws each flight in a row of plots, which tell errors of navigation from those of guidance.

    The plots are: distance to the goal, true and (dashed) estimated; errors of the estimates of
    position and of velocity; clearance of the keep-out. Without estimates there are only the first
    and the last.
    """
    estimated = all("estimate" in log.dataset for log in logs)
    columns = 4 if estimated else 2
    figure = Figure(figsize=(3.9 * columns, 2.9 * len(logs)), layout="constrained")
    for row, log, title in zip(np.atleast_1d(figure.subfigures(len(logs), 1)), logs, titles,
                               strict=True):  # fmt: skip
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
    distance.plot(minutes, shown, color="#d55e00", linestyle="--", linewidth=1.0)
    error = estimate - data["state"].values
    for axis, part, limit, scale, label in (
        (position, error[:, :3], arrival.radius_m, length, f"error of position ({unit})"),
        (velocity, error[:, 3:], arrival.speed_m_s, 1.0, "error of velocity (m/s)"),
    ):
        sizes = np.maximum(np.linalg.norm(part, axis=1), 1e-3 * limit) / scale
        axis.semilogy(minutes, sizes, color="#d55e00", linewidth=1.0)
        axis.axhline(limit / scale, color=_GOAL, linestyle="--", linewidth=1.0)
        axis.set_xlabel("time (min)")
        axis.set_ylabel(label)
        axis.margins(x=0.01)
        axis.grid(alpha=0.25)
