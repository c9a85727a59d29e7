"""`LearnedLidar`: a neural network in the place of the ray caster."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from proxops.systems.common import FAR, InputError, Vector3, config, number
from proxops.systems.lidar.lidar_bundle import FRAME_NETWORK, LidarBundle
from proxops.systems.lidar.lidar_errors import (
    DEFAULT_ERRORS,
    LidarErrors,
    TrueReturns,
    check_rays,
)
from proxops.systems.lidar.lidar_geometry import DEFAULT_GEOMETRY, LidarGeometry
from proxops.systems.lidar.planar_lidar import PlanarLidar
from proxops.systems.lidar.ray_chords import ChordFan

# Greatest difference of a rotation matrix from the identity, in any element, that counts as none.
_SAME_ATTITUDE = 1e-9


@config
class LearnedLidarConfig:
    """A network that takes the place of the ray-caster; see `proxops.systems.LearnedLidar`.

    A scenario chooses it with `lidar: !LearnedLidar {bundle: ...}`. Keys without a comment mean the
    same as in `LidarConfig`.
    """

    # The folder `bundle` that `proxops train-lidar` wrote. In a scenario file the path is relative
    # to the file; elsewhere it is relative to the working directory.
    bundle: str = ""
    noise_std_m: float = number(50.0, at_least=0.0, at_most=FAR, unit="m")
    max_range_m: float = number(350.0e3, at_least=1e-3, at_most=FAR, unit="m")
    # These must equal the numbers that the bundle was trained for.
    planes: int = number(12, at_least=1, at_most=360)
    rays: int = number(360, at_least=1, at_most=3600)
    # A ray has a return if the network predicts one with at least this probability.
    hit_probability: float = number(0.5, at_least=1e-9, below=1.0)


class LearnedLidar(PlanarLidar):
    """Replaces `Lidar` with a network that was trained on `Lidar`'s frames.

    ```
                  ┌──────────────┐
    position ────►│ LearnedLidar ├─► ranges (planes * rays), m, plane by plane; +inf: no return
      (3), m, K   │              ├─► point_cloud (abstract PointCloud), m, relative to the
    attitude ────►│              │   spacecraft, in S; only rays that returned
      (4)         └──────────────┘
    ```

    The network replaces the mesh and the ray caster and knows no noise. The sensor's errors are
    added to its ranges as `Lidar` adds them to the true ones: the same (seed, step) and the same
    number of returns give the same random numbers. The network does not know the angle at which a
    ray meets the surface, nor what is beside the ray, so there is no limit on the angle of
    incidence and no width of beams.

    The bundle decides the kind of network: ours answers for each ray; the paper's gives a whole
    frame for a position, so it refuses an attitude other than the identity.
    """

    def __init__(
        self,
        bundle: LidarBundle | str | Path,
        errors: LidarErrors = DEFAULT_ERRORS,
        geometry: LidarGeometry = DEFAULT_GEOMETRY,
        period: float = 10.0,
        seed: int = 0,
        *,
        hit_probability: float = 0.5,
        shape_sha256: str | None = None,
    ):
        """Takes a bundle that `proxops train-lidar` made, and the sensor's properties.

        Args:
          bundle: the bundle or its folder.
          errors, geometry, period, seed: as for `Lidar`, without a limit of incidence and without a
            beam width.
          hit_probability: a ray returns if our network gives its hit at least this probability;
            the paper's network gives ranges, not probabilities.
          shape_sha256: hash of the shape of the body flown at; None: the body of the bundle.

        Raises:
          InputError: a property is senseless; there is no bundle, it is damaged, or it was trained
            for other planes and rays or another body.
        """
        super().__init__(errors, geometry, period, seed)
        if errors.max_incidence < math.pi / 2.0:
            raise InputError(
                "a learned lidar does not know angles of incidence: leave out the limit"
            )
        check_rays(errors, "LearnedLidar")
        if not 0.0 < hit_probability < 1.0:
            raise InputError(f"hit_probability must be between 0 and 1, got {hit_probability}")
        self.bundle = bundle if isinstance(bundle, LidarBundle) else LidarBundle.load(bundle)
        planes, rays = self.bundle.planes, self.bundle.rays
        if (planes, rays) != (geometry.planes, geometry.rays):
            raise InputError(
                f"{self.bundle.path} is for {planes} planes of {rays} rays, and the lidar has "
                f"{geometry.planes} of {geometry.rays}: train one for these"
            )
        if shape_sha256 is not None and shape_sha256 != self.bundle.shape_sha256:
            raise InputError(
                f"{self.bundle.path} was trained on a body of another shape: train one on this body"
            )
        self._fan = None
        if self.bundle.kind != FRAME_NETWORK:
            self._fan = ChordFan(self.bundle.centre, self.bundle.semi_axes, self.directions)
        self._least_logit = math.log(hit_probability / (1.0 - hit_probability))

    def true_returns(self, position: Vector3, rotation: np.ndarray | None = None) -> TrueReturns:
        """The rays from a position (3,) in m in K that return: see `PlanarLidar`.

        Raises:
          InputError: the bundle is of the paper's kind, and the rotation is not the identity.
        """
        if self._fan is None:
            return self._frame_returns(position, rotation)
        # The network describes a ray by its chord alone, so it answers for any direction.
        chords = self._fan.chords(position[None], rotation)
        logits, depths = self.bundle.predict(chords.ends)
        hits = np.flatnonzero(logits >= self._least_logit)
        ways = chords.starts[hits] + depths[hits].astype(np.float64) * chords.lengths[hits]
        return TrueReturns(chords.rays[hits], ways)

    def _frame_returns(self, position: np.ndarray, rotation: np.ndarray | None) -> TrueReturns:
        """What the paper's network sees."""
        if rotation is not None and np.abs(rotation - np.eye(3)).max() > _SAME_ATTITUDE:
            raise InputError(
                f"{self.bundle.path} gives whole frames for the axes of K alone, and the attitude "
                "differs from them: fly a ray network, or leave the attitude without error"
            )
        ranges = self.bundle.predict_frame(position)
        hits = np.flatnonzero(ranges > 0.0)
        return TrueReturns(hits, ranges[hits])
