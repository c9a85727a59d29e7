"""The dimensions that a pilot is built from."""

from __future__ import annotations

import dataclasses as dc

import numpy as np
import torch

from proxops.training.data import scaling_for
from proxops.training.pilot.coarse_position import CoarsePosition
from proxops.training.pilot.geometry_layer import GeometryLayer, SurfaceField
from proxops.training.pilot.guidance import Guidance
from proxops.training.pilot.lidar_hits import HitSelection
from proxops.training.pilot.network import Pilot
from proxops.training.pilot.state_filter import Motion, StateFilter

# Returns farther from the learned surface than this share of its spacing count less.
_OUTLIER_SHARE = 1.0 / 6.0
# Initial values of the guidance: this share of the thrusters' acceleration, and a least time of
# this many control periods.
_NOMINAL_SHARE, _LEAST_PERIODS = 0.43, 30.0
# Units of speed and acceleration, as shares of those that the thrusters reach over the length.
_SPEED_UNIT, _ACCELERATION_UNIT = 0.24, 0.14


@dc.dataclass(frozen=True)
class PilotDimensions:
    """The dimensions of a pilot: all that it is before it learns; SI."""

    planes: int
    rays: int
    hits: int
    """Returns of each frame that it uses."""
    period: float
    mass: float
    thrust_limit: float
    length: float
    """The body's size, see `body_length`."""
    keep_out: tuple[float, float, float]
    """Semi-axes from which the guidance's ellipsoid starts."""
    low: tuple[float, float, float]
    high: tuple[float, float, float]
    """Corners of the box in which the surface is learned."""
    spacing: float
    """Spacing of the surface's grid."""
    coarse_width: int = 256
    motion_width: int = 128
    guidance_width: int = 256

    def make(self) -> Pilot:
        """Makes a pilot, with weights drawn from torch's generator."""
        reach = self.thrust_limit / self.mass
        scaling = scaling_for(self.length, self.mass, self.thrust_limit)
        motion = Motion(
            self.length,
            _SPEED_UNIT * float(np.sqrt(reach * self.length)),
            _ACCELERATION_UNIT * reach,
            self.period,
            self.motion_width,
            scaling.force,
        )
        field = SurfaceField(np.array(self.low), np.array(self.high), self.spacing)
        guidance = Guidance(
            motion.length,
            motion.speed,
            torch.tensor(self.keep_out),
            self.mass,
            self.thrust_limit,
            _LEAST_PERIODS * self.period,
            _NOMINAL_SHARE * reach,
            self.guidance_width,
        )
        return Pilot(
            HitSelection(self.planes, self.rays, self.hits, scaling.length),
            CoarsePosition(self.length, self.coarse_width),
            GeometryLayer(field, _OUTLIER_SHARE * self.spacing),
            StateFilter(motion, scaling),
            guidance,
        )
