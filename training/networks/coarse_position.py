"""The position to about a kilometre, from one frame alone; for acquisition."""

from __future__ import annotations

import itertools

import torch
from torch import Tensor, nn

_PAIRS = list(itertools.combinations_with_replacement(range(3), 2))
# Third and fourth moments are products of a pair of coordinates with a third coordinate or another
# pair. Equal products count once.
_KINDS = [tuple(sorted(pair + more)) for pair in _PAIRS for more in [(0,), (1,), (2,), *_PAIRS]]
_DIFFERENT = [_KINDS.index(kind) for kind in sorted(set(_KINDS))]
_WAYS = [way for way in itertools.product((-1.0, 0.0, 1.0), repeat=3) if any(way)]

# The unit of the network's output, as a share of the length.
_CORRECTION = 0.14


class CoarsePosition(nn.Module):
    """A perceptron on features of the returns; it corrects the guess that is minus their centroid.

    The features are the centroid; moments of the returns about it to the fourth order, weighted by
    area and by solid angle; the greatest extent of the returns in 26 directions, from the centroid
    and from the spacecraft; and the number and the solid angle of the returns.
    """

    first: Tensor
    second: Tensor
    different: Tensor
    ways: Tensor
    mean: Tensor
    scale: Tensor

    def __init__(self, length: float, width: int = 256):
        """Takes the unit of length in m, about the body's size, and the width of the layers."""
        super().__init__()
        self.length = length
        ways = torch.tensor(_WAYS)
        self.register_buffer("ways", ways / ways.norm(dim=1, keepdim=True))
        first, second = torch.tensor(_PAIRS).T
        for name, index in (
            ("first", first), ("second", second), ("different", torch.tensor(_DIFFERENT))
        ):  # fmt: skip
            self.register_buffer(name, index.clone())
        size = 9 + 3 + 2 * (len(_PAIRS) + len(_DIFFERENT)) + 2 * len(_WAYS)
        # Mean and scale of the features; `fit_scale` sets them from data.
        self.register_buffer("mean", torch.zeros(size))
        self.register_buffer("scale", torch.ones(size))
        self.network = nn.Sequential(
            nn.Linear(size, width), nn.SiLU(),
            nn.Linear(width, width), nn.SiLU(),
            nn.Linear(width, 3),
        )  # fmt: skip

    def features(
        self, points: Tensor, solid: Tensor, valid: Tensor, count: Tensor
    ) -> tuple[Tensor, Tensor]:
        """Features (B, F) and centroids (B, 3) over the length, of `HitSelection`'s returns."""
        x = points / self.length
        share = count / valid.sum(1, keepdim=True).clamp(min=1.0)
        weights = torch.stack([solid * (x * x).sum(2), solid], dim=1)  # Area, solid angle.
        total = weights.sum(2)
        weights = weights / (total[..., None] + 1e-9)
        centre = (weights[:, :1] @ x)[:, 0]
        away = 2.0 * (x - centre[:, None])
        pairs = away.index_select(2, self.first) * away.index_select(2, self.second)
        weighted = weights[..., None] * pairs[:, None]
        higher = weighted.transpose(2, 3) @ torch.cat([away, pairs], dim=2)[:, None]
        moments = [weights[:, 1:] @ away, 4.0 * weighted.sum(2)]
        moments += [16.0 * higher.flatten(2).index_select(2, self.different)]
        distance = centre.norm(dim=1, keepdim=True)
        seen = x / (x.norm(dim=2, keepdim=True) + 1e-6)
        none = -10.0 * (1.0 - valid)[:, None, :, None]
        reach = torch.stack([away, seen], dim=1) @ self.ways.T + none
        parts = [
            centre, distance, centre / (distance + 1e-6),
            torch.log(share * total + 1e-3),
            *[moment.flatten(1) for moment in [*moments, reach.amax(2)]],
        ]  # fmt: skip
        return torch.cat(parts, dim=1), centre

    def fit_scale(self, features: Tensor) -> None:
        """Sets the features' normalisation from examples (N, F)."""
        self.mean.copy_(features.mean(0))
        self.scale.copy_(features.std(0) + 1e-6)

    def forward(self, points: Tensor, solid: Tensor, valid: Tensor, count: Tensor) -> Tensor:
        """Positions (B, 3) in m in K from the output of `HitSelection`."""
        features, centre = self.features(points, solid, valid, count)
        correction = self.network(self.normalised(features))
        return self.length * (correction * _CORRECTION - centre)

    def normalised(self, features: Tensor) -> Tensor:
        """The network's inputs (N, F) for features (N, F)."""
        return ((features - self.mean) / self.scale).clamp(-6.0, 6.0)

    def wanted(self, position: Tensor, centre: Tensor) -> Tensor:
        """The network's labels (N, 3) at positions (N, 3) in m with centroids (N, 3)."""
        return (position / self.length + centre) / _CORRECTION
