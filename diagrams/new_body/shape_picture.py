"""Draws the findings about a mesh as one figure."""

from __future__ import annotations

import math

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Ellipse

from proxops.diagrams.new_body.shape_report import SLIVER_ANGLE, ShapeReport, spin_axis_error
from proxops.diagrams.plots import frame_plane, length_unit
from proxops.systems.gravity import AXES
from proxops.systems.shapes import RayCaster, Surface

_BODY = np.array([0.71, 0.68, 0.64])
_DEFECT = np.array([0.85, 0.10, 0.10])
# Pixels of a view along a side.
_PIXELS = 700
# Most facets with defects that are outlined.
_MOST_OUTLINED = 5000
_KEEP_OUT, _SYNCHRONOUS = "#5577bb", "#128a3a"
_PRINCIPAL = ("#7a3fa0", "#c07a1f", "#1f8a9a")


def plot_shape(report: ShapeReport) -> Figure:
    """Draws three views, the hover map, the facets' angles and a table of figures on one page."""
    figure = Figure(figsize=(13.5, 9.0), layout="constrained")
    grid = figure.subplots(2, 3)
    for ax, plane in zip(grid[0], ("xy", "xz", "yz"), strict=True):
        plot_view(ax, report, plane)
    draw_hover_map(grid[1, 0], report)
    plot_angles(grid[1, 1], report)
    _write_figures(grid[1, 2], report)
    figure.legend(handles=_legend(report), loc="outside lower center", ncols=7, frameon=False)
    verdict = "sound" if report.sound else "; ".join(d.kind for d in report.defects)
    figure.suptitle(f"{report.file.name}: {verdict}")
    return figure


def plot_view(ax: Axes, report: ShapeReport, plane: str = "xy") -> None:
    """Draws the mesh seen along an axis; facets with defects are red.

    It adds the outline of the keep-out ellipsoid, the principal axes and, for the plane "xy", the
    synchronous radius. The origin is the centre of mass.

    Args:
      ax: the axes to draw on.
      report: the findings.
      plane: "xy", "xz" or "yz".
    """
    across, up = (AXES[letter] for letter in plane)
    depth = 3 - across - up
    sign = -1.0 if plane == "xz" else 1.0  # The view is from -y, so that x points to the right.
    length, unit = _unit(report)
    facets = _drawable(report)
    centre = np.zeros(3) if report.solid is None else report.solid.centre_of_mass
    corners = (report.file.vertices[report.file.facets[facets]] - centre) / length
    reach = float(np.abs(corners).max()) if corners.size else 1.0
    marked = _marked(report)[facets]
    if corners.size:
        image = _seen(corners, marked, (across, up, depth), sign, reach)
        extent = (-reach, reach, -reach, reach)
        ax.imshow(image, extent=extent, origin="lower", aspect="equal", zorder=0.5)
    # A pixel may miss a small facet.
    shown = np.flatnonzero(marked)[:_MOST_OUTLINED]
    outlines = list(corners[shown][:, :, [across, up]])
    ax.add_collection(
        PolyCollection(outlines, facecolors="none", edgecolors=_DEFECT, linewidths=0.3)
    )
    if report.keep_out is not None and report.solid is not None:
        axes = report.keep_out.semi_axes / length
        outline = Ellipse(
            (0.0, 0.0), 2.0 * axes[across], 2.0 * axes[up],
            fill=False, edgecolor=_KEEP_OUT, linestyle="--", linewidth=1.2,
        )  # fmt: skip
        ax.add_patch(outline)
        reach = max(reach, float(axes.max()))
        for axis, colour in zip(report.solid.principal_axes, _PRINCIPAL, strict=True):
            ends = 0.9 * reach * np.outer([-1.0, 1.0], axis)
            ax.plot(ends[:, across], ends[:, up], color=colour, linewidth=1.0)
    synchronous = report.synchronous_radius
    if synchronous is not None and plane == "xy":
        radius = synchronous / length
        ax.add_patch(Circle((0.0, 0.0), radius, fill=False, edgecolor=_SYNCHRONOUS, linestyle=":"))
        reach = max(reach, min(radius, 2.0 * reach))
    frame_plane(ax, plane, unit, 1.05 * reach)


def _seen(
    corners: np.ndarray,
    marked: np.ndarray,
    axes: tuple[int, int, int],
    sign: float,
    reach: float,
) -> np.ndarray:
    """The picture (n, n, 4) of facets with corners (F, 3, 3), seen along the last of the axes.

    Parallel rays, so that a picture of a million facets takes no longer than one of a thousand.
    """
    across, up, depth = axes
    caster = RayCaster(Surface(corners.reshape(-1, 3), np.arange(corners.size // 3).reshape(-1, 3)))
    middles = ((np.arange(_PIXELS) + 0.5) / _PIXELS * 2.0 - 1.0) * reach
    origins = np.empty((_PIXELS, _PIXELS, 3))
    origins[:, :, across], origins[:, :, up] = middles[None, :], middles[:, None]
    origins[:, :, depth] = sign * 2.0 * reach
    directions = np.zeros((_PIXELS**2, 3))
    directions[:, depth] = -sign
    met = caster.first_hits(origins.reshape(-1, 3), directions).facets
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    sizes = np.linalg.norm(normals, axis=1)
    light = 0.45 + 0.55 * np.abs(normals[:, depth]) / np.where(sizes > 0.0, sizes, 1.0)
    colours = np.where(marked[:, None], _DEFECT, _BODY) * light[:, None]
    image = np.zeros((_PIXELS**2, 4))
    image[met >= 0, :3], image[met >= 0, 3] = colours[met[met >= 0]], 1.0
    return image.reshape(_PIXELS, _PIXELS, 4)


def draw_hover_map(ax: Axes, report: ShapeReport) -> None:
    """Draws the greatest force per axis that hovering over the keep-out ellipsoid takes."""
    hover = report.hover
    ax.set_title("hover force per axis, over the keep-out", fontsize="medium")
    if hover is None:
        why = "needs a sound mesh, mass and period"
        ax.text(0.5, 0.5, why, ha="center", va="center", transform=ax.transAxes)
        ax.set_axis_off()
        return
    millinewtons = hover.forces.max() < 0.5
    factor, unit = (1e3, "mN") if millinewtons else (1.0, "N")
    drawn = ax.contourf(hover.longitudes, hover.latitudes, hover.forces * factor, levels=14)
    figure = ax.get_figure()
    if figure is not None:
        label = f"{unit}, {hover.craft_mass_kg:g} kg"
        figure.colorbar(drawn, ax=ax, label=label, fraction=0.05, pad=0.02)
    ax.set_xticks(np.arange(-180, 181, 60))
    ax.set_yticks(np.arange(-90, 91, 30))
    ax.set_xlabel("longitude (degrees)")
    ax.set_ylabel("latitude (degrees)")


def plot_angles(ax: Axes, report: ShapeReport) -> None:
    """Draws a histogram of the smallest angle of each facet."""
    ax.set_title("smallest angle of each facet", fontsize="medium")
    if report.angles.size:
        ax.hist(report.angles, bins=60, range=(0.0, 60.0), color="#8899bb")
        ax.set_yscale("symlog")
    ax.axvline(SLIVER_ANGLE, color="#b03030", linestyle="--", linewidth=1.0)
    ax.set_xlabel("degrees")
    ax.set_ylabel("facets")
    ax.grid(alpha=0.25)


def figure_rows(report: ShapeReport) -> list[tuple[str, str]]:
    """Gives the figures of a report as rows (name, value) of a table."""
    length, unit = _unit(report)

    def lengths(values: np.ndarray) -> str:
        return " × ".join(f"{value / length:.5g}" for value in values) + f" {unit}"

    file, solid, keep_out = report.file, report.solid, report.keep_out
    rows = [
        ("mesh", f"{len(file.vertices)} vertices, {len(file.facets)} facets, in {file.unit}"),
        ("smallest angle", f"{report.angles.min():.3g}°" if report.angles.size else "–"),
        ("slivers", f"{report.slivers} below {SLIVER_ANGLE:g}°"),
    ]
    if report.shells is not None:
        rows.append(("shells", str(report.shells)))
    if report.crossings is not None:
        rows.append(("facets that cut each other", f"{len(report.crossings)} pairs"))
    if solid is not None and keep_out is not None:
        moments = solid.principal_moments / solid.principal_moments.max()
        size = np.ptp(file.vertices, axis=0).max()
        over = keep_out.volume_over_bound - 1.0
        rows += [
            ("extents", lengths(np.ptp(file.vertices, axis=0))),
            ("volume", f"{solid.volume / length**3:.5g} {unit}³"),
            (
                "diameter as a sphere",
                f"{solid.equivalent_diameter / length:.5g} {unit}",
            ),
            ("centre of mass", f"{_vector(solid.centre_of_mass, size)} m"),
            ("principal moments", " : ".join(f"{m:.4f}" for m in moments)),
            ("z off the greatest", f"{spin_axis_error(solid):.2f}°"),
            (f"keep-out, margin {100 * keep_out.margin:g} %", lengths(keep_out.semi_axes)),
            (
                "vertex nearest to it",
                f"{keep_out.farthest}, at {100.0 * math.sqrt(keep_out.level):.4f} % of its radius",
            ),
            ("keep-out, volume over the least", f"{100.0 * max(over, 0.0):.1g} %"),
        ]
    if report.mass is not None and report.density is not None:
        rows += [("mass", f"{report.mass:.5g} kg"), ("density", f"{report.density:.5g} kg/m³")]
    if report.synchronous_radius is not None:
        rows.append(("synchronous radius", f"{report.synchronous_radius / length:.5g} {unit}"))
    if report.hover is not None:
        low, high = report.hover.forces.min(), report.hover.forces.max()
        mass = f"{report.hover.craft_mass_kg:g} kg"
        rows.append((f"hover on keep-out, {mass}", f"{low:.3g} to {high:.3g} N"))
    return rows


def _write_figures(ax: Axes, report: ShapeReport) -> None:
    ax.set_axis_off()
    rows = figure_rows(report)
    text = "\n".join(f"{name + ':':<28}{value}" for name, value in rows)
    for defect in report.defects:
        text += f"\n\n{defect.about()}"
    for remark in report.remarks:
        text += f"\n\nnote: {remark}"
    ax.text(
        -0.1, 1.0, text, family="monospace", fontsize=6.8, va="top", wrap=True,
        transform=ax.transAxes,
    )  # fmt: skip


def _vector(values: np.ndarray, size: float) -> str:
    """Writes three numbers; those below the rounding error for a body of this size become 0."""
    return ", ".join(f"{0.0 if abs(value) < 1e-12 * size else value:.4g}" for value in values)


def _unit(report: ShapeReport) -> tuple[float, str]:
    finite = report.file.vertices[np.isfinite(report.file.vertices).all(axis=1)]
    size = float(np.ptp(finite, axis=0).max()) if len(finite) else 1.0
    return length_unit(size)


def _drawable(report: ShapeReport) -> np.ndarray:
    """Gives the indices of the facets whose three vertices exist and are finite."""
    vertices, facets = report.file.vertices, report.file.facets
    there = np.all((facets >= 0) & (facets < len(vertices)), axis=1)
    finite = np.all(np.isfinite(vertices), axis=1)
    there[there] = np.all(finite[facets[there]], axis=1)
    return np.flatnonzero(there)


def _marked(report: ShapeReport) -> np.ndarray:
    """Marks the facets (F,) to draw red: those that a defect names and that can be drawn."""
    marked = np.zeros(len(report.file.facets), dtype=bool)
    for defect in report.defects:
        if defect.kind == "duplicate vertices":
            marked |= np.isin(report.file.facets, defect.facets).any(axis=1)
        elif defect.kind not in ("not finite", "no such vertex"):
            marked[defect.facets] = True
    return marked


def _legend(report: ShapeReport) -> list[Line2D]:
    handles = []
    if report.keep_out is not None:
        handles.append(Line2D([], [], color=_KEEP_OUT, linestyle="--", label="keep-out ellipsoid"))
        for colour, name in zip(_PRINCIPAL, ("least", "middle", "greatest"), strict=True):
            handles.append(Line2D([], [], color=colour, label=f"axis of {name} moment"))
    if report.synchronous_radius is not None:
        label = "synchronous radius"
        handles.append(Line2D([], [], color=_SYNCHRONOUS, linestyle=":", label=label))
    if _marked(report).any():
        handles.append(
            Line2D([], [], color=_DEFECT.tolist(), marker="s", linestyle="", label="defect")
        )
    return handles
