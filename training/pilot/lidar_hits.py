"""The returns of a frame that a network looks at: a fixed number, isolated ones left out."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn.functional import embedding

from proxops.systems.lidar import ray_directions

# Neighbours in the plane, and how many of them must agree with a return.
_BESIDE = (-2, -1, 1, 2)
_SUPPORTERS = 2
# They agree if their ranges differ by less than this share of the range, and a length in m, which
# is this one at Kleopatra.
_AGREEMENT, _LEAST_AGREEMENT = 0.15, 5e3
# Stands for no return, in m.
_FAR = 1e9


class HitSelection(nn.Module):
    """Picks up to `count` returns of each frame and places them relative to the spacecraft.

    A return is one of a surface if two of the four rays beside it in its plane have returned from
    about as far; isolated ones, for instance false returns, would pull every fit.
    """

    toward: Tensor
    order: Tensor
    beside: Tensor

    def __init__(self, planes: int, rays: int, count: int, length: float = 1.0):
        """`length`: see `Scaling`."""
        super().__init__()
        self.count, self.least_agreement = count, _LEAST_AGREEMENT * length
        directions = ray_directions(planes, rays)
        # The planes meet at their common axis, z: rays crowd together towards it.
        solid = np.sqrt(np.maximum(1.0 - directions[:, 2] ** 2, 0.0)) + 1.0 / rays
        # A fixed order in which rays are preferred, spread over the sphere by the golden ratio.
        order = (np.arange(planes * rays) * 0.6180339887498949) % 1.0 + 0.1
        toward = np.hstack([directions, solid[:, None]])
        for name, values in (("toward", toward), ("order", order)):
            self.register_buffer(name, torch.tensor(values, dtype=torch.float32))
        ray = np.arange(rays)
        beside = np.stack([(ray + shift) % rays for shift in _BESIDE], axis=1)
        beside = beside + rays * np.arange(planes)[:, None, None]
        self.register_buffer("beside", torch.tensor(beside.reshape(-1, len(_BESIDE))))

    def forward(self, ranges: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """Returns of frames (B, planes * rays) in m, +inf where nothing came back.

        Returns points (B, K, 3) in m from the spacecraft, their solid angles (B, K) relative to
        each other and 0 where there is no return, whether (B, K) they are returns, as 0 or 1, and
        how many rays (B, 1) returned in all.
        """
        found = (ranges < _FAR).to(ranges.dtype)
        value, index = torch.topk(found * self.order, self.count, dim=1)
        # Of rays that are neighbours, whether or not they were picked themselves.
        beside = torch.gather(ranges, 1, embedding(index, self.beside).flatten(1)).clamp(max=_FAR)
        distance = torch.gather(ranges, 1, index).clamp(max=_FAR)
        apart = (beside.unflatten(1, (self.count, -1)) - distance[..., None]).abs()
        agrees = apart < (self.least_agreement + _AGREEMENT * distance)[..., None]
        supported = agrees.to(ranges.dtype).sum(2) >= _SUPPORTERS
        valid = ((value > 0.0) & supported).to(ranges.dtype)
        directions, solid = embedding(index, self.toward).split([3, 1], dim=2)
        points = (valid * distance)[..., None] * directions
        return points, valid * solid[..., 0], valid, found.sum(1, keepdim=True)
