"""What drives failure, end error and Δv: the dispersed quantities, or the transit itself.

It is found from the flights as they were flown. The transits are drawn as the world is, so what a
transit asks for is ranked beside the dispersed quantities: distance, and clearances. Where the
transit drives an output, it is told so, and the dispersions that do less are seen to do less.

The index is PAWN (F. Pianosi and T. Wagener, Environmental Modelling & Software 108 (2018) 197):
the flights are cut into ten slices of equal size by the quantity, and the index is the mean over
slices of the Kolmogorov-Smirnov distance between the output's distribution in a slice and in all
flights. It needs no flights of its own, sees only the order of the values, and takes a 0/1 output
such as failure: there it is the mean distance between a slice's share of failures and that of all.

It was chosen over `SALib.analyze.delta` on known cases: with 200 flights of which 5 % fail for one
of 30 quantities, it names the cause in 12 of 12 sets; delta, which estimates densities, in none of
4. PAWN's mean over slices is used, because its median overlooks failures at one end of a quantity.
Neither sees a pure interaction, where two quantities matter only together and none alone.

No index is zero by chance, and of thirty quantities without effect the greatest index is well above
the usual one. So the outcomes are shuffled among the flights, which leaves no quantity an effect,
and the greatest index of all quantities is kept, 19 times. A quantity stands above chance if its
index exceeds all 19: where nothing has an effect, the greatest of 20 equals is the true one in one
case of 20, so one ranking in 20 at most (5 %) names anything, however many quantities there are
(P. H. Westfall and S. S. Young, Resampling-Based Multiple Testing, Wiley 1993, section 2.6). A
controller has up to three rankings, one of each outcome, and each has its own 5 %.

The 90 % interval of an index says how much it would vary with other flights: it is the index plus
and minus 1.645 standard deviations of the index over 20 resamples of the flights, drawn with
replacement. It does not say whether the index is above chance.
"""

from __future__ import annotations

import dataclasses as dc
import typing
from collections.abc import Sequence

import numpy as np

from proxops.diagrams.flight import Row
from proxops.systems.common import generator

OUTPUTS = ("failure", "terminal_position_error_m", "touch_miss_m", "delta_v_m_s")
"""What is explained: failure as 0 or 1, the end error of all flights, the miss of those that
touched, and Δv of those that succeeded."""
DUMMY = "dummy"
"""Name of the entry in a ranking that says how great an index is by chance."""
TRANSIT = (
    "transit_distance_m",
    "transit_start_clearance_m",
    "transit_goal_clearance_m",
    "transit_line_clearance_m",
)
"""What is ranked of the transit; see `proxops.diagrams.logs.FlightLog.summary`."""
_SURVEY = (
    "survey_map_rms_of_size",
    "survey_gravity_error",
    "survey_pole_error_deg",
    "survey_rate_error",
    "survey_hours",
)
LEAST_FLIGHTS = 50
"""With fewer flights, nothing is ranked."""
# The greatest of 20 equals is the true one in 5 % of the cases.
_SHUFFLES = 19
_SLICES = 10
_RESAMPLES = 20
# Standard deviations of a normal distribution that hold 90 %.
_NINETY = 1.645
# Indices that are equal may differ by rounding, which is less than this.
_ROUNDING = 1e-9


@dc.dataclass(frozen=True)
class Ranked:
    """A quantity of a ranking."""

    quantity: str
    index: float
    low: float
    """With `high`: the 90 % interval of the index, by 20 resamples of the flights."""
    high: float
    above_chance: bool
    """Whether the index exceeds the greatest of any quantity in each of 19 shuffles."""


Ranking = list[Ranked]


@dc.dataclass(frozen=True)
class Column:
    """What was drawn of one quantity."""

    values: np.ndarray
    """(N,), one for each flight; codes 0, 1, … if `labels` is not empty."""
    labels: tuple[str, ...] = ()
    """The texts that the codes stand for."""


def rank_drivers(rows: Sequence[Row]) -> dict[str, Ranking]:
    """Ranks the dispersed quantities and those of the transit by what they do to each output.

    Equal rows give equal rankings: shuffles and resamples depend on the rows' seed and number.

    Args:
      rows: of the flights that were flown, with what was `dispersed`.

    Returns:
      By output, from the strongest. `DUMMY` is an entry of its own with the greatest indices of 19
      shuffles of the output: their median as index, the least as `low` and the greatest as `high`.
      An output that is equal in all flights, or that fewer than 50 flights have, has an empty
      ranking.
    """
    touched = any("touch_miss_m" in row for row in rows)
    return {output: _rank(rows, output) for output in OUTPUTS if touched or "touch" not in output}


def drawn_columns(rows: Sequence[Row]) -> dict[str, Column]:
    """Returns what was drawn of the world and of the transit, and what a survey was off by.

    What never varied is left out.

    A vector gives a column for each component, as in `truth.thrusters.scale[0]`. If each component
    has both signs, the vector's size says what no component does: `|truth.attitude|` is its norm.
    Texts, and values that a flight lacks, are coded in alphabetical order. Seeds of random numbers
    are left out: neighbours among them have nothing in common.
    """
    drawn = dict.fromkeys(name for row in rows for name in row["dispersed"])
    names = [name for name in drawn if not name.endswith("seed")]
    columns = {
        name: _column([row[name] for row in rows])
        for name in (*TRANSIT, *_SURVEY)
        if rows and all(name in row for row in rows)
    }
    for name in names:
        values = [row["dispersed"].get(name) for row in rows]
        if not any(isinstance(value, Sequence) and not isinstance(value, str) for value in values):
            columns[name] = _column(values)
            continue
        vectors = [value if isinstance(value, Sequence) else [value] for value in values]
        width = max(len(vector) for vector in vectors)
        parts = [
            _column([vector[k] if k < len(vector) else None for vector in vectors])
            for k in range(width)
        ]
        columns |= {f"{name}[{k}]": part for k, part in enumerate(parts)}
        if parts and all(
            not part.labels and part.values.min() < 0.0 < part.values.max() for part in parts
        ):
            norms = np.linalg.norm([part.values for part in parts], axis=0)
            columns[f"|{name}|"] = Column(norms)
    return {name: column for name, column in columns.items() if len(np.unique(column.values)) > 1}


def told_from_chance(ranking: Ranking) -> list[str]:
    """Returns the quantities that stand above chance, the strongest first."""
    return [entry.quantity for entry in ranking if entry.above_chance]


def _column(values: Sequence[typing.Any]) -> Column:
    if all(isinstance(value, int | float) for value in values):
        return Column(np.array(values, dtype=float))
    texts = [str(value) for value in values]
    labels = tuple(sorted(set(texts)))
    return Column(np.array([labels.index(text) for text in texts], dtype=float), labels)


def _rank(rows: Sequence[Row], output: str) -> Ranking:
    if output == "failure":
        counted, found = rows, np.array([float(not row["success"]) for row in rows])
    else:
        counted = [row for row in rows if row.get(output) is not None]
        if output == "delta_v_m_s":
            counted = [row for row in counted if row["success"]]
        found = np.array([row[output] for row in counted])
    if len(counted) < LEAST_FLIGHTS or np.ptp(found) == 0.0:
        return []
    columns = drawn_columns(counted)
    if not columns:
        return []
    seed, count = counted[0]["seed"], len(counted)
    inputs = _ranks(np.stack([column.values for column in columns.values()], axis=1), seed)
    lots = generator(seed, count, 1)
    chance = [_pawn(inputs, lots.permutation(found)).max() for _ in range(_SHUFFLES)]
    indices = _pawn(inputs, found)
    picks = generator(seed, count, 2).integers(count, size=(_RESAMPLES, count))
    spread = _NINETY * np.std([_pawn(inputs[pick], found[pick]) for pick in picks], axis=0, ddof=1)
    ranking = [
        _ranked(name, index, index - half, index + half, index > max(chance) + _ROUNDING)
        for name, index, half in zip(columns, indices, spread, strict=True)
    ]
    ranking.append(_ranked(DUMMY, float(np.median(chance)), min(chance), max(chance), False))
    return sorted(ranking, key=lambda entry: -entry.index)


def _ranked(name: str, index: float, low: float, high: float, above: bool) -> Ranked:
    return Ranked(name, float(index), max(0.0, float(low)), min(1.0, float(high)), bool(above))


def _ranks(values: np.ndarray, seed: int) -> np.ndarray:
    """The ranks (N, K) of each column, with ties in a random order.

    PAWN's slices end at quantiles, and would leave out the greatest of a few codes.
    """
    lots = generator(seed, len(values), 0).random(values.shape)
    order = np.lexsort((lots, values), axis=0)
    return np.argsort(order, axis=0).astype(float)


def _pawn(inputs: np.ndarray, output: np.ndarray) -> np.ndarray:
    """The index of each column (K,), for inputs (N, K) and an output (N,).

    It is that of `SALib.analyze.pawn`, which computes p-values too and takes 20 times as long.
    """
    values, codes = np.unique(output, return_inverse=True)
    number, width, height = inputs.shape[1], _SLICES + 1, len(values)
    shares = np.arange(0.0, 1.0 + 1.0 / _SLICES, 1.0 / _SLICES)  # With SALib's last bits.
    edges = np.quantile(inputs, shares, axis=0)
    # The greatest value is in a slice of its own, which SALib leaves out.
    slices = (inputs[None] >= edges[:, None]).sum(axis=0) - 1
    places = (np.arange(number) * width + slices) * height + codes[:, None]
    counts = np.bincount(places.ravel(), minlength=number * width * height)
    below = counts.reshape(number, width, height)[:, :-1].cumsum(axis=2)
    sizes = below[:, :, -1]
    everywhere = np.bincount(codes).cumsum() / len(codes)
    distances = np.abs(below / np.maximum(sizes, 1)[:, :, None] - everywhere).max(axis=2)
    return np.average(distances, axis=1, weights=sizes > 0)
