"""`Sight`: poses from which the body looks like a frame, found by comparing many at once."""

from __future__ import annotations

import functools

import numpy as np
import scipy  # Its parts are imported when they are used.

from proxops.systems.navigation._motion_kernel import turned
from proxops.systems.navigation.frame_model import FrameModel

# The surface at the nearest point faces the spacecraft, but for this angle (cosine): rays are far
# apart. Number of places above it that are compared with the frame.
_FACING, _NEAR_PLACES = np.cos(np.radians(35.0)), 250
# Number of poses around each of the best; each round: their spread over the length and over the
# attitude's deviation, and the error over the length beyond which a ray counts as off.
_AROUND, _ROUNDS = 30, ((0.03, 1.0, 0.03), (0.012, 1.0, 0.02))
_MORE_ROUNDS = ((0.03, 1.5, 0.03), (0.02, 1.0, 0.02), (0.012, 0.5, 0.01))
# Poses kept, poses refined, and rays that they are compared by; then these of a thorough search.
_KEPT, _REFINED, _SAMPLE = 8, 2, 80
_MORE_KEPT, _MORE_REFINED, _MORE_SAMPLE = 16, 5, 160
# Anywhere: number of places in a ball of this radius over the body's length; then number of places
# around each of the best, of which again the best are refined.
_WIDE, _CLOSE = (300, 0.45), (40, 0.07)
# The error, over the body's length, that counts as one ray where poses are compared at first.
_FAR = 0.05
# Number of searches that differ; then they repeat.
_SEARCHES = 200


class Sight:
    """What a frame looks like, for comparing many poses with it at once.

    Poses are arrays (N, 6): the position in m in K, and a rotation vector in K by which the
    attitude is off.
    """

    def __init__(
        self,
        model: FrameModel,
        rotation: np.ndarray,
        rotation_std: float,
        ranges: np.ndarray,
        rays: np.ndarray,
        search: int,
    ):
        """Takes a frame, the rays that see the body, and the attitude; see `acquire`."""
        self._model, self._size = model, model.shape.extents.max()
        self._rotation, self._rotation_std = rotation, rotation_std
        self._search = search
        self._kept, self._refined = (_MORE_KEPT, _MORE_REFINED) if search else (_KEPT, _REFINED)
        blank = np.flatnonzero(np.isinf(ranges))  # `rays` have a return.
        each = (_MORE_SAMPLE if search else _SAMPLE) // 2
        sample = np.concatenate([thinned(rays, each), thinned(blank, each)])
        self._directions = model.directions[sample] @ rotation.T
        self._measured = ranges[sample]
        # The nearest return that its neighbours confirm.
        frame = np.full(ranges.size, np.inf)
        frame[rays] = ranges[rays]
        frame = frame.reshape(model.geometry.planes, model.geometry.rays)
        smooth = np.median([np.roll(frame, shift, axis=1) for shift in (-1, 0, 1)], axis=0)
        nearest = int(np.argmin(smooth))
        self._down = rotation @ model.directions[nearest]
        self.distance = float(smooth.flat[nearest])

    def above_the_nearest(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """Likely positions and rotations whose nearest return comes from a surface below them."""
        facing = np.flatnonzero(-self._model.normals @ self._down > _FACING)
        facing = thinned(facing, _NEAR_PLACES)
        poses = np.zeros((facing.size, 6))
        poses[:, :3] = self._model.centres[facing] - self.distance * self._down
        poses = self._likeliest(poses, _FAR)
        for reach, turn, off in _MORE_ROUNDS if self._search else _ROUNDS:
            spread = np.repeat([reach * self._size, turn * self._rotation_std], 3)
            poses = self._likeliest(self._lowered(self._with_others(poses, _AROUND, spread)), off)
        return self._best(poses)

    def anywhere(self, middle: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
        """Likely positions and rotations around a point (3,)."""
        (count, radius), (more, close) = _WIDE, _CLOSE
        poses = self._with_others(
            np.r_[middle, np.zeros(3)][None], count, np.repeat([radius * self._size, 0.0], 3)
        )
        poses = self._likeliest(poses, _FAR)
        spread = np.repeat([close * self._size, 0.0], 3)
        return self._best(self._likeliest(self._with_others(poses, more, spread), _FAR))

    def _best(self, poses: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
        """Positions and rotations R_KS of the best of poses in order."""
        return [(pose[:3], turned(self._rotation, pose[3:])) for pose in poses[: self._refined]]

    def _with_others(self, poses: np.ndarray, count: int, spread: np.ndarray) -> np.ndarray:
        """Poses, and a number of others around each of them, off by up to `spread` (6,)."""
        around = poses[:, None] + spread * _balls(count, self._search)
        return np.concatenate([poses, around.reshape(-1, 6)])

    def _lowered(self, poses: np.ndarray) -> np.ndarray:
        """Poses that are moved along the nearest ray until the map predicts its range."""
        downs = scipy.spatial.transform.Rotation.from_rotvec(poses[:, 3:]).apply(self._down)
        heights = self._model.distances(poses[:, :3], downs)
        below = heights < np.inf
        poses = poses[below]
        poses[:, :3] += (heights[below] - self.distance)[:, None] * downs[below]
        return poses

    def _likeliest(self, poses: np.ndarray, far: float) -> np.ndarray:
        """The few of the poses from which the body looks most like the frame, in order.

        Args:
          far: error, over the body's length, from which a ray counts as one.
        """
        rays = len(self._directions)
        turns = scipy.spatial.transform.Rotation.from_rotvec(poses[:, 3:]).as_matrix()
        directions = self._directions @ turns.transpose(0, 2, 1)
        found = self._model.distances(
            np.repeat(poses[:, :3], rays, axis=0), directions.reshape(-1, 3)
        )
        found[found > self._model.geometry.max_range] = np.inf
        found = found.reshape(len(poses), rays)
        with np.errstate(invalid="ignore"):
            off = np.minimum(np.abs(found - self._measured) / (far * self._size), 1.0)
        off[np.isinf(found) & np.isinf(self._measured)] = 0.0
        order = np.argsort(off.mean(axis=1), kind="stable")
        return poses[order[: self._kept]]


@functools.lru_cache(maxsize=64)
def _balls(count: int, search: int) -> np.ndarray:
    """Points (count, 6), spread evenly: three coordinates in a unit ball, and three in another."""
    from scipy.stats import qmc  # It is slow to import, so only when it is needed.

    # 27 % of the points of the cube lie in both balls.
    each = 6 * count + 200
    # Halton's sequence is drawn from its beginning; the searches of long ago come again.
    begin = 1 + (search % _SEARCHES) * each
    points = 2.0 * qmc.Halton(6, scramble=False).fast_forward(begin).random(each) - 1.0
    lengths = np.linalg.norm(points.reshape(each, 2, 3), axis=2)
    return points[(lengths <= 1.0).all(axis=1)][:count]


def thinned(indices: np.ndarray, count: int) -> np.ndarray:
    """Fewer than twice `count` of the indices, evenly chosen; all of them if they are so few."""
    return indices[:: max(1, indices.size // count)]
