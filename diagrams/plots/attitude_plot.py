"""Draws the attitude of a rigid spacecraft over time: pointing, rates, wheels and thrusters."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from proxops.diagrams.logs import FlightLog, pointing_errors
from proxops.diagrams.plots.shared_axes import AXIS_COLOURS, minutes_of
from proxops.diagrams.scenario import RigidBodyConfig, load_spacecraft
from proxops.systems.common import InputError

_LINE = "#33415c"


def plot_attitude(log: FlightLog) -> Figure:
    """Draws how a rigid spacecraft was turned, and what turned it.

    The panels, from the top, show the angle between the true attitude and the one that is wanted;
    the angular velocity along each axis of S; the centre of mass as it is estimated, and dotted as
    it is; the momentum of each wheel over its limit; and the share of time for which each thruster
    was on.

    Raises:
      InputError: the spacecraft was a point.
    """
    settings, data, minutes = log.scenario.spacecraft, log.dataset, minutes_of(log)
    if not isinstance(settings, RigidBodyConfig):
        raise InputError(
            "the spacecraft of this flight is a point: set spacecraft to !RigidBody {}"
        )
    model = load_spacecraft(settings.model)
    figure = Figure(figsize=(11.0, 10.0), layout="constrained")
    pointing, rates, centre, wheels, thrusters = figure.subplots(5, 1, sharex=True)
    pointing.plot(minutes, np.degrees(pointing_errors(data)), color=_LINE, linewidth=1.2)
    pointing.set_yscale("log")
    pointing.set_ylabel("pointing error (degrees)")
    true = log.scenario.truth.rigid_body.centre_of_mass_m
    for axis, (letter, colour) in enumerate(AXIS_COLOURS.items()):
        turn = np.degrees(data["angular_velocity"].values[:, axis])
        rates.plot(minutes, turn, color=colour, linewidth=1.0, label=letter)
        estimate = 100.0 * data["centre_of_mass"].values[:, axis]
        centre.plot(minutes, estimate, color=colour, linewidth=1.2)
        centre.axhline(100.0 * true[axis], color=colour, linewidth=1.0, linestyle=":")
    rates.set_ylabel("angular velocity (degrees/s)")
    centre.set_ylabel("centre of mass (cm)")
    if model.wheels is not None:
        share = data["wheel_momentum"].values / model.wheels.momentum
        wheels.plot(minutes, 100.0 * share, linewidth=1.0)
    wheels.set_ylabel("wheels (% of limit)")
    on = data["on_times"].values.T / log.scenario.attitude_period_s
    edges = np.append(minutes, minutes[-1])
    mesh = thrusters.pcolormesh(
        edges, np.arange(len(on) + 1) - 0.5, on, vmin=0.0, vmax=1.0, cmap="magma_r"
    )
    figure.colorbar(mesh, ax=thrusters, label="on")
    thrusters.set_ylabel("thruster")
    thrusters.set_xlabel("time (min)")
    for ax in (pointing, rates, centre, wheels):
        ax.grid(alpha=0.25)
        ax.margins(x=0.0)
    figure.legend(
        handles=rates.get_lines(), loc="outside upper center", ncols=3, frameon=False,
        title="along each axis of S",
    )  # fmt: skip
    return figure
