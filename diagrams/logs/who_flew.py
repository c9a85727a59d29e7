"""Who flies at each step of a flight: names and colours that plots and replays share."""

from __future__ import annotations

import numpy as np
import xarray as xr

from proxops.diagrams.logs.flight_summary import INTERVENTION_TOLERANCE

FILTER = 3
"""Besides the values of a log's `decision`: runtime assurance changed the command."""

_NAMES = {0: "controller", 1: "MPC", 2: "policy", FILTER: "safety filter"}
_COLOURS = {
    0: (0.25, 0.70, 0.45),
    1: (0.22, 0.55, 0.95),
    2: (0.96, 0.55, 0.13),
    FILTER: (0.93, 0.35, 0.95),
}


def who_flies(dataset: xr.Dataset) -> np.ndarray:
    """For each row (N,) of a log's dataset its `decision`, or `FILTER`."""
    who = dataset["decision"].values.astype(int)
    if "intervention" not in dataset:
        return who
    return np.where(dataset["intervention"].values > INTERVENTION_TOLERANCE, FILTER, who)


def colour_of(who: int) -> tuple[float, float, float]:
    """Red, green and blue from 0 to 1; a value that is not known counts as 0."""
    return _COLOURS.get(who, _COLOURS[0])


def name_of(who: int, controller: str) -> str:
    """What to call it in a flight of the controller of that name."""
    return controller if who not in _NAMES or who == 0 else _NAMES[who]


def those_who_fly(dataset: xr.Dataset) -> list[int]:
    """All that fly in a log, the last row aside: it is the flight's end."""
    return sorted({int(who) for who in who_flies(dataset)[:-1]})
