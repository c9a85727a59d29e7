"""Figures of flights, bodies and plans, drawn with matplotlib.

Start with `plot_flight`, an overview of one flight. Each module draws one kind of figure and
returns it; no module writes files.
"""

from proxops.diagrams.plots.attitude_plot import plot_attitude
from proxops.diagrams.plots.decision_plot import plot_decisions
from proxops.diagrams.plots.diagram_drawing import diagram_picture
from proxops.diagrams.plots.flight_plot import (
    draw_body,
    plot_clearance,
    plot_distance,
    plot_flight,
    plot_path,
)
from proxops.diagrams.plots.frame_plot import plot_frame, plot_ranges
from proxops.diagrams.plots.hover_plot import plot_hover
from proxops.diagrams.plots.navigation_plot import plot_navigation
from proxops.diagrams.plots.plan_plot import plot_plan
from proxops.diagrams.plots.shared_axes import frame_plane, length_unit
from proxops.diagrams.plots.site_plot import plot_sites
from proxops.diagrams.plots.surface_plots import plot_equilibria, plot_surface_maps
from proxops.diagrams.plots.transit_picture import TransitPicture
from proxops.diagrams.plots.truth_plot import plot_truth

__all__ = [
    "TransitPicture",
    "diagram_picture",
    "draw_body",
    "frame_plane",
    "length_unit",
    "plot_attitude",
    "plot_clearance",
    "plot_decisions",
    "plot_distance",
    "plot_equilibria",
    "plot_flight",
    "plot_frame",
    "plot_hover",
    "plot_navigation",
    "plot_path",
    "plot_plan",
    "plot_ranges",
    "plot_sites",
    "plot_surface_maps",
    "plot_truth",
]
