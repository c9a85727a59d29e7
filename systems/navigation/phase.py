"""`NavigationPhase`: what the navigation is doing."""

from __future__ import annotations

from enum import IntEnum


class NavigationPhase(IntEnum):
    """What the navigation is doing at a step."""

    ACQUIRING = 0
    """It searches for where it is, and gives no state."""
    FOLLOWING = 1
    """It corrects its state with each frame."""
    LOST = 2
    """It predicts its state, but does not trust it: the frames do not fit."""
