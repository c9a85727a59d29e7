"""Draws a flight: its path, and distance, speed, clearance and force over time.

`plot_flight` makes a whole figure; the other functions draw on given axes. Lengths are in km, or
in m for small bodies. The functions use plain matplotlib and need no display. To write a file, call
the figure's `savefig`.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Ellipse

from proxops.diagrams.logs import (
    FlightLog,
    all_flown_by,
    dense_positions,
    flown_by,
    legend_of,
    outcome,
)
from proxops.diagrams.plots.outlines import outline
from proxops.diagrams.plots.shared_axes import MINUTE, force_edges, frame_plane, minutes_of, unit_at
from proxops.diagrams.scenario import Body, TrueBody, spin_axes
from proxops.systems.gravity import AXES
from proxops.systems.shapes import clearances

BODY = "#b5aea4"
KEEP_OUT = "#5577bb"
GOAL = "#128a3a"
_LIMIT = "#b03030"
_LINE = "#33415c"
MAP, BELIEVED_AXIS, TRUE_AXIS = "#0f6f9c", "#0f6f9c", "#c2186b"


def plot_flight(log: FlightLog) -> Figure:
    """Draws the whole flight on one page.

    The first row shows the path in three projections; the second shows distance to the goal, speed
    and clearance over time; the third shows the force along each axis over time, with the limits.
    """
    figure = Figure(figsize=(13.0, 10.5), layout="constrained")
    grid = figure.subplots(3, 3, height_ratios=[1.5, 1.0, 1.0])
    for ax, plane in zip(grid[0], ("xy", "xz", "yz"), strict=True):
        plot_path(ax, log, plane)
    for ax, plot in zip(grid[1], (plot_distance, plot_speed, plot_clearance), strict=True):
        plot(ax, log)
    for ax, axis in zip(grid[2], "xyz", strict=True):
        plot_force(ax, log, axis)
    figure.legend(handles=_legend(log), loc="outside lower center", ncols=8, frameon=False)
    summary = log.summary
    transit = f"seed {summary['seed']}, transit {summary['transit']}"
    title = f"{log.body.config.name}: {summary['controller']}, {transit}, {outcome(summary)}"
    figure.suptitle(title)
    return figure


def plot_path(ax: Axes, log: FlightLog, plane: str = "xy") -> None:
    """Draws the path in K, projected on the plane "xy", "xz" or "yz".

    The colours tell which controller flew each step. The silhouette of the body, the outline of the
    keep-out ellipsoid, the start and the goal are drawn too.
    """
    across, up = (AXES[letter] for letter in plane)
    length, unit = unit_at(log.body)
    positions = log.dataset["state"].values[:, :3] / length
    goal = log.dataset["target"].values[-1, :3] / length
    draw_body(ax, log.body, plane, log.differing_body)
    flat = positions[:, [across, up]]
    segments = np.stack([flat[:-1], flat[1:]], axis=1)
    legend = legend_of(log.dataset)
    colours = [legend[who].colour for who in flown_by(log.dataset)[:-1].tolist()]
    ax.add_collection(LineCollection(list(segments), colors=colours, linewidths=2.0, zorder=3))
    ax.plot(*flat[0], "o", color="black", markersize=5, zorder=4)
    ax.plot(goal[across], goal[up], "*", color=GOAL, markersize=13, zorder=4)
    keep_out = log.body.keep_out_semi_axes.max() / length
    reach = max(np.abs(positions).max(), np.abs(goal).max(), keep_out)
    frame_plane(ax, plane, unit, 1.08 * reach)


def draw_body(ax: Axes, body: Body, plane: str = "xy", true_body: TrueBody | None = None) -> None:
    """Draws the silhouettes of the body and of its keep-out ellipsoid on a plane such as "xy".

    Where the true body differs from the body as believed, its silhouette is the filled one, the
    outline of the map is dashed, and both spin axes are lines; an axis that is seen from its end is
    a dot.
    """
    length, _ = unit_at(body)
    across, up = (AXES[letter] for letter in plane)
    shape = body.shape if true_body is None else true_body.shape
    triangles = shape.vertices[shape.facets][:, :, [across, up]] / length
    # One colour for facets and edges merges all facets into one silhouette, also of concave bodies.
    ax.add_collection(
        PolyCollection(
            list(triangles), facecolors=BODY, edgecolors=BODY, linewidths=0.5, rasterized=True
        )
    )
    axes = body.keep_out_semi_axes / length
    ax.add_patch(
        Ellipse(
            (0.0, 0.0), 2.0 * axes[across], 2.0 * axes[up],
            fill=False, edgecolor=KEEP_OUT, linestyle="--", linewidth=1.2,
        )
    )  # fmt: skip
    if shape is not body.shape:
        for chain in outline(body.shape, across, up):
            ax.plot(*(chain.T / length), color=MAP, linestyle="--", linewidth=1.0)
    lines = None if true_body is None else spin_axes(body, true_body)
    if lines:
        for line, colour in zip(lines, (BELIEVED_AXIS, TRUE_AXIS), strict=True):
            flat = line[:, [across, up]] / length
            ax.plot(*flat.T, "-o", color=colour, linewidth=1.0, markersize=2)


def plot_distance(ax: Axes, log: FlightLog) -> None:
    """Draws the distance to the goal over time, on a logarithmic scale, and the arrival radius."""
    data, radius = log.dataset, log.scenario.arrival.radius_m
    length, unit = unit_at(log.body)
    distance = np.linalg.norm((data["state"] - data["target"]).values[:, :3], axis=1)
    # A logarithmic scale has no zero, so distances are cut off below 0.001 of the radius.
    ax.semilogy(minutes_of(log), np.maximum(distance, 1e-3 * radius) / length, color=_LINE)
    ax.axhline(radius / length, color=GOAL, linestyle="--", linewidth=1.0)
    _over_time(ax, log, f"distance to the goal ({unit})")


def plot_speed(ax: Axes, log: FlightLog) -> None:
    """Draws the speed in K over time, its greatest component, and the limit per axis."""
    velocity = log.dataset["state"].values[:, 3:]
    minutes = minutes_of(log)
    ax.plot(minutes, np.linalg.norm(velocity, axis=1), color=_LINE, label="speed")
    ax.plot(
        minutes, np.abs(velocity).max(axis=1), color=_LINE, alpha=0.5, linewidth=1.0,
        label="greatest component",
    )  # fmt: skip
    limit = log.scenario.spacecraft.speed_limit_m_s
    ax.axhline(limit, color=_LIMIT, linestyle="--", linewidth=1.0)
    ax.set_ylim(bottom=0.0)
    ax.legend(fontsize="small", frameon=False)
    _over_time(ax, log, "speed (m/s)")


def plot_clearance(ax: Axes, log: FlightLog, **line: Any) -> None:
    """Draws the Euclidean distance to the keep-out ellipsoid over time; it is negative inside.

    Args:
      line: properties of the line, such as `label` and `color`, for several flights in one plot.
    """
    times, states = log.dataset["time"].values, log.dataset["state"].values
    length, unit = unit_at(log.body)
    clearance = clearances(log.body.keep_out_semi_axes, dense_positions(times, states)) / length
    row = np.arange(len(clearance)) / max(1, (len(clearance) - 1)) * (len(times) - 1)
    minutes = np.interp(row, np.arange(len(times)), times) / MINUTE
    ax.plot(minutes, clearance, **{"color": _LINE, **line})
    inside = np.minimum(clearance, 0.0)
    ax.fill_between(minutes, inside, 0.0, color=_LIMIT, alpha=0.4, linewidth=0.0)
    ax.axhline(0.0, color=KEEP_OUT, linestyle="--", linewidth=1.2)
    _over_time(ax, log, f"keep-out clearance ({unit})")


def plot_force(ax: Axes, log: FlightLog, axis: str) -> None:
    """Draws the force along the axis "x", "y" or "z" of S over time, and its limits."""
    force = log.dataset["force"].values[:-1, AXES[axis]]
    ax.stairs(force, force_edges(log), baseline=None, color=_LINE, linewidth=1.2)
    limit = log.scenario.spacecraft.thrust_limit_n
    for sign in (-1.0, 1.0):
        ax.axhline(sign * limit, color=_LIMIT, linestyle="--", linewidth=1.0)
    ax.set_ylim(-1.15 * limit, 1.15 * limit)
    _over_time(ax, log, f"force along {axis} of S (N)")


def _over_time(ax: Axes, log: FlightLog, label: str) -> None:
    arrival = float(log.dataset.attrs["arrival_time_s"])
    if np.isfinite(arrival):
        ax.axvline(arrival / MINUTE, color=GOAL, linewidth=1.0)
    ax.set_xlabel("time (min)")
    ax.set_ylabel(label)
    ax.margins(x=0.01)
    ax.grid(alpha=0.25)


def _legend(log: FlightLog) -> list[Line2D]:
    """Gives the legend of the colours and line styles for the controllers in this log."""
    legend = legend_of(log.dataset)
    entries = [legend[each] for each in all_flown_by(log.dataset)]
    arrived = np.isfinite(log.dataset.attrs["arrival_time_s"])
    return [
        *(
            Line2D([], [], color=entry.colour, linewidth=2.0, label=f"flown by {entry.name}")
            for entry in entries
        ),
        Line2D([], [], color="black", marker="o", linestyle="", label="start"),
        Line2D([], [], color=GOAL, marker="*", markersize=11, linestyle="", label="goal"),
        Line2D([], [], color=GOAL, linestyle="--", linewidth=1.0, label="arrival radius"),
        *([Line2D([], [], color=GOAL, linewidth=1.0, label="arrival")] if arrived else []),
        Line2D([], [], color=KEEP_OUT, linestyle="--", label="keep-out ellipsoid"),
        Line2D([], [], color=_LIMIT, linestyle="--", label="limit"),
        *true_handles(log.body, log.differing_body),
    ]


def true_handles(body: Body, true_body: TrueBody | None) -> list[Line2D]:
    """Gives the legend of what `draw_body` draws only where the true body differs from belief."""
    handles = []
    if true_body is None:
        return handles
    if true_body.shape is not body.shape:
        handles.append(Line2D([], [], color=MAP, linestyle="--", label="map"))
    if spin_axes(body, true_body) is not None:
        handles += [
            Line2D([], [], color=BELIEVED_AXIS, marker="o", label="believed spin axis"),
            Line2D([], [], color=TRUE_AXIS, marker="o", label="true spin axis"),
        ]
    return handles
