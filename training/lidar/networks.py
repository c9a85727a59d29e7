"""The two networks that replace the ray caster: the paper's for frames, and ours for rays."""

from __future__ import annotations

import itertools
import math

import torch
from torch import Tensor, nn

NO_RETURN = -100.0
"""The label of the paper's network for a ray without a return, in its unit of length."""
# Hidden layers of the ray network, and the number of frequencies of its inputs.
_LAYERS, _FREQUENCIES = 4, 4
# Widths of the frame network's hidden layers.
_WIDTHS = (128, 256, 512)


class RayNetwork(nn.Module):
    """Hit probability and depth of one ray, from its chord through an ellipsoid round the body.

    The inputs are the chord's two ends, in coordinates in which the ellipsoid is the unit ball.
    Sines and cosines of rising frequency come first (Tancik et al., NeurIPS 2020), because a plain
    network learns edges slowly. A multilayer perceptron follows. The depth is a share of the chord,
    so that no answer lies outside the ellipsoid.
    """

    def __init__(self, width: int):
        super().__init__()
        sizes = [6 * (1 + 2 * _FREQUENCIES)] + [width] * _LAYERS
        blocks: list[nn.Module] = []
        for wide, narrow in itertools.pairwise(sizes):
            blocks += [nn.Linear(wide, narrow), nn.SiLU()]
        self.layers = nn.Sequential(*blocks, nn.Linear(width, 2))

    def forward(self, chords: Tensor) -> tuple[Tensor, Tensor]:
        """Logit of the hit's probability (K,) and share of the chord before it (K,).

        Args:
          chords: (K, 6), entry and exit as `ChordFan.chords` of `systems.lidar` gives them.
        """
        lifted = [chords]
        for power in range(_FREQUENCIES):
            angle = chords * (math.pi / 2.0 * 2.0**power)
            lifted += [angle.sin(), angle.cos()]
        hit, depth = self.layers(torch.cat(lifted, dim=1)).unbind(dim=1)
        return hit, depth.sigmoid()


class FrameNetwork(nn.Module):
    """The paper's network: a multilayer perceptron from the state to the whole frame.

    The attitude is held to K and a frame does not depend on velocity, so the position suffices.
    """

    def __init__(self, rays: int):
        super().__init__()
        blocks: list[nn.Module] = []
        for wide, narrow in itertools.pairwise((3, *_WIDTHS)):
            blocks += [nn.Linear(wide, narrow), nn.ReLU()]
        self.layers = nn.Sequential(*blocks, nn.Linear(_WIDTHS[-1], rays))

    def forward(self, positions: Tensor) -> Tensor:
        """Frames (N, rays) in the unit of length, near `NO_RETURN` where no ray returns.

        Args:
          positions: (N, 3) in K, in half edges of the cube.
        """
        return 100.0 * self.layers(positions)


def ray_loss(
    network: RayNetwork, chords: Tensor, hit: Tensor, depth: Tensor, length: Tensor
) -> Tensor:
    """Cross-entropy of the hit, plus the absolute error of the depth where the ray hits.

    Args:
      chords: (K, 6).
      hit: (K,) 1 or 0.
      depth: (K,) share of the chord; any number where the ray hits nothing.
      length: (K,) length of the chord, in units in which an error of 1 weighs as much as a nat.
    """
    logit, guess = network(chords)
    entropy = nn.functional.binary_cross_entropy_with_logits(logit, hit)
    error = ((guess - depth).abs() * length * hit).sum() / hit.sum().clamp(min=1.0)
    return entropy + error


def frame_loss(network: FrameNetwork, positions: Tensor, frames: Tensor) -> Tensor:
    """The paper's loss: root mean square error over all rays, with or without a return."""
    return nn.functional.mse_loss(network(positions), frames).sqrt()
