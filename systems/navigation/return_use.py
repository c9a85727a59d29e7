"""`ReturnUse`: what the navigation makes of a return."""

from __future__ import annotations

from enum import IntEnum


class ReturnUse(IntEnum):
    """What the navigation makes of a ray of a frame."""

    NOT_USED = 0
    """Nothing: no return, or one that cannot be compared, or one more than is needed."""
    USED = 1
    """It corrects the estimate."""
    REJECTED = 2
    """It disagrees with its prediction by more than chance allows."""
