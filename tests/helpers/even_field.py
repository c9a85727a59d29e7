"""`EvenField`: the same gravity everywhere."""

from collections.abc import Sequence

import numpy as np

from proxops.systems.gravity import Gravity


class EvenField:
    """A field without a gradient."""

    def __init__(self, acceleration: Sequence[float] = (0.0, 0.0, 0.0)):
        self.acceleration = np.array(acceleration)

    def evaluate(self, points: np.ndarray) -> Gravity:
        count = len(points)
        pull = np.broadcast_to(self.acceleration, (count, 3))
        return Gravity(np.zeros(count), pull, np.zeros((count, 3, 3)), np.zeros(count, bool))
