"""`DescentCorrection`: what a network adds to the law of a descent, as it is trained."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor, nn

from proxops.systems.policy import DESCENT_INPUTS, DescentNetwork


class DescentCorrection(nn.Module):
    """The same function as `DescentNetwork`, which flies without torch; nothing at first."""

    def __init__(self, width: int):
        """Takes the width of both layers."""
        super().__init__()
        self.first, self.second = nn.Linear(DESCENT_INPUTS, width), nn.Linear(width, width)
        self.last = nn.Linear(width, 3)
        with torch.no_grad():
            for weights in self.last.parameters():
                weights.zero_()

    def forward(self, given: Tensor) -> Tensor:
        """Corrections (B, 3) for rows (B, 22) of `descent_inputs`."""
        hidden = nn.functional.silu(self.first(given.asinh()))
        return self.last(nn.functional.silu(self.second(hidden)))

    @torch.no_grad()
    def compiled(self) -> DescentNetwork:
        """What flies."""
        layers = self.first, self.second, self.last
        parts = [part for layer in layers for part in (layer.weight, layer.bias)]
        return DescentNetwork(*(np.array(part.numpy(force=True)) for part in parts))
