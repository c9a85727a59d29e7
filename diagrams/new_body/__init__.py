"""Setting up a new body: examine its mesh, draw what was found, write body and scenario files.

Start with `examine`, which `proxops shape` calls. `scaled_scenario` puts the default scenario into
the proportions of the new body.
"""

from proxops.diagrams.new_body.body_setup import body_yaml, scaled_scenario
from proxops.diagrams.new_body.shape_examination import examine
from proxops.diagrams.new_body.shape_picture import figure_rows, plot_shape
from proxops.diagrams.new_body.shape_report import Questions, ShapeReport

__all__ = [
    "Questions",
    "ShapeReport",
    "body_yaml",
    "examine",
    "figure_rows",
    "plot_shape",
    "scaled_scenario",
]
