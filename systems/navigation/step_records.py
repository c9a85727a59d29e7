"""What the navigation is doing at a step, and what it makes of each return."""

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


class ReturnUse(IntEnum):
    """What the navigation makes of a ray of a frame."""

    NOT_USED = 0
    """Nothing: no return, or one that cannot be compared, or one more than is needed."""
    USED = 1
    """It corrects the estimate."""
    REJECTED = 2
    """It disagrees with its prediction by more than chance allows."""
