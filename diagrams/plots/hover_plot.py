"""Draws where a spacecraft can hover: contours of the needed thrust on planes through the body."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.contour import QuadContourSet
from matplotlib.figure import Figure

from proxops.diagrams.plots.flight_plot import draw_body
from proxops.diagrams.plots.shared_axes import length_unit
from proxops.diagrams.scenario import Body, Scenario, hover_force
from proxops.systems.gravity import AXES


def plot_hover(body: Body, scenario: Scenario, count: int = 121) -> Figure:
    """Draws the thrust of hovering in the planes xy and xz, within the cube of the transits."""
    figure = Figure(figsize=(12.0, 5.4), layout="constrained")
    axes = figure.subplots(1, 2)
    image = draw_hover(axes[0], body, scenario, "xy", count)
    draw_hover(axes[1], body, scenario, "xz", count)
    label = "greatest force per axis (N)"
    figure.colorbar(image, ax=list(axes), label=label, shrink=0.85, pad=0.01)
    mass, limit = scenario.spacecraft.mass_kg, scenario.spacecraft.thrust_limit_n
    figure.suptitle(f"hovering at {body.config.name}, {mass:g} kg; red: {limit:g} N, the limit")
    return figure


def draw_hover(
    ax: Axes, body: Body, scenario: Scenario, plane: str = "xy", count: int = 121
) -> QuadContourSet:
    """Draws contours of the greatest force per axis that hovering takes.

    A red contour shows the thrust limit. There are no contours inside the body, whose silhouette is
    drawn too.

    Args:
      ax: the axes to draw on.
      body: the body.
      scenario: gives the spacecraft and the cube of the transits.
      plane: "xy", "xz" or "yz", through the centre of mass.
      count: number of grid points along each side.

    Returns:
      The filled contours, for a colour bar.
    """
    half, limit = 0.5 * scenario.transit.cube_m, scenario.spacecraft.thrust_limit_n
    line = np.linspace(-half, half, count)
    across, up = np.meshgrid(line, line)
    points = np.zeros((count * count, 3))
    points[:, AXES[plane[0]]], points[:, AXES[plane[1]]] = across.ravel(), up.ravel()
    force = hover_force(points, scenario.spacecraft.mass_kg, body)
    force[body.gravity_field.evaluate(points).inside] = np.nan
    force = force.reshape(count, count)
    length, unit = length_unit(half)
    filled = ax.contourf(
        across / length, up / length, force, np.linspace(0.0, limit, 15), cmap="cividis",
        extend="max",
    )  # fmt: skip
    if np.nanmax(force) > limit:
        ax.contour(across / length, up / length, force, [limit], colors="#d73027", linewidths=1.5)
    draw_body(ax, body, plane)
    ax.set_aspect("equal")
    ax.set_xlabel(f"{plane[0]} ({unit})")
    ax.set_ylabel(f"{plane[1]} ({unit})")
    return filled
