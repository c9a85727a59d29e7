"""Where the spacecraft is, to some 20 m: returns fitted to a learned field of the surface."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor, nn

# Added to the normal equations, whose trace is about 1.
_DAMPING = 1e-2


class SurfaceField(nn.Module):
    """Signed distance and normal of the body's surface as a grid of four learned channels.

    Between grid points it is trilinear, beyond the grid constant.
    """

    low: Tensor
    units: Tensor
    last: Tensor
    corners: Tensor

    def __init__(self, low: np.ndarray, high: np.ndarray, spacing: float):
        """Takes the corners (3,) of a box round the body and the grid's spacing, all in m.

        It starts as that of an ellipsoid in the box.
        """
        super().__init__()
        self.size = [int(n) + 1 for n in np.ceil((high - low) / spacing)]
        self.spacing = spacing
        axes = [a + spacing * np.arange(n) for a, n in zip(low, self.size, strict=True)]
        grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
        centre, half = 0.5 * (low + high), 0.4 * (high - low)
        level = np.linalg.norm((grid - centre) / half, axis=1, keepdims=True)
        normal = (grid - centre) / half**2
        normal /= np.linalg.norm(normal, axis=1, keepdims=True) + 1e-12
        start = np.hstack([(level - 1.0) * half.min() / spacing, normal])
        self.values = nn.Parameter(torch.tensor(start, dtype=torch.float32))
        _, ny, nz = self.size
        corners = [(a * ny + b) * nz + c for a in (0, 1) for b in (0, 1) for c in (0, 1)]
        self.register_buffer("units", torch.tensor([spacing, 1.0, 1.0, 1.0]))
        self.register_buffer("low", torch.tensor(low, dtype=torch.float32))
        self.register_buffer("corners", torch.tensor(corners))
        self.register_buffer("last", torch.tensor(self.size, dtype=torch.float32) - 1.001)

    def forward(self, points: Tensor) -> Tensor:
        """Signed distance in m, then normal (3), at points (..., 3) in m in K: (..., 4)."""
        place = torch.minimum(((points - self.low) / self.spacing).clamp(min=0.0), self.last)
        cell = place.floor()
        _, ny, nz = self.size
        first = (cell[..., 0] * ny + cell[..., 1]) * nz + cell[..., 2]
        values = self.values[first.long()[..., None] + self.corners]
        share = place - cell
        x, y, z = torch.stack([1.0 - share, share], dim=-1).unbind(-2)
        weights = x[..., :, None, None] * y[..., None, :, None] * z[..., None, None, :]
        return (weights.flatten(-3)[..., None, :] @ values)[..., 0, :] * self.units


class GeometryLayer(nn.Module):
    """Gauss-Newton steps of a position towards where the returns lie on the learned surface."""

    def __init__(self, field: SurfaceField, outlier: float):
        """`outlier`: returns farther than this from the surface, in m, count less (Huber)."""
        super().__init__()
        self.field, self.outlier = field, outlier

    def forward(self, position: Tensor, points: Tensor, valid: Tensor) -> tuple[Tensor, Tensor]:
        """One step from positions (B, 3), in m in K, with returns (B, K, 3) relative to them.

        Returns the new positions and the root mean square (B, 1) of the distances, in m, that the
        returns had from the surface before the step, large ones counted less.
        """
        values = self.field(position[:, None] + points)
        distance = values[..., :1]
        weight = valid[..., None] * self.outlier / (self.outlier + distance.abs())
        # Of distance and normal: squares and products, each a weighted mean.
        total = weight.sum(1, keepdim=True).clamp(min=1.0)
        moments = (weight * values).transpose(1, 2) @ values / total
        residual = torch.sqrt(moments[:, 0, :1] + 1e-3)
        return position - _solve(moments[:, 1:, 1:], moments[:, 1:, 0]), residual


def _solve(matrix: Tensor, right: Tensor) -> Tensor:
    """x (B, 3) of (A + damping) x = b for symmetric A (B, 3, 3), by cofactors."""
    a = matrix + _DAMPING * torch.eye(3, dtype=matrix.dtype)
    ahead, behind = a[:, [1, 2, 0]], a[:, [2, 0, 1]]
    # Rows are the cross products of the other two rows: the adjugate, as A is symmetric.
    cofactors = ahead[:, :, [1, 2, 0]] * behind[:, :, [2, 0, 1]]
    cofactors = cofactors - ahead[:, :, [2, 0, 1]] * behind[:, :, [1, 2, 0]]
    determinant = (a[:, 0] * cofactors[:, 0]).sum(1, keepdim=True)
    return (cofactors @ right[..., None])[..., 0] / determinant
