"""Draws a hybrid's decisions and the interventions of runtime assurance over time."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from proxops.diagrams.logs import REASONS, FlightLog, all_flown_by, flown_by, legend_of
from proxops.diagrams.plots.shared_axes import minutes_of, unit_at
from proxops.diagrams.scenario import described_bounds
from proxops.systems.hybrid import FlownBy

_AGREE, _DIFFER, _LIMIT = "#128a3a", "#b03030", "#33415c"


def plot_decisions(log: FlightLog) -> Figure:
    """Draws which controller flew each step, and why.

    The panels, from the top, show the controller of each step; the size of the difference between
    the forces of policy and MPC, with the gate's limit; the angle between these forces, with the
    gate's limit; the size of each change by runtime assurance, coloured by its reason; and the
    margin of each command, which is negative where it was changed to keep out. Beside them stand
    the bounds of the errors. A panel is left out if the log lacks its data.
    """
    data, settings = log.dataset, log.scenario.hybrid
    compared, assured = "agreement" in data, "intervention" in data
    margins = "assurance_margin" in data
    heights = [0.35] + 2 * compared * [1.0] + assured * [1.0] + margins * [1.2]
    figure = Figure(figsize=(11.0, 1.0 + 1.8 * sum(heights)), layout="constrained")
    axes = figure.subplots(len(heights), 1, sharex=True, height_ratios=heights, squeeze=False)
    rest = list(axes[:, 0])
    _plot_who(rest.pop(0), log)
    if compared:
        difference, angle = rest.pop(0), rest.pop(0)
        _plot_checks(difference, log, data["force_difference"].values)
        difference.axhline(settings.epsilon_magnitude_n, color=_LIMIT, linestyle="--")
        difference.set_ylabel("‖u − v‖ (N)")
        _plot_checks(angle, log, np.degrees(data["force_angle"].values))
        angle.axhline(settings.epsilon_angle_deg, color=_LIMIT, linestyle="--")
        angle.set_ylabel("angle (degrees)")
    if assured:
        _plot_changes(rest.pop(0), log)
    if margins:
        _plot_margins(rest.pop(0), log)
    for ax in axes[1:, 0]:
        ax.grid(alpha=0.25)
    axes[-1, 0].set_xlabel("time (min)")
    figure.legend(
        handles=_legend(log, compared), loc="outside upper center", ncols=6, frameon=False
    )
    return figure


def _plot_who(ax: Axes, log: FlightLog) -> None:
    who, minutes = flown_by(log.dataset)[:-1], minutes_of(log)
    legend = legend_of(log.dataset)
    for each in all_flown_by(log.dataset):
        spans = [
            (minutes[row], minutes[row + 1] - minutes[row]) for row in np.nonzero(who == each)[0]
        ]
        ax.broken_barh(spans, (0.0, 1.0), facecolors=legend[each].colour)
    ax.set_yticks([])
    ax.set_ylim(0.0, 1.0)
    ax.margins(x=0.0)


def _plot_changes(ax: Axes, log: FlightLog) -> None:
    """The size of each change of the command, by its reason."""
    change = log.dataset["intervention"].values[:-1]
    reasons = log.dataset["intervention_reason"].values[:-1]
    ax.stairs(change, minutes_of(log), color=legend_of(log.dataset)[FlownBy.SAFETY_FILTER].colour)
    for reason, (why, colour) in REASONS.items():
        rows = np.nonzero(reasons == reason)[0]
        if rows.size:
            label = f"{why} ({rows.size} steps)"
            ax.plot(
                minutes_of(log)[rows], change[rows], "o", markersize=2.5, color=colour, label=label
            )
    if ax.get_legend_handles_labels()[1]:
        ax.legend(loc="upper right", fontsize="small")
    ax.set_ylabel("change of the\ncommand (N)")
    ax.set_ylim(bottom=0.0)


def _plot_margins(ax: Axes, log: FlightLog) -> None:
    """The margin of each command, and the errors of the state that it allows for."""
    data, minutes = log.dataset, minutes_of(log)
    length, unit = unit_at(log.body)
    margin = data["assurance_margin"].values / length
    ax.plot(minutes, np.where(np.isfinite(margin), margin, np.nan), color=_LIMIT, label="margin")
    unsafe = np.nonzero(margin < 0.0)[0]
    low = np.maximum(margin[unsafe], -1.0)
    ax.plot(minutes[unsafe], low, "v", markersize=4.0, color=_DIFFER, label="not safe")
    error = data["assurance_position"].values / length
    ax.plot(minutes, error, color=_AGREE, label="error of position")
    ax.axhline(0.0, color="black", linewidth=0.8)
    ax.set_yscale("symlog", linthresh=1.0)
    ax.set_ylabel(f"margin ({unit})")
    ax.legend(loc="upper right", fontsize="small", ncols=3)
    ax.set_title(f"it allows for: {described_bounds(log.scenario)}", fontsize="small", loc="left")


def _plot_checks(ax: Axes, log: FlightLog, values: np.ndarray) -> None:
    agreed = log.dataset["agreement"].values
    for wanted, colour in ((1.0, _AGREE), (0.0, _DIFFER)):
        rows = np.nonzero(agreed == wanted)[0]
        ax.plot(minutes_of(log)[rows], values[rows], "o", markersize=3.5, color=colour)
    ax.set_ylim(bottom=0.0)


def _legend(log: FlightLog, compared: bool) -> list[Line2D]:
    legend = legend_of(log.dataset)
    entries = [legend[each] for each in all_flown_by(log.dataset)]
    handles = [
        Line2D([], [], color=entry.colour, linewidth=5.0, label=f"flown by {entry.name}")
        for entry in entries
    ]
    if compared:
        handles += [
            Line2D([], [], color=_AGREE, marker="o", linestyle="", label="forces agree"),
            Line2D([], [], color=_DIFFER, marker="o", linestyle="", label="forces disagree"),
            Line2D([], [], color=_LIMIT, linestyle="--", label="limit of the gate"),
        ]
    return handles
