"""Training of the learned lidar: two networks learn noiseless frames on a grid of positions.

Start with `train_lidar` in `synthesis`, which `proxops train-lidar` calls. `networks` has the two
networks: ours answers for each ray, and the paper's gives whole frames. `bundle` exports both.
"""

from proxops.training.lidar.synthesis import LidarSettings, train_lidar

__all__ = [
    "LidarSettings",
    "train_lidar",
]
