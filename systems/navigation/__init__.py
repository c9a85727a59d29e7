"""Navigation: from lidar frames and own commands to position, velocity and attitude.

Start with `LidarNavigation`, a thin system over plain functions. Nothing in this room may see the
truth: it is made from the map, the believed gravity and spin, and the lidar's data sheet.
"""

from proxops.systems.navigation.expected_errors import ExpectedErrors
from proxops.systems.navigation.phase import NavigationPhase

__all__ = ["ExpectedErrors", "NavigationPhase"]
