"""Draws where a body can be touched."""

from __future__ import annotations

import matplotlib as mpl
import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from scipy.spatial import KDTree

from proxops.diagrams.plots.shared_axes import length_unit
from proxops.diagrams.plots.surface_plots import VIEWS, axis_vector, draw_surface
from proxops.systems.common import Values
from proxops.systems.shapes import Polyhedron
from proxops.systems.touch import Sites

# Red where a place is beyond a limit.
_COLOURS = "RdYlGn_r"


def plot_sites(
    shape: Polyhedron, sites: Sites, worst: Values, best: Values, title: str = ""
) -> Figure:
    """Draws a map from all six sides, coloured by how near each place is to a limit.

    Args:
      shape: the map in K.
      sites: places that were measured; a facet has the colour of the nearest.
      worst: (N,) their greatest use of a limit.
      best: (K,) indices of the best places, which are numbered from 1.
      title: title of the figure; if empty, it is the shape's name.
    """
    figure = Figure(figsize=(12.0, 8.5), layout="constrained")
    middles = shape.vertices[shape.facets].mean(axis=1)
    values = np.minimum(worst, 2.0)[KDTree(sites.positions).query(middles)[1]]
    norm, length = Normalize(0.0, 2.0), length_unit(float(shape.extents.max()))[0]
    grid = figure.subplots(2, 3)
    for ax, view in zip(grid.flat, VIEWS, strict=True):
        draw_surface(ax, shape, values, view, _COLOURS, norm)
        ax.set_title(f"from {view}", fontsize="medium")
        right, up = (axis_vector(name) for name in VIEWS[view])
        for number, k in enumerate(best.tolist(), 1):
            if sites.normals[k] @ np.cross(right, up) > 0.0:
                x, y = sites.positions[k] @ right / length, sites.positions[k] @ up / length
                ax.plot(x, y, "o", color="black", markersize=4)
                ax.annotate(str(number), (x, y), (4, 4), textcoords="offset points", fontsize=8)
    mappable = ScalarMappable(norm, mpl.colormaps[_COLOURS])
    label = "greatest share of a limit; above 1 it cannot be touched"
    figure.colorbar(mappable, ax=list(grid.flat), label=label, fraction=0.03, pad=0.01)
    figure.suptitle(title or shape.name)
    return figure
