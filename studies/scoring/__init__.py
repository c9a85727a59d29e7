"""The benchmark that stays the same: tracks of transits that are fixed, and rows of what they gave.

Start with `load_track` and `score`, which flies a controller over a track and gives its row.
`row_table` makes the table of rows. `draw_track` makes a track of one's own, and `with_expert`
tells it what the MPC took.
"""

from proxops.studies.scoring.row import (
    ScoreRow,
    load_row,
    row_table,
    save_row,
    score,
    with_expert,
)
from proxops.studies.scoring.track import TRACKS, Track, draw_track, load_track, save_track

__all__ = [
    "TRACKS",
    "ScoreRow",
    "Track",
    "draw_track",
    "load_row",
    "load_track",
    "row_table",
    "save_row",
    "save_track",
    "score",
    "with_expert",
]
