"""The record of a flight and its figures of merit.

Start with `FlightLog`: an xarray dataset that is enough to repeat the flight, kept as NetCDF-4.
`flight_summary` computes the figures of merit from it, `who_flew` says which controller flew each
step. A new column of the log is a line in `VARIABLES`.
"""

from proxops.diagrams.logs.flight_log import (
    DECISION_VARIABLES,
    VARIABLES,
    FlightLog,
    differences,
    make_dataset,
)
from proxops.diagrams.logs.flight_summary import (
    INTERVENTION_TOLERANCE,
    KEEP_OUT_TOLERANCE,
    WIDE_ARRIVAL,
    dense_positions,
    fallback_steps,
    length_text,
)
from proxops.diagrams.logs.who_flew import colour_of, name_of, those_who_fly, who_flies

__all__ = [
    "DECISION_VARIABLES",
    "INTERVENTION_TOLERANCE",
    "KEEP_OUT_TOLERANCE",
    "VARIABLES",
    "WIDE_ARRIVAL",
    "FlightLog",
    "colour_of",
    "dense_positions",
    "differences",
    "fallback_steps",
    "length_text",
    "make_dataset",
    "name_of",
    "those_who_fly",
    "who_flies",
]
