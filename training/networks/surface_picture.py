"""Pictures of the surface that the pilot has learned, over the true mesh."""

from __future__ import annotations

import numpy as np
import torch
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from trimesh.intersections import mesh_plane

from proxops.diagrams.plots import length_unit
from proxops.diagrams.scenario import Body
from proxops.training.networks.geometry_layer import SurfaceField

_MESH, _LEARNED = "#b5aea4", "#d55e00"
# Number of points along the longer side of a cut.
_POINTS = 240


def plot_surface(field: SurfaceField, body: Body) -> Figure:
    """Plots the field's zero level and the mesh in three planes through the origin of K."""
    figure = Figure(figsize=(13.0, 4.0), layout="constrained")
    for ax, plane in zip(figure.subplots(1, 3), ("xy", "xz", "yz"), strict=True):
        plot_cut(ax, field, body, plane)
    figure.legend(
        handles=[
            Line2D([], [], color=_MESH, linewidth=5.0, label="mesh"),
            Line2D([], [], color=_LEARNED, label="learned: signed distance 0"),
        ],
        loc="outside lower center", ncols=2, frameon=False,
    )  # fmt: skip
    return figure


@torch.no_grad()
def plot_cut(ax: Axes, field: SurfaceField, body: Body, plane: str) -> None:
    """Plots the field's zero level and the mesh in one plane: "xy", "xz" or "yz"."""
    across, up = ("xyz".index(letter) for letter in plane)
    length, unit = length_unit(float(body.shape.extents.max()))
    normal = np.ones(3)
    normal[[across, up]] = 0.0
    segments = mesh_plane(body.shape.to_trimesh(), normal, np.zeros(3))
    flat = np.asarray(segments)[:, :, [across, up]] / length
    ax.add_collection(LineCollection(list(flat), colors=_MESH, linewidths=5.0))
    low, high = (field.centre - field.reach).numpy(), (field.centre + field.reach).numpy()
    spacing = float((high - low).max()) / _POINTS
    first, second = (np.arange(low[axis], high[axis], spacing) for axis in (across, up))
    points = np.zeros((len(second), len(first), 3), dtype=np.float32)
    points[..., across], points[..., up] = np.meshgrid(first, second)
    distance = field(torch.from_numpy(points))[..., 0].numpy()
    ax.contour(
        first / length, second / length, distance, levels=[0.0], colors=_LEARNED, linewidths=1.2
    )
    ax.set_aspect("equal")
    ax.set_xlabel(f"{plane[0]} ({unit})")
    ax.set_ylabel(f"{plane[1]} ({unit})")
    ax.grid(alpha=0.25)
