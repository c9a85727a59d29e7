"""The lidar: planes of rays that measure the range to the body, and their errors.

Start with `Lidar`, which casts rays at the mesh. `LearnedLidar` asks the trained network of a
`LidarBundle` instead. Both derive from `PlanarLidar`, which has the ports and applies the
`LidarErrors`; `LidarGeometry` has the planes and rays, and `FrameDelay` delays whole frames.
`LidarWithMoons` also meets the moons of the body, and `MoonMask` blanks what returns from them.
`SceneLidar` is for other diagrams: it rides on any pose, over surfaces that may move. A new
kind of lidar is a class derived from `PlanarLidar` with its own `true_returns`. A new error is a
field of `LidarErrors` with a random stream of its own.
"""

from proxops.systems.lidar.frame_delay import FrameDelay
from proxops.systems.lidar.learned_lidar import LearnedLidar, LearnedLidarConfig
from proxops.systems.lidar.lidar import Lidar, LidarConfig
from proxops.systems.lidar.lidar_bundle import (
    CHORDS_INPUT,
    DEPTH_OUTPUT,
    FRAME_NETWORK,
    HIT_OUTPUT,
    LIDAR_BUNDLE,
    POSITION_INPUT,
    RANGES_OUTPUT,
    RAY_NETWORK,
    LidarBundle,
)
from proxops.systems.lidar.lidar_errors import LidarErrors, TrueLidarConfig, TrueReturns
from proxops.systems.lidar.lidar_geometry import DEFAULT_GEOMETRY, LidarGeometry, ray_directions
from proxops.systems.lidar.lidar_with_moons import LidarWithMoons
from proxops.systems.lidar.moon_mask import MoonMask
from proxops.systems.lidar.planar_lidar import PlanarLidar
from proxops.systems.lidar.ray_chords import ChordFan
from proxops.systems.lidar.scene_lidar import BodyPose, SceneLidar

__all__ = [
    "CHORDS_INPUT",
    "DEFAULT_GEOMETRY",
    "DEPTH_OUTPUT",
    "FRAME_NETWORK",
    "HIT_OUTPUT",
    "LIDAR_BUNDLE",
    "POSITION_INPUT",
    "RANGES_OUTPUT",
    "RAY_NETWORK",
    "BodyPose",
    "ChordFan",
    "FrameDelay",
    "LearnedLidar",
    "LearnedLidarConfig",
    "Lidar",
    "LidarBundle",
    "LidarConfig",
    "LidarErrors",
    "LidarGeometry",
    "LidarWithMoons",
    "MoonMask",
    "PlanarLidar",
    "SceneLidar",
    "TrueLidarConfig",
    "TrueReturns",
    "ray_directions",
]
