"""The returns of a frame that a network looks at: a fixed number, isolated ones left out."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor, nn

from proxops.systems.lidar import ray_directions

# Neighbours in the plane that must agree with a return, of the two on either side.
_SUPPORTERS = 2
# They agree if their ranges differ by less than this share of the range, and this many metres.
_AGREEMENT, _LEAST_AGREEMENT = 0.15, 5e3


class HitSelection(nn.Module):
    """Picks up to `count` returns of each frame and places them relative to the spacecraft.

    A return is one of a surface if two of the four rays beside it in its plane have returned from
    about as far; isolated ones, for instance false returns, would pull every fit.
    """

    directions: Tensor
    solid_angles: Tensor
    order: Tensor

    def __init__(self, planes: int, rays: int, count: int):
        super().__init__()
        self.planes, self.rays, self.count = planes, rays, count
        directions = ray_directions(planes, rays)
        # The planes meet at their common axis, z: rays crowd together towards it.
        solid = np.sqrt(np.maximum(1.0 - directions[:, 2] ** 2, 0.0)) + 1.0 / rays
        # A fixed order in which rays are preferred, spread over the sphere by the golden ratio.
        order = (np.arange(planes * rays) * 0.6180339887498949) % 1.0 + 0.1
        for name, values in (("directions", directions), ("solid_angles", solid), ("order", order)):
            self.register_buffer(name, torch.tensor(values, dtype=torch.float32))

    def forward(self, ranges: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """Returns of frames (B, planes * rays) in m, +inf where nothing came back.

        Returns points (B, K, 3) in m from the spacecraft, their solid angles (B, K) relative to
        each other and 0 where there is no return, whether (B, K) they are returns, as 0 or 1, and
        how many returns (B, 1) there were in all.
        """
        far = 1e9
        found = (ranges < far).to(ranges.dtype)
        near = torch.where(ranges < far, ranges, torch.full_like(ranges, far))
        plane = near.view(-1, self.planes, self.rays)
        tolerance = _LEAST_AGREEMENT + _AGREEMENT * plane
        support = torch.zeros_like(plane)
        for shift in (1, 2):
            beside = torch.roll(plane, -shift, 2)
            agrees = ((beside - plane).abs() < tolerance).to(ranges.dtype)
            support = support + agrees + torch.roll(agrees, shift, 2)
        kept = found * (support.view_as(ranges) >= _SUPPORTERS).to(ranges.dtype)
        value, index = torch.topk(kept * self.order, self.count, dim=1)
        valid = (value > 0.0).to(ranges.dtype)
        distance = valid * torch.gather(near, 1, index)
        points = distance[..., None] * self.directions[index]
        return points, valid * self.solid_angles[index], valid, kept.sum(1, keepdim=True)
