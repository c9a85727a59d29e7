"""What figures share: the unit of lengths, minutes, a colour for each axis, planes of K."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes

from proxops.diagrams.logs import FlightLog
from proxops.diagrams.scenario import Body
from proxops.systems.common import Values

MINUTE = 60.0
"""A minute in s."""
AXIS_COLOURS = {"x": "#33415c", "y": "#c07a1f", "z": "#1f8a9a"}


def length_unit(size: float) -> tuple[float, str]:
    """Gives the unit for lengths up to about `size` (m), in m and by name: km from 5 km up."""
    return (1e3, "km") if size >= 5e3 else (1.0, "m")


def unit_at(body: Body) -> tuple[float, str]:
    """Gives the unit for all lengths of a flight at a body, in m and by name."""
    return length_unit(float(body.shape.extents.max()))


def minutes_of(log: FlightLog) -> Values:
    """Gives the times (N,) of a log's rows in minutes."""
    return log.dataset["time"].values / MINUTE


def force_edges(log: FlightLog) -> Values:
    """Gives the times (N,) in minutes between which the forces of a log's rows but the last act.

    The last row is the end of the flight; no force acts after it.
    """
    times, delay = log.dataset["time"].values, log.dataset.attrs.get("force_delay_s", 0.0)
    return np.minimum(times + delay, times[-1]) / MINUTE


def frame_plane(ax: Axes, plane: str, unit: str, reach: float) -> None:
    """Shows a plane such as "xy" out to `reach` on each side of the origin.

    Args:
      ax: the axes.
      plane: names the axis to the right, then the one upwards.
      unit: of lengths in the picture.
      reach: in this unit.
    """
    ax.set_xlim(-reach, reach)
    ax.set_ylim(-reach, reach)
    ax.set_aspect("equal")
    ax.set_xlabel(f"{plane[0]} ({unit})")
    ax.set_ylabel(f"{plane[1]} ({unit})")
    ax.grid(alpha=0.25)
