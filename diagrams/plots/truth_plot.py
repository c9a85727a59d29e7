"""Draws what nobody on board knows over time: attitude error, true mass, and true thrust."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from proxops.diagrams.logs import FlightLog
from proxops.diagrams.plots.shared_axes import AXIS_COLOURS, force_edges, minutes_of
from proxops.systems.common import InputError

_LINE = "#33415c"


def plot_truth(log: FlightLog) -> Figure:
    """Draws how the true axes, mass and thrust differ from what is believed, over time.

    The panels, from the top, show the angle by which the spacecraft's axes are turned against what
    it takes for them; the true mass; and, for each axis of the thrusters, the true thrust less the
    force that they were to give. A panel is left out if the log lacks its data.

    Raises:
      InputError: the log has none of them, because axes, mass and thrust were as believed.
    """
    data = log.dataset
    panels = {
        name: draw
        for name, draw in (
            ("attitude", _plot_attitude), ("mass", _plot_mass), ("thrust", _plot_thrust),
        )
        if name in data
    }  # fmt: skip
    if not panels:
        raise InputError(
            "the log has no true attitude, mass or thrust: in this flight they were as believed; "
            "set values of truth, or fly with dispersions"
        )
    figure = Figure(figsize=(11.0, 0.6 + 2.2 * len(panels)), layout="constrained")
    axes = figure.subplots(len(panels), 1, sharex=True, squeeze=False)[:, 0]
    for ax, draw in zip(axes, panels.values(), strict=True):
        draw(ax, log)
        ax.margins(x=0.01)
        ax.grid(alpha=0.25)
    axes[-1].set_xlabel("time (min)")
    return figure


def _plot_attitude(ax: Axes, log: FlightLog) -> None:
    quaternions = log.dataset["attitude"].values
    # The angle from the sine of its half is exact for small angles too.
    half = np.arctan2(np.linalg.norm(quaternions[:, 1:], axis=1), np.abs(quaternions[:, 0]))
    ax.plot(minutes_of(log), np.degrees(2.0 * half), color=_LINE)
    ax.set_ylabel("attitude error\n(degrees)")
    ax.set_ylim(bottom=0.0)


def _plot_mass(ax: Axes, log: FlightLog) -> None:
    ax.plot(minutes_of(log), log.dataset["mass"].values, color=_LINE)
    believed = log.scenario.spacecraft.mass_kg
    ax.axhline(believed, color=_LINE, linestyle="--", linewidth=1.0, label="believed")
    ax.legend(fontsize="small", frameon=False)
    ax.set_ylabel("mass (kg)")


def _plot_thrust(ax: Axes, log: FlightLog) -> None:
    less = (log.dataset["thrust"] - log.dataset["force"]).values[:-1]
    for axis, (letter, colour) in enumerate(AXIS_COLOURS.items()):
        ax.stairs(less[:, axis], force_edges(log), baseline=None, color=colour, label=letter)
    ax.legend(fontsize="small", frameon=False, ncols=3)
    ax.set_ylabel("true thrust less that\nasked for (N)")
