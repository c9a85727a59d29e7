"""Statistics of flights: what the flights of a controller show, and how sure that is.

Start with `Result`, which has a field for each figure that is reported: how it is made from rows,
and how a table shows it. A new figure is one field. `aggregate_all` makes the results of several
controllers; `rank_drivers` finds what drives failure, and `exact_interval` says how sure a share
is.
"""

from proxops.studies.figures.intervals import exact_interval
from proxops.studies.figures.results import (
    EXPERT,
    FigureRow,
    Result,
    Results,
    aggregate_all,
    arrival_text,
    command_count,
    delta_v_pairs,
    figure_rows,
    results_from_json,
)
from proxops.studies.figures.sensitivity import (
    DUMMY,
    LEAST_FLIGHTS,
    Column,
    Ranking,
    drawn_columns,
    told_from_chance,
)

__all__ = [
    "DUMMY",
    "EXPERT",
    "LEAST_FLIGHTS",
    "Column",
    "FigureRow",
    "Ranking",
    "Result",
    "Results",
    "aggregate_all",
    "arrival_text",
    "command_count",
    "delta_v_pairs",
    "drawn_columns",
    "exact_interval",
    "figure_rows",
    "results_from_json",
    "told_from_chance",
]
