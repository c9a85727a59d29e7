"""What a controller may offer to the log and to the legend of a flight."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from pydrake.systems.framework import OutputPort


class LegendEntry(NamedTuple):
    """How a controller is shown in plots and replays."""

    name: str
    colour: tuple[float, float, float]
    """Red, green and blue, each from 0 to 1."""


@dataclass(frozen=True)
class LoggedPort:
    """A vector output port of a controller whose values the log of a flight keeps."""

    port: OutputPort
    units: str = "1"
    description: str = ""
