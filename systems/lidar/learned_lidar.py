"""`LearnedLidar`: a neural network in the place of the ray-caster."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from proxops.systems.common import InputError
from proxops.systems.lidar.lidar_bundle import LidarBundle
from proxops.systems.lidar.lidar_errors import LidarErrors
from proxops.systems.lidar.planar_lidar import PLANES, RAYS, Caster, PlanarLidar, TrueReturns
from proxops.systems.lidar.ray_chords import ChordFan


class LearnedLidar(PlanarLidar):
    """A drop-in for `Lidar` that a network, trained on its frames, answers.

    ```
                  ┌──────────────┐
    position ────►│ LearnedLidar ├─► ranges (planes * rays), m, plane by plane; +inf: no return
      (3), m, K   │              ├─► point_cloud (abstract PointCloud), m, relative to the
                  └──────────────┘   spacecraft, in its axes; only rays that returned
    ```

    The network knows nothing of noise: it stands for the mesh and the ray-caster, and the errors
    of the sensor are laid over its ranges as `Lidar` lays them over the true ones, with the same
    numbers for the same (seed, step) and as many returns. What it doesn't know is the angle at
    which a ray meets the surface, so it has no limit on that.
    """

    def __init__(
        self,
        bundle: LidarBundle | str | Path,
        noise_std: float = 50.0,
        max_range: float = 350e3,
        planes: int = PLANES,
        rays: int = RAYS,
        period: float = 10.0,
        seed: int = 0,
        *,
        bias: float = 0.0,
        scale_error: float = 0.0,
        dropout: float = 0.0,
        false_returns: float = 0.0,
        attitude_error: float = 0.0,
        hit_probability: float = 0.5,
        shape_sha256: str | None = None,
    ):
        """Takes a bundle that `proxops train-lidar` made, and what `Lidar` takes.

        Args:
          hit_probability: a ray returns if the network gives its hit at least this probability.
          shape_sha256: of the body flown at; None: whatever body the bundle was trained on.

        Raises:
          InputError: a property that no lidar has; no bundle, a damaged one, or one for other
            planes and rays or another body.
        """
        errors = LidarErrors(
            noise_std,
            bias,
            scale_error,
            dropout=dropout,
            false_returns=false_returns,
            attitude_error=attitude_error,
        )
        super().__init__(errors, max_range, planes, rays, period, seed)
        if not 0.0 < hit_probability < 1.0:
            raise InputError(f"hit_probability must be between 0 and 1, got {hit_probability}")
        self.bundle = bundle if isinstance(bundle, LidarBundle) else LidarBundle.load(bundle)
        trained = (self.bundle.planes, self.bundle.rays)
        if trained != (planes, rays):
            raise InputError(
                f"{self.bundle.path} is for {trained[0]} planes of {trained[1]} rays, and the "
                f"lidar has {planes} of {rays}: train one for these"
            )
        if shape_sha256 is not None and shape_sha256 != self.bundle.shape_sha256:
            raise InputError(
                f"{self.bundle.path} was trained on a body of another shape: train one on this body"
            )
        self._least_logit = math.log(hit_probability / (1.0 - hit_probability))

    def caster(self, directions: np.ndarray) -> Caster:
        """What the network takes rays along unit directions (planes * rays, 3) in K to meet."""
        # It knows a ray by its chord alone, so it answers for any direction.
        fan = ChordFan(self.bundle.centre, self.bundle.semi_axes, directions)

        def cast(position: np.ndarray) -> TrueReturns:
            chords = fan.chords(position[None])
            logits, depths = self.bundle.predict(chords.ends)
            hits = np.flatnonzero(logits >= self._least_logit)
            ways = chords.starts[hits] + depths[hits].astype(np.float64) * chords.lengths[hits]
            return TrueReturns(chords.rays[hits], ways)

        return cast
