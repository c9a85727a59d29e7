"""Training the learned lidar: noiseless frames on a grid, and two networks that learn them.

Start with `train_lidar`, which `proxops train-lidar` calls.
"""

from proxops.training.lidar.synthesis import LidarSettings, train_lidar

__all__ = [
    "LidarSettings",
    "train_lidar",
]
