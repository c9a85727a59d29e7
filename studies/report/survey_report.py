"""The report of a survey: what it saw, its residuals, and what is uncertain where."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d.art3d import Poly3DCollection
from scipy.spatial import KDTree

from proxops.diagrams.meshcat import write_frames
from proxops.diagrams.surveys import Surveyed
from proxops.studies.report.plots import BLACK, BLUE, ORANGE, label_axis, new_figure
from proxops.systems.common import Values, Vectors3
from proxops.training.reports import Section, Table, Text, picture, write_report

# Returns whose residuals are drawn, at most.
_MOST = 60_000


def write_survey_report(
    out: Path, title: str, surveyed: Surveyed, rows: list[tuple[str, str]]
) -> None:
    """Writes the report of a survey into a folder, as HTML and as Markdown.

    Args:
      surveyed: what `run_survey` gave. rows: names and texts of the figures to show.
    """
    figures, sure = surveyed.figures, surveyed.uncertainty
    seen = f"{figures['covered']:.2%} of the surface has returns."
    blocks = [
        Text(
            "What is compared with the truth is for the reader: nobody on board has it. The map is "
            "compared after one rigid motion, at points all over its surface."
        ),
        Table(("", "found", "error", "1 sigma"), _found(figures)),
        Table(("", "value"), rows),
    ]
    world = surveyed.flight.world
    if world.scenario.dispersed:
        ratio = world.true_body.gravity_field.mass / world.body.gravity_field.mass
        name = world.body.config.name
        told = f"The world was drawn: its true mass is {ratio:.3g} times that of {name}."
        blocks.insert(0, Text(told))
    shape = surveyed.made.shape
    coverage = plot_over_surface(
        shape.vertices, np.log10(np.maximum(sure.counts, 1.0)), "returns, as log10"
    )
    size = float(shape.extents.max())
    said = plot_over_surface(
        shape.vertices, 100.0 * sure.deviations / size, "standard deviation, % of the size"
    )
    sections = [
        Section("Figures", blocks),
        Section("What was seen", [picture("coverage", coverage, seen)]),
        Section(
            "Residuals",
            [
                picture(
                    "residuals",
                    plot_residuals(surveyed),
                    "Left: residuals of the returns over the standard deviation that is expected, "
                    "and the normal distribution. Right: their root mean square over time.",
                )
            ],
        ),
        Section(
            "What is uncertain where",
            [
                picture("uncertainty", said, "What the survey itself says of its map."),
                picture(
                    "errors",
                    plot_errors(surveyed.errors, surveyed.deviations),
                    "The map's errors over the standard deviations that the survey says.",
                ),
            ],
        ),
    ]
    write_report(out, title, sections)


def _found(figures: dict[str, Any]) -> list[tuple[str, str, str, str]]:
    """What the survey found, how far it is from the truth, and how far it may be as it says."""

    def share(name: str) -> str:
        return f"{figures[name]:.2%}"

    period, error = figures["rotation_period_h"], figures["rate_error"]
    length, shares = figures["length_m"], ("map_rms_of_size", "deviation_of_size")
    rms, said = (f"{figures[name] * length:.3g} m, rms" for name in shares)
    return [
        (
            "mass", f"{figures['mass_kg']:.5g} kg",
            share("gravity_error"), share("gravity_deviation"),
        ),
        (
            "rotation period", f"{period:.7g} h",
            f"{-error / (1.0 + error):.1e}", f"{figures['rate_deviation']:.1e}",
        ),
        ("greatest length", f"{length:.5g} m", share("length_error"), ""),
        ("surface", "map.obj", rms, said),
    ]  # fmt: skip


def plot_over_surface(vertices: Vectors3, values: Values, label: str) -> Figure:
    """Draws values (V,) at vertices (V, 3) over longitude and latitude."""
    figure = new_figure(8.0, 3.6)
    axis = figure.add_subplot()
    longitude = np.degrees(np.arctan2(vertices[:, 1], vertices[:, 0]))
    latitude = np.degrees(np.arctan2(vertices[:, 2], np.hypot(vertices[:, 0], vertices[:, 1])))
    dots = axis.scatter(longitude, latitude, c=values, s=4.0, cmap="viridis", linewidths=0.0)
    label_axis(axis, "longitude (degrees)", "latitude (degrees)")
    figure.colorbar(dots, ax=axis, label=label)
    return figure


def plot_residuals(surveyed: Surveyed) -> Figure:
    """Draws the distribution of the residuals, and their size over time."""
    solution, returns = surveyed.found.solution, surveyed.found.returns
    ratio = solution.residuals / solution.deviations
    figure = new_figure(8.0, 3.2)
    left, right = figure.subplots(1, 2)
    some = ratio[:: -(-len(ratio) // _MOST)]
    _beside_normal(left, some, "residual / standard deviation")
    hours = returns.times[returns.frames] / 3600.0
    edges = np.linspace(hours[0], hours[-1], 49)
    cell = np.clip(np.digitize(hours, edges) - 1, 0, 47)
    # False returns would hide the others.
    squares = np.bincount(cell, np.minimum(ratio**2, 16.0), 48)
    rms = np.sqrt(squares / np.maximum(np.bincount(cell, minlength=48), 1))
    right.plot(0.5 * (edges[1:] + edges[:-1]), rms, color=ORANGE)
    right.set_ylim(0.0, None)
    label_axis(right, "time (h)", "rms of residual / standard deviation")
    return figure


def plot_errors(errors: Values, deviations: Values) -> Figure:
    """Draws the distribution of errors (K,) over their standard deviations (K,)."""
    figure = new_figure(8.0, 2.8)
    _beside_normal(figure.add_subplot(), errors / deviations, "error / standard deviation")
    return figure


def write_survey_film(path: Path, surveyed: Surveyed, frames: int = 60) -> None:
    """Writes a film of the map as it grows: a facet is there once all its corners were seen.

    Args:
      path: of a WebP, a GIF or an MP4. frames: their number; there are ten a second.

    Raises:
      InputError: see `write_frames`.
    """
    made, returns = surveyed.made, surveyed.found.returns
    shape, seen = made.shape, first_seen(surveyed)
    appears = seen[shape.facets].max(axis=1)
    half = 0.5 * float(shape.extents.max())
    sides, drawn = shape.vertices[shape.facets], []
    for k in range(frames):
        # It is whole for the last fifth of the film.
        share = min(k / (0.8 * (frames - 1)), 1.0)
        time = returns.times[0] + share * (returns.times[-1] - returns.times[0])
        there, azimuth = appears <= time, 360.0 * k / frames - 90.0
        # From above the camera, and beside it.
        lamp = np.array([*np.sqrt(0.5) * _around(azimuth + 40.0), np.sqrt(0.5)])
        light = 0.3 + 0.7 * np.clip(shape.normals[there] @ lamp, 0.0, 1.0)
        figure = new_figure(6.4, 4.0)
        axis = figure.add_subplot(projection="3d", computed_zorder=False)
        colours = light[:, None] * [0.86, 0.81, 0.74]
        facets = Poly3DCollection(sides[there], facecolors=colours, edgecolors=colours)
        facets.set_clip_on(False)  # The picture is wider than the axes.
        axis.add_collection3d(facets)
        axis.set(xlim=(-half, half), ylim=(-half, half), zlim=(-half, half))
        axis.set_box_aspect((1.0, 1.0, 1.0), zoom=2)
        axis.set_axis_off()
        axis.view_init(elev=20.0, azim=azimuth)
        hours = (time - returns.times[0]) / 3600.0
        axis.set_title(f"{hours:.1f} h in orbit, {np.mean(seen <= time):.0%} of the map")
        picture = io.BytesIO()
        figure.savefig(picture, format="jpeg", dpi=100)
        drawn.append(picture.getvalue())
    write_frames(drawn, path, 10.0)


def _around(azimuth: float) -> np.ndarray:
    """The unit vector (2,) at an angle in degrees."""
    return np.array([np.cos(np.radians(azimuth)), np.sin(np.radians(azimuth))])


def first_seen(surveyed: Surveyed) -> Values:
    """When returns first fell next to each vertex of a survey's map (V,), in s; inf: never.

    A return belongs to the vertex that is nearest to it.
    """
    made, found = surveyed.made, surveyed.found
    points = (found.survey.placed(found.returns).points - made.centre) @ made.rotation.T
    _, nearest = KDTree(made.shape.vertices).query(points)
    seen = np.full(len(made.shape.vertices), np.inf)
    np.minimum.at(seen, nearest, found.returns.times[found.returns.frames])
    return seen


def _beside_normal(axis: Axes, ratios: Values, label: str) -> None:
    """Draws the distribution of ratios (K,), and the normal distribution."""
    axis.hist(ratios, bins=80, range=(-4.0, 4.0), density=True, color=BLUE, alpha=0.6)
    across = np.linspace(-4.0, 4.0, 200)
    axis.plot(across, np.exp(-0.5 * across**2) / np.sqrt(2.0 * np.pi), color=BLACK)
    label_axis(axis, label, "density")
