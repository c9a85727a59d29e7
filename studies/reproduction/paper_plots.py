"""Figures of the paper's reproduction: curves, errors along a path, control effort, the gates."""

from __future__ import annotations

import csv
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from proxops.diagrams.logs import FlightLog
from proxops.diagrams.plots import length_unit
from proxops.studies.report import (
    BLACK,
    BLUE,
    GOAL,
    ORANGE,
    Looks,
    add_legend,
    draw_paths,
    label_axis,
    new_figure,
    path_handles,
)

_MINUTE = 60.0
_ACROSS = 3

Curve = list[dict[str, float]]
"""One row for each epoch, as `write_curves` writes them."""


def read_curves(folder: Path) -> dict[str, Curve]:
    """Reads the curves of a training, and of its rounds if it has any, by name."""
    curves = {}
    for path in sorted(folder.glob("**/curves/*.csv")):
        places = path.parent.parent.relative_to(folder).parts
        with path.open() as file:
            rows = [{k: float(v) for k, v in row.items()} for row in csv.DictReader(file)]
        if rows:
            curves[" ".join([*places, path.stem])] = rows
    return curves


def plot_curves(curves: Mapping[str, Curve]) -> Figure:
    """Draws the loss on the training and validation parts over epochs, one plot for each curve."""
    rows = -(-len(curves) // _ACROSS)
    figure = new_figure(4.0 * _ACROSS, 2.9 * rows)
    axes = figure.subplots(rows, _ACROSS, squeeze=False).ravel()
    for axis, (name, curve) in zip(axes, curves.items(), strict=False):
        epochs = np.arange(1, len(curve) + 1)
        for key, colour in (("training_loss", BLUE), ("validation_loss", ORANGE)):
            losses = [row.get(key, np.nan) for row in curve]
            axis.plot(epochs, losses, color=colour, marker=".", label=key.split("_")[0])
        axis.set_title(name, fontsize="medium")
        label_axis(axis, "epoch", "loss")
    for axis in axes[len(curves) :]:
        axis.set_axis_off()
    axes[0].legend(frameon=False, fontsize="small")
    return figure


def plot_views(logs: Mapping[str, FlightLog], looks: Looks) -> Figure:
    """Draws the paths of one transit in the frame of the body, seen along its three axes."""
    figure = new_figure(12.0, 4.9)
    for axis, plane in zip(figure.subplots(1, 3), ("xy", "xz", "yz"), strict=True):
        draw_paths(axis, logs, plane, looks)
    add_legend(figure, 4, handles=path_handles(logs, looks))
    return figure


def path_errors(expert: FlightLog, log: FlightLog) -> tuple[np.ndarray, np.ndarray]:
    """Returns times (N,) in s and distances (N,) in m from the expert's position at those times.

    After the end of the expert's flight its last position counts.
    """
    times, best = log.dataset["time"].values, expert.dataset
    where = np.stack(
        [np.interp(times, best["time"].values, x) for x in best["state"].values[:, :3].T], axis=1
    )
    return times, np.linalg.norm(log.dataset["state"].values[:, :3] - where, axis=1)


def plot_path_errors(expert: FlightLog, logs: Mapping[str, FlightLog], looks: Looks) -> Figure:
    """Draws the position error over time against the MPC's path, on a logarithmic scale."""
    figure = new_figure(9.0, 4.4)
    axis = figure.subplots()
    length, unit = length_unit(float(expert.body.shape.extents.max()))
    for name, log in logs.items():
        times, errors = path_errors(expert, log)
        shown = np.maximum(errors, 1.0) / length  # A log scale has no zero.
        colour, style = looks[name]
        axis.semilogy(times / _MINUTE, shown, color=colour, linestyle=style, label=name)
    radius = expert.scenario.arrival.radius_m / length
    axis.axhline(radius, color=GOAL, linestyle=":", linewidth=1.0, label="arrival's radius")
    label_axis(axis, "time (min)", f"distance from the MPC's flight ({unit})")
    add_legend(figure, 3, fontsize="small")
    return figure


def plot_effort(log: FlightLog, expert: np.ndarray) -> Figure:
    """Draws a flight's force by axis; `expert` (N, 3) is the MPC's at the same states, in N."""
    figure = new_figure(10.0, 8.0)
    axes = figure.subplots(4, 1, sharex=True)
    minutes = log.dataset["time"].values[:-1] / _MINUTE
    force = log.dataset["force"].values[:-1]
    for k, axis in enumerate(axes[:3]):
        axis.plot(minutes, force[:, k], color=ORANGE, linewidth=1.2, label="flown")
        axis.plot(minutes, expert[:, k], "--", color=BLACK, linewidth=0.9, label="MPC's there")
        label_axis(axis, "", f"{'xyz'[k]} (N)")
    axes[3].plot(minutes, np.linalg.norm(force - expert, axis=1), color=BLUE, linewidth=1.0)
    label_axis(axes[3], "time (min)", "size of difference (N)")
    axes[0].legend(frameon=False, fontsize="small", ncols=2, loc="upper right")
    return figure


def plot_gates(points: Mapping[str, tuple[float, float, float]]) -> Figure:
    """Draws what the gates trade: solves saved against fuel and clearance.

    Args:
      points: for each name the share of solves saved, Δv over the MPC's (NaN where no transit is
        compared), and the least clearance in m.
    """
    figure = new_figure(10.0, 4.4)
    left, right = figure.subplots(1, 2, sharex=True)
    for k, (name, (saved, fuel, clearance)) in enumerate(points.items()):
        marker = "s" if name.startswith("always zero") else "o"
        for axis, value in ((left, fuel), (right, clearance / 1e3)):
            label = name if axis is left else None
            axis.plot(100.0 * saved, value, marker, color=f"C{k}", markersize=8, label=label)
    left.axhline(1.0, color=BLACK, linewidth=0.8)
    right.axhline(0.0, color="#b03030", linewidth=0.8)
    label_axis(left, "MPC solves saved (%)", "Δv over the MPC's, where both arrive")
    label_axis(right, "MPC solves saved (%)", "least clearance of the keep-out (km)")
    add_legend(figure, 3, fontsize="small")
    return figure
