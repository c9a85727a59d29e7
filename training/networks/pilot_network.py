"""The pilot: one exported network from lidar frame, goal and commanded force to force.

`PilotDimensions` makes one that has learned nothing; `save_pilot` keeps one that has.
"""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Callable
from pathlib import Path

import numpy as np
import torch
from torch import Tensor, nn

from proxops.systems.common import InputError
from proxops.training.data import scaling_for
from proxops.training.loop import write_tensors
from proxops.training.networks.coarse_position import CoarsePosition
from proxops.training.networks.geometry_layer import GeometryLayer, SurfaceField
from proxops.training.networks.guidance import Guidance
from proxops.training.networks.lidar_hits import HitSelection
from proxops.training.networks.state_filter import (
    MEMORY,
    NATURAL,
    TRUSTED,
    Motion,
    StateFilter,
    measurement_noise,
)

# A frame with fewer returns than this does not determine the position.
_LEAST_RETURNS = 8
# The fit starts from the coarse position if the residual is then less than this share of the other.
_CLEARLY_BETTER = 0.5
# Measurement noise of a fix, over the usual one, from hardly any returns.
_HOPELESS = 100.0
# Returns farther from the learned surface than this share of its spacing count less.
_OUTLIER_SHARE = 1.0 / 6.0
# Initial values of the guidance: this share of the thrusters' acceleration, and a least time of
# this many control periods.
_NOMINAL_SHARE, _LEAST_PERIODS = 0.43, 30.0
# Units of speed and acceleration, as shares of those that the thrusters reach over the length.
_SPEED_UNIT, _ACCELERATION_UNIT = 0.24, 0.14

PILOT_FILE = "pilot.ckpt"


class Pilot(nn.Module):
    """Navigation and guidance of prescribed structure, in five parts; all but the first learn.

    ```
    ranges ─► hits ─► coarse ─────► geometry ─► filter ─► guidance ─► force
                 └──────────────────►  ▲        │ ▲ ▲         ▲
                                       └ memory ┘ │ │         │
    commanded_force ────────────────────────────────┘ │         │
    target ─────────────────────────────────────────┼─────────┘
                                              next memory
    ```

    The geometry layer starts from the position that the filter predicts. At the first step, or if
    the returns do not fit the surface from there, it starts from the coarse position too and keeps
    the better fit. The guidance also counters the acceleration that the learned motion does not
    explain.
    """

    usual_residual: Tensor

    def __init__(
        self,
        hits: HitSelection,
        coarse: CoarsePosition,
        geometry: GeometryLayer,
        filter_: StateFilter,
        guidance: Guidance,
    ):
        super().__init__()
        self.hits, self.coarse, self.geometry = hits, coarse, geometry
        self.filter, self.guidance = filter_, guidance
        # Residual in m of the returns at a good fix; `fit_residual` sets it.
        self.register_buffer("usual_residual", torch.ones(()))

    def fit_residual(self, residuals: Tensor) -> None:
        """Sets the usual residual to the median of those of good fixes."""
        self.usual_residual.copy_(residuals.median())

    def forward(
        self, ranges: Tensor, target: Tensor, commanded_force: Tensor, memory: Tensor
    ) -> tuple[Tensor, Tensor, Tensor]:
        """One control step of B flights; SI, in K.

        Args:
          ranges: (B, planes * rays), +inf where no ray returned.
          target: (B, 6).
          commanded_force: (B, 3), over the period before the step.
          memory: (B, MEMORY), zeros before a flight's first step.

        Returns:
          Forces (B, 3) within the limits, estimates (B, 6) of position and velocity, and the next
          memory.
        """
        memory = self.see(ranges, commanded_force, memory)
        position, velocity, push = memory[:, :9].split(3, dim=1)
        natural = memory[:, NATURAL] + push
        force = self.guidance(position, velocity, target[:, :3], natural)
        limit = self.guidance.thrust_limit
        return force.clamp(-limit, limit), memory[:, :6], memory

    def see(self, ranges: Tensor, commanded_force: Tensor, memory: Tensor) -> Tensor:
        """Updates the memory with a frame and the force over the period before it."""
        hits = self.hits(ranges)
        points, _, valid, _ = hits
        memory = self.filter.predict(memory, commanded_force)
        fresh = memory[:, -1:] == 0.0
        expected = memory[:, :3]
        step, off = self.geometry.step(expected, points, valid)
        lost = fresh | (off > TRUSTED * self.usual_residual)
        step = _if_any(lost, self._acquired, (step, off, lost, fresh, expected, *hits))
        more, residual = self.geometry.step(expected + step, points, valid)
        few = (valid.sum(1, keepdim=True) < _LEAST_RETURNS).to(step.dtype)
        return self.filter.correct(
            memory, step + more, measurement_noise(residual, self.usual_residual) + _HOPELESS * few
        )

    def _acquired(
        self,
        step: Tensor,
        off: Tensor,
        lost: Tensor,
        fresh: Tensor,
        expected: Tensor,
        *hits: Tensor,
    ) -> Tensor:
        """The steps (B, 3); where `lost` (B, 1), from the coarse position if that fits better."""
        points, _, valid, _ = hits
        other, other_off = self.geometry(self.coarse(*hits), points, valid)
        better = fresh | (other_off < _CLEARLY_BETTER * off)
        return torch.where(lost & better, other - expected, step)

    def sequence(
        self, ranges: Tensor, target: Tensor, commanded_force: Tensor, memory: Tensor | None = None
    ) -> tuple[Tensor, Tensor, Tensor]:
        """T consecutive control steps of B flights, with time as the second axis.

        Args:
          ranges: (B, T, planes * rays) or (B, T, planes, rays).
          target: (B, T, 6).
          commanded_force: (B, T, 3).
          memory: (B, MEMORY); None: that of a flight's start.

        Returns:
          Forces (B, T, 3), estimates (B, T, 6) and the memory after the last step.
        """
        remembered = target.new_zeros(len(target), MEMORY) if memory is None else memory
        forces, estimates = [], []
        for step in range(target.shape[1]):
            frame = ranges[:, step].flatten(1)
            given = target[:, step], commanded_force[:, step], remembered
            force, estimate, remembered = self(frame, *given)
            forces.append(force)
            estimates.append(estimate)
        return torch.stack(forces, dim=1), torch.stack(estimates, dim=1), remembered


def _if_any(flags: Tensor, function: Callable[..., Tensor], given: tuple[Tensor, ...]) -> Tensor:
    """Calls the function if any flag is set; otherwise gives the first argument.

    The exported network too runs the function only if a flag is set.
    """
    if torch.compiler.is_exporting():
        return torch.cond(flags.any(), function, lambda first, *_: first.clone(), given)
    return function(*given) if bool(flags.any()) else given[0]


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


def save_pilot(folder: Path, dimensions: PilotDimensions, pilot: Pilot) -> None:
    """Writes a pilot and its dimensions to `folder`; the file is complete or not there."""
    content = {"shape": dc.asdict(dimensions), "weights": pilot.state_dict()}
    write_tensors(folder / PILOT_FILE, content)


def load_pilot(folder: Path) -> tuple[PilotDimensions, Pilot]:
    """Reads what `save_pilot` wrote.

    Raises:
      InputError: there is no such file, or it holds no pilot.
    """
    path = folder / PILOT_FILE
    try:
        # Only tensors and plain values are read, so that a file from a stranger runs no code.
        content = torch.load(path, map_location="cpu", weights_only=True)
        dimensions = PilotDimensions(**content["shape"])
        pilot = dimensions.make()
        pilot.load_state_dict(content["weights"])
    except Exception as error:  # A damaged file makes torch raise all sorts.
        raise InputError(
            f"{path} is no pilot that `proxops train --recipe proxops` wrote: {error}"
        ) from error
    return dimensions, pilot.eval()
