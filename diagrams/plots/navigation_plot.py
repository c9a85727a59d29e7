"""Draws what the navigation knew over time: its errors, its own covariance, and its returns."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from proxops.diagrams.logs import FlightLog, navigation_errors
from proxops.diagrams.plots.shared_axes import AXIS_COLOURS, minutes_of
from proxops.systems.common import InputError
from proxops.systems.navigation import NavigationPhase

_PHASES = {
    NavigationPhase.ACQUIRING: ("acquiring", "#c9b458"),
    NavigationPhase.FOLLOWING: ("following", "#8fb996"),
    NavigationPhase.LOST: ("lost", "#b03030"),
}
_USED, _REJECTED = "#33415c", "#b03030"
_DEVIATIONS = 3.0
# Each panel of errors: its label, where its components begin, and the factor to its unit.
_ERRORS = (
    ("position (m)", 0, 1.0),
    ("velocity (m/s)", 3, 1.0),
    ("attitude (degrees)", 6, 180.0 / np.pi),
)


def plot_navigation(log: FlightLog) -> Figure:
    """Draws the errors of the navigation, what it knew of them, and the returns that it used.

    The panels, from the top, show the phase of the navigation; the sizes of the errors of position,
    velocity and attitude along each axis of K, with three standard deviations of its own
    covariance; and the returns used and rejected.

    Raises:
      InputError: the flight had no navigation.
    """
    if "navigation_state" not in log.dataset:
        raise InputError(
            "the log has no navigation: this flight was told its true state, or its controller "
            "needs none; set navigation to !LidarNavigation {}"
        )
    figure = Figure(figsize=(11.0, 9.0), layout="constrained")
    heights = [0.15, *len(_ERRORS) * [1.0], 0.7]
    phase, *panels, returns = figure.subplots(len(heights), 1, sharex=True, height_ratios=heights)
    _plot_phase(phase, log)
    errors, deviations = navigation_errors(log.dataset)
    for ax, (label, first, factor) in zip(panels, _ERRORS, strict=True):
        for axis, colour in enumerate(AXIS_COLOURS.values()):
            error = factor * np.abs(errors[:, first + axis])
            limit = factor * _DEVIATIONS * deviations[:, first + axis]
            ax.plot(minutes_of(log), error, color=colour, linewidth=1.2)
            ax.plot(minutes_of(log), limit, color=colour, linewidth=1.0, linestyle="--")
        ax.set_yscale("log")
        ax.set_ylabel(label)
    for name, colour in (("returns", _USED), ("rejected", _REJECTED)):
        values = log.dataset[f"navigation_{name}"].values
        returns.plot(minutes_of(log), values, color=colour, linewidth=1.2)
    returns.set_yscale("symlog")
    returns.set_ylim(bottom=0.0)
    returns.set_ylabel("returns")
    for ax in (*panels, returns):
        ax.grid(alpha=0.25)
        ax.margins(x=0.01)
    returns.set_xlabel("time (min)")
    figure.legend(handles=_legend(log), loc="outside upper center", ncols=5, frameon=False)
    return figure


def _plot_phase(ax: Axes, log: FlightLog) -> None:
    phases, minutes = log.dataset["navigation_phase"].values[:-1], minutes_of(log)
    for phase, (_, colour) in _PHASES.items():
        rows = np.flatnonzero(phases == phase)
        spans = [(minutes[row], minutes[row + 1] - minutes[row]) for row in rows]
        ax.broken_barh(spans, (0.0, 1.0), facecolors=colour)
    ax.set_yticks([])
    ax.set_ylim(0.0, 1.0)


def _legend(log: FlightLog) -> list[Line2D]:
    shown = np.unique(log.dataset["navigation_phase"].values[:-1])
    handles = [
        Line2D([], [], color=colour, linewidth=5.0, label=name)
        for phase, (name, colour) in _PHASES.items()
        if phase in shown
    ]
    handles += [
        Line2D([], [], color=colour, label=f"error along {letter}")
        for letter, colour in AXIS_COLOURS.items()
    ]
    return [
        *handles,
        Line2D([], [], color="black", linestyle="--", label="three standard deviations"),
        Line2D([], [], color=_USED, label="returns used"),
        Line2D([], [], color=_REJECTED, label="rejected"),
    ]
