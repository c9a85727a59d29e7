"""Controllers flown on the same transits, their table, figures and report.

Start with `fly_controllers`, which `proxops evaluate` calls, then `evaluation` for the figures that
are reported.
"""

from proxops.studies.evaluation.evaluation import EXPERT, aggregate, delta_v_pairs
from proxops.studies.evaluation.figures import Looks, controller_looks, draw_paths, plot_flights
from proxops.studies.evaluation.flights import fly_controllers, shown_logs
from proxops.studies.evaluation.report import Evaluation, evaluation_sections
from proxops.studies.evaluation.table import arrival_text, figure_rows, outcome

__all__ = [
    "EXPERT",
    "Evaluation",
    "Looks",
    "aggregate",
    "arrival_text",
    "controller_looks",
    "delta_v_pairs",
    "draw_paths",
    "evaluation_sections",
    "figure_rows",
    "fly_controllers",
    "outcome",
    "plot_flights",
    "shown_logs",
]
