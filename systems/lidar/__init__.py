"""The lidar: planes of rays that measure the range to the body, and their errors.

Start with `Lidar`, which casts rays at the mesh; `PlanarLidar` holds what it shares with
`LearnedLidar`, which asks a trained network instead. `lidar_errors` turns true returns into
measured ones (noise, bias, dropout, false returns) as a pure function of seed and step.
"""

from proxops.systems.lidar.learned_lidar import LearnedLidar
from proxops.systems.lidar.lidar import Lidar
from proxops.systems.lidar.lidar_bundle import (
    CHORDS_INPUT,
    DEPTH_OUTPUT,
    HIT_OUTPUT,
    LIDAR_FILE,
    LIDAR_FORMAT,
    LidarBundle,
)
from proxops.systems.lidar.lidar_errors import LidarErrors
from proxops.systems.lidar.planar_lidar import (
    PLANES,
    RAYS,
    PlanarLidar,
    TrueReturns,
    ray_directions,
)
from proxops.systems.lidar.ray_chords import ChordFan

__all__ = [
    "CHORDS_INPUT",
    "DEPTH_OUTPUT",
    "HIT_OUTPUT",
    "LIDAR_FILE",
    "LIDAR_FORMAT",
    "PLANES",
    "RAYS",
    "ChordFan",
    "LearnedLidar",
    "Lidar",
    "LidarBundle",
    "LidarErrors",
    "PlanarLidar",
    "TrueReturns",
    "ray_directions",
]
