"""The learned pilot: one network from lidar frame, goal and applied force to force."""

from __future__ import annotations

import torch
from torch import Tensor, nn

from proxops.training.coarse_position import CoarsePosition
from proxops.training.geometry_layer import GeometryLayer
from proxops.training.guidance import Guidance
from proxops.training.lidar_hits import HitSelection
from proxops.training.state_filter import MEMORY, StateFilter, doubt

# With fewer returns than this a frame says nothing of where it was taken.
_LEAST_RETURNS = 8
# The fit starts from the coarse position if the returns then lie this much nearer to the surface.
_CLEARLY_BETTER = 0.5
# Doubt of a fix from hardly any returns.
_HOPELESS = 100.0


class Pilot(nn.Module):
    """Five parts in a row, any of which can be trained by itself.

    ```
    ranges ─► hits ─► coarse ─────► geometry ─► filter ─► guidance ─► force
                 └──────────────────►  ▲        │ ▲ ▲         ▲
                                       └ memory ┘ │ │         │
    applied_force ────────────────────────────────┘ │         │
    target ─────────────────────────────────────────┼─────────┘
                                              next memory
    ```

    The geometry layer starts from where the filter expects to be and from the coarse position,
    and keeps what fits the surface better. What the filter finds to push besides the learned
    motion is countered.
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
        # Of returns from the learned surface at a good fix, in m; set by `fit_residual`.
        self.register_buffer("usual_residual", torch.ones(()))

    def fit_residual(self, residuals: Tensor) -> None:
        """Sets the usual residual from those of good fixes."""
        self.usual_residual.copy_(residuals.median())

    def forward(
        self, ranges: Tensor, target: Tensor, applied_force: Tensor, memory: Tensor
    ) -> tuple[Tensor, Tensor, Tensor]:
        """One control step of B flights; SI, in K.

        Args:
          ranges: (B, planes * rays), +inf where nothing returned.
          target: (B, 6). applied_force: (B, 3), over the period before.
          memory: (B, MEMORY), zeros before a flight's first step.

        Returns:
          Forces (B, 3) within the limits, estimates (B, 6) of position and velocity, and the next
          memory.
        """
        memory = self.see(ranges, applied_force, memory)
        force = self.guidance(memory[:, :3], memory[:, 3:6], target[:, :3])
        force = force - self.guidance.mass * memory[:, 6:9]
        limit = self.guidance.thrust_limit
        return force.clamp(-limit, limit), memory[:, :6], memory

    def see(self, ranges: Tensor, applied_force: Tensor, memory: Tensor) -> Tensor:
        """The memory after a frame and the force over the period before it."""
        points, solid, valid, count = self.hits(ranges)
        coarse = self.coarse(points, solid, valid, count)
        memory = self.filter.predict(memory, applied_force)
        started = memory[:, -1:]
        expected = started * memory[:, :3] + (1.0 - started) * coarse
        twice, both = torch.cat([points, points]), torch.cat([valid, valid])
        places, residuals = self.geometry(torch.cat([expected, coarse]), twice, both)
        (near, far), (near_off, far_off) = places.chunk(2), residuals.chunk(2)
        lost = (far_off < _CLEARLY_BETTER * near_off).to(near.dtype)
        fix, residual = self.geometry(lost * far + (1.0 - lost) * near, points, valid)
        few = (valid.sum(1, keepdim=True) < _LEAST_RETURNS).to(near.dtype)
        return self.filter.correct(
            memory, fix, doubt(residual, self.usual_residual) + _HOPELESS * few
        )

    def sequence(
        self, ranges: Tensor, target: Tensor, applied_force: Tensor, memory: Tensor | None = None
    ) -> tuple[Tensor, Tensor, Tensor]:
        """T control steps of B flights in a row: `forward`, with time as the second axis.

        Args:
          ranges: (B, T, ...), whatever axes a frame has. memory: None: as at a flight's start.
        """
        remembered = target.new_zeros(len(target), MEMORY) if memory is None else memory
        forces, estimates = [], []
        for step in range(target.shape[1]):
            frame = ranges[:, step].flatten(1)
            given = target[:, step], applied_force[:, step], remembered
            force, estimate, remembered = self(frame, *given)
            forces.append(force)
            estimates.append(estimate)
        return torch.stack(forces, dim=1), torch.stack(estimates, dim=1), remembered
