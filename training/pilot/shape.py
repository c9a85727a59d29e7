"""The measures that a pilot is built from, and the file that keeps a trained one."""

from __future__ import annotations

import dataclasses as dc
from pathlib import Path

import numpy as np
import torch

from proxops.systems.common import InputError, file_sha256, write_whole
from proxops.training.data import scaling_for
from proxops.training.pilot.coarse_position import CoarsePosition
from proxops.training.pilot.geometry_layer import GeometryLayer, SurfaceField
from proxops.training.pilot.guidance import Guidance
from proxops.training.pilot.lidar_hits import HitSelection
from proxops.training.pilot.network import Pilot
from proxops.training.pilot.state_filter import Motion, StateFilter

PILOT_FILE = "pilot.ckpt"
# Rays of a frame, and the widths of all layers together, in a file that is read.
_GREATEST_SIZE = 2**16

# Returns farther from the learned surface than this share of its spacing count less.
_OUTLIER_SHARE = 1.0 / 6.0
# Initial values of the guidance: this share of the thrusters' acceleration, and a least time of
# this many control periods.
_NOMINAL_SHARE, _LEAST_PERIODS = 0.43, 30.0
# Units of speed and acceleration, as shares of those that the thrusters reach over the length.
_SPEED_UNIT, _ACCELERATION_UNIT = 0.24, 0.14


@dc.dataclass(frozen=True)
class PilotShape:
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


def save_pilot(folder: Path, shape: PilotShape, pilot: Pilot, origin: dict) -> None:
    """Writes a pilot, its shape and its origin to `folder`; the file is complete or not there."""
    content = {"shape": dc.asdict(shape), "weights": pilot.state_dict(), "origin": origin}
    write_whole(folder / PILOT_FILE, lambda name: torch.save(content, name))


def load_pilot(folder: Path) -> tuple[PilotShape, Pilot, dict]:
    """Reads what `save_pilot` wrote.

    Raises:
      InputError: there is no such file, or it holds no pilot.
    """
    path = folder / PILOT_FILE
    try:
        # Only tensors and plain values are read, so that a file from a stranger runs no code.
        content = torch.load(path, map_location="cpu", weights_only=True)
        shape, origin = PilotShape(**content["shape"]), dict(content["origin"])
        _check_size(shape, content["weights"])
        pilot = shape.make()
        pilot.load_state_dict(content["weights"])
        return shape, pilot.eval(), origin
    except Exception as error:  # A damaged file makes torch raise all sorts.
        raise InputError(
            f"{path} is no pilot that `proxops train --recipe proxops` wrote: {error}"
        ) from error


def _check_size(shape: PilotShape, weights: dict[str, torch.Tensor]) -> None:
    """Raises `ValueError` for a shape far larger than its weights: it would fill the memory."""
    cells = np.prod((np.array(shape.high) - np.array(shape.low)) / shape.spacing + 2.0)
    widths = shape.coarse_width + shape.motion_width + shape.guidance_width + shape.hits
    rays = shape.planes * shape.rays
    if not cells <= 2 * weights["geometry.field.values"].numel():
        raise ValueError("the surface's grid is not as large as its values")
    if not (0 < rays <= _GREATEST_SIZE and 0 < widths <= _GREATEST_SIZE):
        raise ValueError("the network is too large")


def pilot_sha256(folder: Path) -> str:
    """Hash of the pilot's file in a folder."""
    return file_sha256(folder / PILOT_FILE)
