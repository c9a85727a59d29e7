"""Selects a fixed number of returns from a frame and leaves out isolated ones."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn.functional import embedding

from proxops.systems.lidar import ray_directions

# Neighbours of a ray in its plane, and how many of them must agree with its return.
_BESIDE = (-2, -1, 1, 2)
_SUPPORTERS = 2
# Neighbours agree if their ranges differ by less than this share of the range plus this length in m
# at Kleopatra.
_AGREEMENT, _LEAST_AGREEMENT = 0.15, 5e3
# Range in m that replaces no return.
_FAR = 1e9


class HitSelection(nn.Module):
    """Selects up to `count` returns of each frame and gives their points from the spacecraft.

    A return counts as one of the surface if two of the four rays beside it in its plane returned
    from about the same range. Isolated returns, for instance false ones, would spoil every fit.
    """

    toward: Tensor
    order: Tensor
    beside: Tensor

    def __init__(self, planes: int, rays: int, count: int, length: float = 1.0):
        """Takes the lidar's planes and rays, the number of returns, and `Scaling.length`."""
        super().__init__()
        self.count, self.least_agreement = count, _LEAST_AGREEMENT * length
        directions = ray_directions(planes, rays)
        # The planes share the z axis, so rays lie closer together towards it.
        solid = np.sqrt(np.maximum(1.0 - directions[:, 2] ** 2, 0.0)) + 1.0 / rays
        # Rays are preferred in a fixed order that the golden ratio spreads over the sphere.
        order = (np.arange(planes * rays) * 0.6180339887498949) % 1.0 + 0.1
        toward = np.hstack([directions, solid[:, None]])
        for name, values in (("toward", toward), ("order", order)):
            self.register_buffer(name, torch.tensor(values, dtype=torch.float32))
        ray = np.arange(rays)
        beside = np.stack([(ray + shift) % rays for shift in _BESIDE], axis=1)
        beside = beside + rays * np.arange(planes)[:, None, None]
        self.register_buffer("beside", torch.tensor(beside.reshape(-1, len(_BESIDE))))

    def forward(self, ranges: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """Selects returns of frames (B, planes * rays) in m, +inf where no ray returned.

        Returns:
          points: (B, K, 3) in m, relative to the spacecraft.
          solid: (B, K) solid angles, relative to each other; 0 where there is no return.
          valid: (B, K) 1 for a return, 0 for none.
          returned: (B, 1) number of rays that returned.
        """
        found = (ranges < _FAR).to(ranges.dtype)
        value, index = torch.topk(found * self.order, self.count, dim=1)
        # Ranges of the neighbours, whether or not they were selected themselves.
        beside = torch.gather(ranges, 1, embedding(index, self.beside).flatten(1)).clamp(max=_FAR)
        distance = torch.gather(ranges, 1, index).clamp(max=_FAR)
        apart = (beside.unflatten(1, (self.count, -1)) - distance[..., None]).abs()
        agrees = apart < (self.least_agreement + _AGREEMENT * distance)[..., None]
        supported = agrees.to(ranges.dtype).sum(2) >= _SUPPORTERS
        valid = ((value > 0.0) & supported).to(ranges.dtype)
        directions, solid = embedding(index, self.toward).split([3, 1], dim=2)
        points = (valid * distance)[..., None] * directions
        return points, valid * solid[..., 0], valid, found.sum(1, keepdim=True)
