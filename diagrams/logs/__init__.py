"""The record of a flight and its figures of merit.

Start with `FlightLog`: an xarray dataset that is enough to repeat the flight, stored as NetCDF-4.
`flight_summary` computes the figures of merit from it, and `navigation_figures` those of its
navigation; `legend` tells which controller flew each step, and why the safety
filter intervened. To add a column to the log, add a line to `VARIABLES` in `columns`.
"""

from proxops.diagrams.logs.attitude_figures import pointing_errors
from proxops.diagrams.logs.columns import (
    CONTROLLER_COLUMNS,
    NAVIGATION_COLUMNS,
    RECORDS,
    RESERVED_COLUMNS,
    SURVEY,
    VARIABLES,
    column_size,
)
from proxops.diagrams.logs.flight_log import (
    FlightLog,
    commanded_forces,
    differences,
    make_dataset,
    with_survey,
)
from proxops.diagrams.logs.flight_summary import (
    WIDE_ARRIVAL,
    dense_positions,
    fallback_steps,
    outcome,
)
from proxops.diagrams.logs.legend import (
    LEGEND,
    REASONS,
    all_flown_by,
    flown_by,
    legend_of,
    legend_text,
)
from proxops.diagrams.logs.lengths import length_text, three_digits
from proxops.diagrams.logs.log_file_checks import check_log_file
from proxops.diagrams.logs.navigation_figures import navigation_errors, why_never_known

__all__ = [
    "CONTROLLER_COLUMNS",
    "LEGEND",
    "NAVIGATION_COLUMNS",
    "REASONS",
    "RECORDS",
    "RESERVED_COLUMNS",
    "SURVEY",
    "VARIABLES",
    "WIDE_ARRIVAL",
    "FlightLog",
    "all_flown_by",
    "check_log_file",
    "column_size",
    "commanded_forces",
    "dense_positions",
    "differences",
    "fallback_steps",
    "flown_by",
    "legend_of",
    "legend_text",
    "length_text",
    "make_dataset",
    "navigation_errors",
    "outcome",
    "pointing_errors",
    "three_digits",
    "why_never_known",
    "with_survey",
]
