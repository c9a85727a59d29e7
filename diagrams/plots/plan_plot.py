"""Draws a plan of the MPC with its limits."""

from __future__ import annotations

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from proxops.diagrams.plots.flight_plot import draw_body
from proxops.diagrams.plots.shared_axes import AXIS_COLOURS, MINUTE, unit_at
from proxops.diagrams.scenario import Body, Scenario
from proxops.systems import Plan
from proxops.systems.shapes import clearances

_LIMIT = "#b03030"


def plot_plan(plan: Plan, body: Body, scenario: Scenario) -> Figure:
    """Draws path, force, velocity and clearance of one plan, with the limits of the scenario."""
    figure = Figure(figsize=(12.0, 8.0), layout="constrained")
    grid = figure.subplots(2, 2)
    minutes = plan.times / MINUTE
    _draw_way(grid[0, 0], plan, body)
    craft = scenario.spacecraft
    for axis, (letter, colour) in enumerate(AXIS_COLOURS.items()):
        force, velocity = plan.forces[:, axis], plan.states[:, 3 + axis]
        grid[0, 1].stairs(force, minutes, baseline=None, color=colour, label=letter, linewidth=1.5)
        grid[1, 0].plot(minutes, velocity, "o-", color=colour, label=letter, markersize=3)
    _bounded(grid[0, 1], craft.thrust_limit_n, "force (N)")
    _bounded(grid[1, 0], craft.speed_limit_m_s, "velocity (m/s)")
    clearance = clearances(body.keep_out_semi_axes, plan.states[:, :3])
    length, unit = unit_at(body)
    ax = grid[1, 1]
    ax.plot(minutes, clearance / length, "o-", color=AXIS_COLOURS["x"], markersize=3)
    margin = scenario.mpc.keep_out_margin_m / length
    ax.axhline(margin, color=_LIMIT, linestyle="--", linewidth=1.0)
    _over_time(ax, f"keep-out clearance at the knots ({unit})")
    if clearance.min() >= 0.0:
        ax.set_ylim(bottom=0.0)  # Where the plan enters the ellipsoid, that is to be seen.
    figure.legend(
        *grid[1, 0].get_legend_handles_labels(), loc="outside lower center", ncols=3, frameon=False
    )
    figure.suptitle(f"plan of {len(plan.forces)} intervals, {plan.times[-1]:.0f} s")
    return figure


def _draw_way(ax: Axes, plan: Plan, body: Body) -> None:
    length, unit = unit_at(body)
    draw_body(ax, body, "xy")
    ax.plot(*(plan.states[:, :2] / length).T, "o-", color=AXIS_COLOURS["x"], markersize=3)
    ax.plot(*(plan.target[:2] / length), "*", color="#128a3a", markersize=13)
    ax.autoscale_view()
    ax.margins(0.08)
    ax.set_aspect("equal")
    ax.set_xlabel(f"x ({unit})")
    ax.set_ylabel(f"y ({unit})")
    ax.grid(alpha=0.25)


def _bounded(ax: Axes, limit: float, label: str) -> None:
    for sign in (-1.0, 1.0):
        ax.axhline(sign * limit, color=_LIMIT, linestyle="--", linewidth=1.0)
    _over_time(ax, label)


def _over_time(ax: Axes, label: str) -> None:
    ax.set_xlabel("time (min)")
    ax.set_ylabel(label)
    ax.grid(alpha=0.25)
