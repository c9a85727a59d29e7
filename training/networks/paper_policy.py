"""The paper's policy: convolutions over lidar frames, an LSTM, and a perceptron for the force."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

import torch
from torch import Tensor, nn

from proxops.systems.common import InputError
from proxops.training.data import Normalisation

NO_RETURN = -100.0
"""The network's input for a ray without a return; other ranges are in km."""

_KERNEL, _STRIDE = 7, 4
# A convolution goes round: so many places at each end of a plane are joined to the other end.
_BORROWED = _KERNEL // 2


class PaperPolicy(nn.Module):
    """Frames with -100 for no return → CNN → LSTM; joined with the goal → MLP → force per axis.

    The paper (Quinn, Nehma, Tiwari, IEEE Aerospace 2025) gives the kinds of layers and their
    order, not their sizes. Here each plane of the lidar is a channel. Convolutions go round along
    its rays, because the first and the last ray are neighbours. Their strides reduce a frame to a
    few numbers, so that the network is fast on a CPU.

    The memory (M,) is the LSTM's h and c of all layers, zeros at the start of a flight.
    Normalisation is part of the module.
    """

    mean_range: Tensor
    motion_scale: Tensor
    force_scale: Tensor

    def __init__(
        self,
        normalisation: Normalisation,
        planes: int,
        rays: int,
        channels: Sequence[int] = (32, 64, 64),
        width: int = 128,
        layers: int = 2,
    ):
        """Makes a policy with random weights.

        Args:
          normalisation: scales of the training flights.
          planes, rays: number of planes, and of rays in a plane, of the lidar.
          channels: output channels of each convolution.
          width: width of the LSTM and of the perceptron.
          layers: number of the LSTM's layers.

        Raises:
          InputError: a plane has too few rays for that many convolutions.
        """
        super().__init__()
        self.planes, self.rays, self.width, self.depth = planes, rays, width, layers
        self.memory_size = 2 * layers * width
        scales = normalisation
        motion = [
            scales.position.mean + scales.velocity.mean,
            scales.position.std + scales.velocity.std,
        ]
        self.register_buffer("mean_range", torch.tensor(scales.range.mean))
        self.register_buffer("motion_scale", torch.tensor(motion))
        self.register_buffer("force_scale", torch.tensor([scales.force.mean, scales.force.std]))
        blocks: list[nn.Module] = []
        places = rays
        for taken, given in itertools.pairwise([planes, *channels]):
            if places < _BORROWED:
                raise InputError(
                    f"the paper's policy takes {len(channels)} convolutions along a plane of the "
                    f"lidar, and {rays} rays are too few for them"
                )
            blocks += [
                nn.Conv1d(
                    taken, given, _KERNEL, _STRIDE, padding=_BORROWED, padding_mode="circular"
                ),
                nn.ReLU(),
            ]
            places = -(-places // _STRIDE)
        self.convolutions = nn.Sequential(
            *blocks, nn.Flatten(), nn.Linear(channels[-1] * places, width), nn.ReLU()
        )
        self.recurrent = nn.LSTM(width, width, layers, batch_first=True)
        self.perceptron = nn.Sequential(
            nn.Linear(width + 6, width),
            nn.ReLU(),
            nn.Linear(width, width),
            nn.ReLU(),
            nn.Linear(width, 3),
        )

    def forward(
        self, ranges: Tensor, target: Tensor, commanded_force: Tensor, memory: Tensor
    ) -> tuple[Tensor, Tensor, Tensor]:
        """One step of B flights: ranges (B, planes * rays), and so on as of `sequence`."""
        force, estimate, memory = self.sequence(
            ranges[:, None], target[:, None], commanded_force[:, None], memory
        )
        return force[:, 0], estimate[:, 0], memory

    def sequence(
        self, ranges: Tensor, target: Tensor, commanded_force: Tensor, memory: Tensor | None = None
    ) -> tuple[Tensor, Tensor, Tensor]:
        """T consecutive steps, with the same result as T calls of `forward`.

        Args:
          ranges: (B, T, planes * rays) or (B, T, planes, rays) m; +inf where nothing returned.
          target: (B, T, 6) m and m/s in K.
          commanded_force: (B, T, 3) N; the paper's policy does not use it.
          memory: (B, M) from the step before; None: zeros, as at the first step.

        Returns:
          force: (B, T, 3) N in K. estimate: (B, T, 6) of the state: NaN, because there is none.
          memory: (B, M) after the last step.
        """
        batch, steps = target.shape[:2]
        if memory is None:
            memory = target.new_zeros(batch, self.memory_size)
        frames = self.network_frames(ranges.reshape(-1, self.planes, self.rays))
        seen = self.convolutions(frames).reshape(batch, steps, self.width)
        # The LSTM wants (layers, B, width), twice.
        h, c = memory.reshape(batch, 2, self.depth, self.width).permute(1, 2, 0, 3).unbind(0)
        seen, (h, c) = self.recurrent(seen, (h.contiguous(), c.contiguous()))
        memory = torch.stack([h, c]).permute(2, 0, 1, 3).reshape(batch, self.memory_size)
        mean, std = self.motion_scale
        joined = torch.cat([seen, (target - mean) / std], dim=-1)
        mean, std = self.force_scale
        force = self.perceptron(joined) * std + mean
        return force, torch.full_like(target, math.nan), memory

    def network_frames(self, ranges: Tensor) -> Tensor:
        """The network's input: ranges in km and -100 for no return, shifted and scaled.

        The value -100 becomes 0, and the mean of the ranges that returned becomes 1. Most of a
        frame is -100, and a network learns slowly if most of its inputs are a large constant.
        """
        filled = torch.where(torch.isfinite(ranges), 1e-3 * ranges, NO_RETURN)
        return (filled - NO_RETURN) / (1e-3 * self.mean_range - NO_RETURN)
