"""Navigation: from lidar frames and own commands to position, velocity and attitude.

Start with `LidarNavigation`, a thin system over plain functions, and `navigator`, which takes one
step after the other: `motion` predicts, `frame_model` says what the map predicts, `correction`
compares, `acquisition` finds the pose from a frame alone, with the help of `likely_poses`.
`estimate` has the layout of what is estimated, `map_error` the error of the map, `expected_errors`
how wrong everything may be; `mended_map` is the map with what a flight taught. Nothing in this room
may see the truth: it is made from the map, gravity and spin as believed, and the data sheets.
"""

from proxops.systems.navigation.estimate import Estimate
from proxops.systems.navigation.expected_errors import ExpectedErrors
from proxops.systems.navigation.lidar_navigation import (
    LidarFrames,
    LidarNavigation,
    LidarNavigationConfig,
)
from proxops.systems.navigation.map_error import MapError, shift_of_centre
from proxops.systems.navigation.mended_map import MendedMap, load_map, map_files, save_mended_map
from proxops.systems.navigation.step_records import NavigationPhase, ReturnUse

__all__ = [
    "Estimate",
    "ExpectedErrors",
    "LidarFrames",
    "LidarNavigation",
    "LidarNavigationConfig",
    "MapError",
    "MendedMap",
    "NavigationPhase",
    "ReturnUse",
    "load_map",
    "map_files",
    "save_mended_map",
    "shift_of_centre",
]
