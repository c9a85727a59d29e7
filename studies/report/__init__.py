"""What studies show: the report of an evaluation, and the figures that all reports share.

Start with `write_evaluation`, which writes the report of `proxops evaluate` from `driver_blocks`
and others like it. A new figure goes into `plots`, and its section into `evaluation_report`.
`write_survey_report` writes that of `proxops survey`.
"""

from proxops.studies.report.evaluation_report import (
    driver_blocks,
    figure_blocks,
    success_text,
    write_evaluation,
)
from proxops.studies.report.plots import (
    BLACK,
    BLUE,
    GOAL,
    ORANGE,
    Looks,
    add_legend,
    controller_looks,
    draw_paths,
    label_axis,
    new_figure,
    path_handles,
    plot_flights,
)
from proxops.studies.report.shown_flights import may_be_shown
from proxops.studies.report.survey_report import (
    plot_over_surface,
    write_survey_film,
    write_survey_report,
)

__all__ = [
    "BLACK",
    "BLUE",
    "GOAL",
    "ORANGE",
    "Looks",
    "add_legend",
    "controller_looks",
    "draw_paths",
    "driver_blocks",
    "figure_blocks",
    "label_axis",
    "may_be_shown",
    "new_figure",
    "path_handles",
    "plot_flights",
    "plot_over_surface",
    "success_text",
    "write_evaluation",
    "write_survey_film",
    "write_survey_report",
]
