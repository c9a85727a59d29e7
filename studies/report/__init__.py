"""What studies show: the report of an evaluation, and the figures that all reports share.

Start with `evaluation_sections`, which makes the report of `proxops evaluate` for
`proxops.training.reports.write_report`. `shown_logs` gives the flights that a report looks into,
and `write_worst` their replays. A new figure goes into `plots`.
"""

from proxops.studies.report.evaluation_report import (
    Evaluation,
    driver_blocks,
    evaluation_sections,
    figure_table,
    success_text,
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
from proxops.studies.report.shown_flights import outcome, shown_logs, write_worst

__all__ = [
    "BLACK",
    "BLUE",
    "GOAL",
    "ORANGE",
    "Evaluation",
    "Looks",
    "add_legend",
    "controller_looks",
    "draw_paths",
    "driver_blocks",
    "evaluation_sections",
    "figure_table",
    "label_axis",
    "new_figure",
    "outcome",
    "path_handles",
    "plot_flights",
    "shown_logs",
    "success_text",
    "write_worst",
]
