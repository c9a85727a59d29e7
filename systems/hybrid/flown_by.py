"""`FlownBy`: whose force acts at a control step."""

from enum import IntEnum


class FlownBy(IntEnum):
    """Whose force acts at a control step; the numbers are those of a log's `decision`."""

    CONTROLLER = 0
    """The controller by which the flight is named: it is no hybrid."""
    MPC = 1
    POLICY = 2
    SAFETY_FILTER = 3
    """Runtime assurance changed the command. A log's `decision` does not hold this value: it is
    derived from `intervention`."""
