"""Plots of the gravity field on a body's surface and around the body.

`plot_surface_maps` and `plot_equilibria` make whole figures; `draw_surface` and `draw_plane_cut`
draw on given axes. To write a file, call the figure's `savefig`.
"""

from __future__ import annotations

from collections.abc import Sequence

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import PolyCollection
from matplotlib.colors import BoundaryNorm, Normalize
from matplotlib.contour import QuadContourSet
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patheffects import Normal, Stroke

from proxops.diagrams.plots.shared_axes import length_unit
from proxops.systems.common import Values
from proxops.systems.gravity import (
    AXES,
    BodyField,
    Equilibrium,
    PlaneCut,
    find_equilibria,
    plane_cut,
    surface_map,
    synchronous_radius,
)
from proxops.systems.shapes import Polyhedron

# For each axis that the viewer is on, the axes of K that point right and up.
VIEWS = {
    "+z": ("+x", "+y"),
    "-z": ("-x", "+y"),
    "-y": ("+x", "+z"),
    "+y": ("-x", "+z"),
    "+x": ("+y", "+z"),
    "-x": ("-y", "+z"),
}
# Number of contour levels of a plane cut.
_LEVELS = 40
_LABEL_EDGE = [Stroke(linewidth=2.5, foreground="black"), Normal()]
# Colour and legend text of an equilibrium, by its number of growing modes.
_MODES = {
    0: ("#1a9850", "stable"),
    1: ("#d73027", "unstable, one growing mode"),
    2: ("#f39c12", "unstable, two growing modes"),
}


def plot_surface_maps(field: BodyField, spin: float, title: str = "") -> Figure:
    """Draws gravity, slope and effective potential on the surface, each seen from +z, -y and +x.

    Args:
      field: gravity field of a shape in K.
      spin: angular velocity about z in rad/s.
      title: title of the figure; if empty, it is the shape's name.
    """
    found = surface_map(field, spin)
    rows = {
        "gravity (mm/s²)": (1e3 * found.gravity, "viridis"),
        "slope (degrees)": (np.degrees(found.slope), "inferno"),
        "effective potential (m²/s²)": (found.potential, "cividis"),
    }
    views = ("+z", "-y", "+x")
    extents = {axis: float(field.shape.extents[AXES[axis]]) for axis in "xyz"}
    widths = [extents[VIEWS[view][0][1]] for view in views]
    heights = max(extents[VIEWS[view][1][1]] for view in views)
    # All panels have one scale; the constants leave room for labels and colour bars.
    scale = 10.0 / sum(widths)
    size = 10.0 + 3.0, len(rows) * (scale * heights + 0.9) + 0.5
    figure = Figure(figsize=size, layout="constrained")
    grid = figure.subplots(len(rows), len(views), width_ratios=widths, squeeze=False)
    for line, (label, (values, colours)) in zip(grid, rows.items(), strict=True):
        norm = Normalize(values.min(), values.max())
        for ax, view in zip(line, views, strict=True):
            draw_surface(ax, field.shape, values, view, colours, norm)
        mappable = ScalarMappable(norm, colours)
        figure.colorbar(mappable, ax=list(line), label=label, fraction=0.03, pad=0.01, shrink=0.9)
    for ax, view in zip(grid[0], views, strict=True):
        ax.set_title(f"from {view}", fontsize="medium")
    figure.suptitle(title or field.shape.name)
    return figure


def draw_surface(
    ax: Axes,
    shape: Polyhedron,
    values: Values,
    view: str = "+z",
    colours: str = "viridis",
    norm: Normalize | None = None,
) -> PolyCollection:
    """Draws the facets that face the viewer, each in the colour of its value.

    Args:
      ax: the axes to draw on.
      shape: the body's shape in K.
      values: (F,), one value for each facet.
      view: the axis that the viewer is on, one of `VIEWS`.
      colours: name of a colour map.
      norm: range of the colour map; None: the range of all values.

    Returns:
      The facets that were drawn.
    """
    right, up = (axis_vector(axis) for axis in VIEWS[view])
    towards = np.cross(right, up)
    centres = shape.vertices[shape.facets].mean(axis=1)
    facing = np.flatnonzero(shape.normals @ towards > 0.0)
    facing = facing[np.argsort(centres[facing] @ towards)]
    length, unit = length_unit(float(shape.extents.max()))
    flat = shape.vertices @ np.stack([right, up], axis=1) / length
    norm = norm or Normalize(values.min(), values.max())
    rgba = mpl.colormaps[colours](norm(values[facing]))
    # Edges in the colour of their facet close the seams between facets.
    surface = PolyCollection(
        list(flat[shape.facets[facing]]),
        facecolors=rgba,
        edgecolors=rgba,
        linewidths=0.3,
        rasterized=True,
    )
    ax.add_collection(surface)
    ax.autoscale_view()
    ax.set_aspect("equal")
    ax.margins(0.03)
    ax.set_xlabel(_axis_label(VIEWS[view][0], unit))
    ax.set_ylabel(_axis_label(VIEWS[view][1], unit))
    return surface


def plot_equilibria(field: BodyField, spin: float, title: str = "", count: int = 241) -> Figure:
    """Draws the effective potential in the equatorial plane and the equilibria near it.

    Args:
      field: gravity field of a shape in K.
      spin: angular velocity about z in rad/s.
      title: title of the figure; if empty, it is the shape's name.
      count: number of grid points along each side.
    """
    equilibria = find_equilibria(field, spin)
    places = [field.shape.vertices, *(point.position[None] for point in equilibria)]
    half_width = 1.3 * float(np.abs(np.concatenate(places)[:, :2]).max())
    figure = Figure(figsize=(8.6, 7.9), layout="constrained")
    ax = figure.subplots()
    cut = plane_cut(field, spin, half_width, "xy", count)
    contours = draw_plane_cut(ax, cut, equilibria)
    bar = figure.colorbar(
        contours, ax=ax, ticks=np.asarray(contours.levels)[::5], format="%.4g", shrink=0.85,
        label="effective potential (m²/s²), by equal areas",
    )  # fmt: skip
    bar.ax.minorticks_off()
    figure.suptitle(title or field.shape.name)
    handles = [
        Line2D([], [], color=colour, marker="o", markeredgecolor="white", linestyle="", label=text)
        for number, (colour, text) in _MODES.items()
        if any(point.growing == number for point in equilibria)
    ]
    radius = synchronous_radius(field.mass, spin) / _plane_unit(cut)[0]
    if np.isfinite(radius):
        turn = np.linspace(0.0, 2.0 * np.pi, 181)
        ax.plot(radius * np.cos(turn), radius * np.sin(turn), ":", color="white", linewidth=1.2)
        line = Line2D([], [], color="grey", linestyle=":", label="synchronous orbit of a sphere")
        handles.append(line)
    figure.legend(handles=handles, loc="outside lower center", ncols=2, frameon=False)
    return figure


def draw_plane_cut(
    ax: Axes, cut: PlaneCut, equilibria: Sequence[Equilibrium] = ()
) -> QuadContourSet:
    """Draws contours of the effective potential on a plane, the body's section, and equilibria.

    The contour levels are quantiles of the potential over the plane, so they are dense where the
    field is flat, as near equilibria. The equilibria are named E1, E2, … in the given order. Those
    farther from the plane than a twentieth of its width are left out.

    Args:
      ax: the axes to draw on.
      cut: the potential on the plane.
      equilibria: the equilibria.

    Returns:
      The filled contours, for a colour bar.
    """
    length, unit = _plane_unit(cut)
    across, up = cut.across / length, cut.up / length
    quantiles = np.unique(np.quantile(cut.potential, np.linspace(0.0, 1.0, _LEVELS)))
    norm = BoundaryNorm(quantiles, 256)
    filled = ax.contourf(across, up, cut.potential, quantiles, cmap="cividis", norm=norm)
    thin = {"colors": "black", "linewidths": 0.3, "linestyles": "solid", "alpha": 0.5}
    ax.contour(across, up, cut.potential, quantiles, **thin)
    for point in equilibria:  # The contours through saddles separate the basins.
        if not point.inside and point.growing == 1:
            level = [point.potential]
            ax.contour(
                across, up, cut.potential, level, colors="white", linewidths=1.0,
                linestyles="solid",
            )  # fmt: skip
    if cut.inside.any():
        ax.contour(across, up, cut.inside, [0.5], colors="black", linewidths=2.0)
    columns = [AXES[letter] for letter in cut.plane]
    third = 3 - sum(columns)
    for number, point in enumerate(equilibria, start=1):
        if abs(point.position[third] - cut.offset) > 0.05 * np.ptp(cut.across):
            continue
        x, y = point.position[columns] / length
        colour = _MODES[min(point.growing, 2)][0]
        ax.plot(x, y, "o", color=colour, markeredgecolor="white", markersize=8, zorder=4)
        ax.annotate(
            f"E{number}", (x, y), (7, 7), textcoords="offset points", color="white",
            fontsize="medium", fontweight="bold", path_effects=_LABEL_EDGE, zorder=5,
        )  # fmt: skip
    ax.set_aspect("equal")
    ax.set_xlabel(_axis_label("+" + cut.plane[0], unit))
    ax.set_ylabel(_axis_label("+" + cut.plane[1], unit))
    return filled


def axis_vector(axis: str) -> np.ndarray:
    """Gives the unit vector (3,) of an axis such as "+x" or "-y"."""
    vector = np.zeros(3)
    vector[AXES[axis[1]]] = -1.0 if axis[0] == "-" else 1.0
    return vector


def _plane_unit(cut: PlaneCut) -> tuple[float, str]:
    return length_unit(float(np.ptp(cut.across)))


def _axis_label(axis: str, unit: str) -> str:
    return f"{axis[1]} ({unit})" if axis[0] == "+" else f"−{axis[1]} ({unit})"
