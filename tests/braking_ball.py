"""A ball to stay clear of, and a field without gravity, for tests of the backup braking."""

import numpy as np

from proxops.systems import FlightLimits, Gravity

RADIUS, MASS, THRUST = 50e3, 100.0, 7.0
PUSH = THRUST / MASS
BALL = FlightLimits(MASS, THRUST, 40.0, np.full(3, RADIUS))


class NoField:
    def evaluate(self, points: np.ndarray) -> Gravity:
        n = len(points)
        return Gravity(np.zeros(n), np.zeros((n, 3)), np.zeros((n, 3, 3)), np.zeros(n, bool))
