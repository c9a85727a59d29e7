"""Controllers flown on the same transits, with their table, figures and report.

Start with `fly_variants`, which flies any number of controllers and settings on one set of
transits, then read `aggregate_all` for the figures that are reported. A new figure goes into
`aggregate`, and its line of the table into `table`. `statistics_of_flights` has intervals
and bounds, and `sensitivity` ranks what drives failure.
"""

from proxops.studies.evaluation.evaluation import (
    EXPERT,
    aggregate_all,
    command_count,
    delta_v_pairs,
    without_flights,
)
from proxops.studies.evaluation.figures import Looks, controller_looks, draw_paths, plot_flights
from proxops.studies.evaluation.flights import describe_flight, shown_logs
from proxops.studies.evaluation.monte_carlo_report import driver_sections, write_worst
from proxops.studies.evaluation.report import Evaluation, evaluation_sections
from proxops.studies.evaluation.sensitivity import told_from_chance
from proxops.studies.evaluation.statistics_of_flights import exact_interval
from proxops.studies.evaluation.table import (
    arrival_text,
    figure_rows,
    outcome,
    successes_text,
)
from proxops.studies.evaluation.variants import (
    Variant,
    fly_logs,
    fly_variants,
    load_logs,
    variant_flights,
)

__all__ = [
    "EXPERT",
    "Evaluation",
    "Looks",
    "Variant",
    "aggregate_all",
    "arrival_text",
    "command_count",
    "controller_looks",
    "delta_v_pairs",
    "describe_flight",
    "draw_paths",
    "driver_sections",
    "evaluation_sections",
    "exact_interval",
    "figure_rows",
    "fly_logs",
    "fly_variants",
    "load_logs",
    "outcome",
    "plot_flights",
    "shown_logs",
    "successes_text",
    "told_from_chance",
    "variant_flights",
    "without_flights",
    "write_worst",
]
