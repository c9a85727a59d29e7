"""The setup of a new body: examine its mesh, draw the findings, write body and scenario files.

Start with `examine`, which `proxops shape` calls. `scaled_scenario` scales the default scenario to
the size, gravity and spin of the new body; `scenario_in_proportion` scales it by given factors.
`write_generated_body` writes the files of a generated body.
"""

from proxops.diagrams.new_body.body_setup import (
    body_yaml,
    scaled_scenario,
    scenario_in_proportion,
)
from proxops.diagrams.new_body.generated_body import write_generated_body
from proxops.diagrams.new_body.shape_examination import examine, hover_map
from proxops.diagrams.new_body.shape_picture import figure_rows, plot_shape
from proxops.diagrams.new_body.shape_report import Questions, ShapeReport

__all__ = [
    "Questions",
    "ShapeReport",
    "body_yaml",
    "examine",
    "figure_rows",
    "hover_map",
    "plot_shape",
    "scaled_scenario",
    "scenario_in_proportion",
    "write_generated_body",
]
