"""What the figures over time share: minutes, and a colour for each axis."""

from __future__ import annotations

import numpy as np

from proxops.diagrams.logs import FlightLog

MINUTE = 60.0
"""A minute in s."""
AXIS_COLOURS = {"x": "#33415c", "y": "#c07a1f", "z": "#1f8a9a"}


def minutes_of(log: FlightLog) -> np.ndarray:
    """Gives the times (N,) of a log's rows in minutes."""
    return log.dataset["time"].values / MINUTE
