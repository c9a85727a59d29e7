"""`AnyBodyGuidance`: a law of least effort that a network corrects, for any body of a family."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor, nn

from proxops.systems.policy import INPUTS, GuidanceNetwork
from proxops.training.pilot import least_effort, way_round

# Scales of the network's inputs: position errors in the middle and in the near range, and slow
# speeds, in the units of `Surroundings`.
_NEAR_SCALES = (0.05, 0.003)
_SLOW_SCALE = 0.025
# Added to a distance, so that it is never 0.
_LEAST_DISTANCE = 1e-5
# Times and accelerations that the law begins with, in the same units, at a pace of 1: at Kleopatra
# some 240 s and 0.03 m/s^2.
_LEAST_TIME, _ACCELERATION = 0.13, 1.0
# Where the state, the goal, the natural accelerations and the constants are in a row of inputs.
_PARTS = (3, 3, 3, 3, 3, 3, INPUTS - 18)
_FEATURES = 37


class AnyBodyGuidance(nn.Module):
    """The law of least quadratic effort to rest at the goal in a time T, with learned corrections.

    In the units of `Surroundings`, in which the thrust limit is 1, the law is::

        F = 6 e / T^2 - 4 v / T - natural acceleration + correction

    with e the vector to the goal and v the velocity. T is the time of rest-to-rest motion at an
    acceleration that is learned, times the pace. The network gets the row of inputs, and where the
    straight line to the goal comes closest to the ellipsoid. It corrects T, both gains and the
    force, for all that the law leaves out: gravity along the way, the way around the body, fuel and
    limits.
    """

    bends: Tensor
    instead: Tensor

    def __init__(self, width: int, instead: Tensor | None = None):
        """Takes the width of the network's layers, and what it is told instead of its inputs.

        Args:
          width: of three layers.
          instead: (23,) for studies of what the inputs are good for; NaN: the input itself, as all
            are by default. The law always has its inputs.
        """
        super().__init__()
        bends = torch.tensor([*_NEAR_SCALES, _SLOW_SCALE]).repeat_interleave(3)
        self.register_buffer("bends", bends)
        instead = torch.full((INPUTS,), torch.nan) if instead is None else instead
        self.register_buffer("instead", instead, persistent=False)
        self.log_least_time = nn.Parameter(torch.tensor(_LEAST_TIME).log())
        self.log_acceleration = nn.Parameter(torch.tensor(_ACCELERATION).log())
        self.network = nn.Sequential(
            nn.Linear(INPUTS + _FEATURES, width), nn.SiLU(),
            nn.Linear(width, width), nn.SiLU(),
            nn.Linear(width, width), nn.SiLU(),
            nn.Linear(width, 6),
        )  # fmt: skip
        last = self.network[-1]
        assert isinstance(last, nn.Linear)
        with torch.no_grad():
            last.weight.mul_(0.1)
            last.bias.zero_()

    def forward(self, given: Tensor) -> Tensor:
        """Forces (B, 3) over the thrust limit, without limits, for rows (B, 23) of inputs."""
        position, velocity, goal, natural, *_ = given.split(_PARTS, dim=1)
        away = goal - position
        told = torch.where(self.instead.isnan(), given, self.instead)
        row = torch.cat([told, self._features(told)], dim=1)
        thrust, logs = self.network(row).split(3, dim=1)
        log_pace = given[:, -1:].log()
        law = least_effort(
            away,
            velocity,
            away.norm(dim=1, keepdim=True) + _LEAST_DISTANCE,
            logs,
            self.log_acceleration + log_pace,
            self.log_least_time - 0.5 * log_pace,
        )
        return law - natural + thrust

    def _features(self, told: Tensor) -> Tensor:
        """What is computed from the network's inputs (B, 23) for it: (B, 37)."""
        p, v, goal, _, _, axes, _ = told.split(_PARTS, dim=1)
        e = goal - p
        distance, speed = e.norm(dim=1, keepdim=True), v.norm(dim=1, keepdim=True)
        bent = torch.asinh(torch.cat([e, e, v], dim=1) / self.bends)
        unit = [e / (distance + 1e-3), v / (speed + 2.5e-3)]
        here, above, round_it = way_round(p, v, e, axes)
        logs = torch.log(torch.cat([10.0 * distance + 0.01, speed + 1.25e-3, above], 1))
        return torch.cat([bent, *unit, logs, *round_it, here, 2.0 * e], dim=1)

    @torch.no_grad()
    def compiled(self) -> GuidanceNetwork:
        """What flies: the same function of one row, without torch."""
        layers = [layer for layer in self.network if isinstance(layer, nn.Linear)]
        law = torch.stack([self.log_acceleration.exp(), (2.0 * self.log_least_time).exp()])
        parts = [part for layer in layers for part in (layer.weight, layer.bias)]
        arrays = [part.numpy(force=True) for part in (*parts, self.bends, self.instead, law)]
        return GuidanceNetwork(*(np.array(array, dtype=np.float32) for array in arrays))
