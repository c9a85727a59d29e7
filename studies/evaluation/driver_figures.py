"""Figures of what drives failure, end error and Δv: rankings as bars, and the flights behind."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from proxops.diagrams.flight import Row
from proxops.studies.evaluation.sensitivity import (
    DUMMY,
    Column,
    Ranking,
    drawn_columns,
    told_from_chance,
)

OUTPUT_NAMES = {
    "failure": "failure",
    "terminal_position_error_m": "end error",
    "delta_v_m_s": "Δv",
}
"""What the outputs of a ranking are called."""
_BARS = 12
_SCATTERED = 4
_ABOVE, _CHANCE, _FAILED = "#0072b2", "#b8bec9", "#d55e00"
# On a logarithmic scale, smaller end errors (m) are drawn here.
_LEAST_ERROR = 0.1


def strongest(rankings: Mapping[str, Ranking]) -> list[str]:
    """Returns at most four quantities above chance, taken from the outputs' rankings in turns."""
    told = [told_from_chance(ranking) for ranking in rankings.values()]
    turns = range(max(map(len, told), default=0))
    names = [ranked[place] for place in turns for ranked in told if place < len(ranked)]
    return list(dict.fromkeys(names))[:_SCATTERED]


def plot_drivers(rankings: Mapping[str, Ranking]) -> Figure:
    """Draws the twelve strongest quantities of each output as bars, with their 90 % intervals.

    Bars of quantities that stand above chance are blue, the others grey. The hatched bar is the
    median of what chance gives, and the dashed line the greatest of it: see `rank_drivers`.

    Args:
      rankings: of `rank_drivers`; at least one is not empty.
    """
    shown = {output: ranking for output, ranking in rankings.items() if ranking}
    figure = Figure(figsize=(5.6 * len(shown), 4.6), layout="constrained")
    for axis, (output, ranking) in zip(
        figure.subplots(1, len(shown), squeeze=False)[0], shown.items(), strict=True
    ):
        [dummy] = [entry for entry in ranking if entry["quantity"] == DUMMY]
        bars = [entry for entry in ranking if entry is not dummy][: _BARS - 1]
        bars = sorted([*bars, dummy], key=lambda entry: entry["index"])
        indices = np.array([entry["index"] for entry in bars])
        ends = np.array([[entry["low"], entry["high"]] for entry in bars]).T
        drawn = axis.barh(
            ["chance" if entry is dummy else entry["quantity"] for entry in bars],
            indices,
            xerr=np.abs(ends - indices),
            color=[_ABOVE if entry["above_chance"] else _CHANCE for entry in bars],
            error_kw={"elinewidth": 0.8, "ecolor": "#566"},
        )
        drawn[bars.index(dummy)].set_hatch("///")
        axis.axvline(dummy["high"], color="#1d2430", linestyle="--", linewidth=1.0)
        axis.set_xlim(left=0.0)
        axis.tick_params(axis="y", labelsize="small")
        axis.set_xlabel("PAWN index")
        axis.set_title(OUTPUT_NAMES[output], fontsize="medium")
    return figure


def plot_scatter(rows: Sequence[Row], quantities: Sequence[str]) -> Figure:
    """Draws end error and Δv of all flights against quantities; crosses are failures.

    Args:
      rows: of the flights that were flown.
      quantities: names of `drawn_columns`, at least one.
    """
    columns = drawn_columns(rows)
    failed = np.array([not row["success"] for row in rows])
    errors = np.array([row["terminal_position_error_m"] for row in rows])
    delta_v = np.array([row["delta_v_m_s"] for row in rows])
    count = len(quantities)
    figure = Figure(figsize=(0.8 + 3.4 * count, 6.0), layout="constrained")
    grid = figure.subplots(2, count, squeeze=False, sharex="col", sharey="row")
    for across, name in enumerate(quantities):
        for axis, values in zip(
            grid[:, across], (np.maximum(errors, _LEAST_ERROR), delta_v), strict=True
        ):
            found = columns[name].values
            axis.plot(found[~failed], values[~failed], ".", color=_ABOVE, alpha=0.5, markersize=4)
            axis.plot(found[failed], values[failed], "x", color=_FAILED, markersize=5)
            axis.grid(alpha=0.25)
        _name_values(grid[1, across], columns[name])
        grid[1, across].set_xlabel(name, fontsize="small")
    grid[0, 0].set_yscale("log")
    grid[0, 0].set_ylabel("end error (m)")
    grid[1, 0].set_ylabel("Δv (m/s)")
    return figure


def _name_values(axis: Axes, column: Column) -> None:
    if column.labels:
        axis.set_xticks(range(len(column.labels)), column.labels, fontsize="small")
