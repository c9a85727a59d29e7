"""The position to some 30 m: the returns are fitted to a learned map of the surface."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor, nn

# Least residual over the outlier distance, so that the root has a finite slope at 0.
_LEAST_RESIDUAL = 3e-5
# Added to the normal equations, whose trace is about 1.
_DAMPING = 1e-2
# Indices of the entries, row by row, whose products are the cofactors of a symmetric 3 by 3 matrix:
# the product of the first two groups less that of the last two. Each row of the adjugate is the
# cross product of the other two rows.
_AHEAD, _BEHIND = np.array([1, 2, 0]), np.array([2, 0, 1])
_FACTORS = np.concatenate(
    [
        (3 * rows[:, None] + columns).ravel()
        for rows, columns in (
            (_AHEAD, _AHEAD), (_BEHIND, _BEHIND), (_AHEAD, _BEHIND), (_BEHIND, _AHEAD),
        )
    ]
)  # fmt: skip


class SurfaceField(nn.Module):
    """A learned grid of four channels: signed distance and normal of the body's surface.

    Between grid points the field is trilinear, and beyond the grid it is constant.
    """

    units: Tensor
    centre: Tensor
    reach: Tensor

    def __init__(self, low: np.ndarray, high: np.ndarray, spacing: float):
        """Takes the corners (3,) of a box around the body and the grid's spacing, all in m.

        The field starts as that of an ellipsoid in the box.
        """
        super().__init__()
        axes = [
            a + spacing * np.arange(np.ceil((b - a) / spacing) + 1)
            for a, b in zip(low, high, strict=True)
        ]
        grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
        centre, half = 0.5 * (low + high), 0.4 * (high - low)
        level = np.linalg.norm((grid - centre) / half, axis=-1, keepdims=True)
        normal = (grid - centre) / half**2
        normal /= np.linalg.norm(normal, axis=-1, keepdims=True) + 1e-12
        start = np.concatenate([(level - 1.0) * half.min() / spacing, normal], axis=-1)
        # (1, channels, z, y, x), as grid_sample takes it.
        self.values = nn.Parameter(torch.tensor(start.T[None], dtype=torch.float32))
        ends = np.array([[axis[0], axis[-1]] for axis in axes])
        for name, values in (
            ("units", np.array([spacing, 1.0, 1.0, 1.0])),
            ("centre", ends.mean(1)),
            ("reach", 0.5 * (ends[:, 1] - ends[:, 0])),
        ):
            self.register_buffer(name, torch.tensor(values, dtype=torch.float32))

    def forward(self, points: Tensor) -> Tensor:
        """Signed distance in m, then normal (3), at points (..., 3) in m in K: (..., 4)."""
        places = ((points - self.centre) / self.reach).view(1, 1, 1, -1, 3)
        found = nn.functional.grid_sample(
            self.values, places, mode="bilinear", padding_mode="border", align_corners=True
        )
        return found.view(4, *points.shape[:-1]).movedim(0, -1) * self.units


class GeometryLayer(nn.Module):
    """Gauss-Newton steps that move a position until the returns lie on the learned surface."""

    def __init__(self, field: SurfaceField, outlier: float):
        """Takes the field, and the distance from it in m above which returns count less."""
        super().__init__()
        self.field, self.outlier = field, outlier

    def forward(self, position: Tensor, points: Tensor, valid: Tensor) -> tuple[Tensor, Tensor]:
        """Takes one step from positions (B, 3) in m in K, with returns (B, K, 3) relative to them.

        Returns:
          The new positions (B, 3), and the residual of `step`.
        """
        step, residual = self.step(position, points, valid)
        return position + step, residual

    def step(self, position: Tensor, points: Tensor, valid: Tensor) -> tuple[Tensor, Tensor]:
        """Computes one step; adding it to a position in single precision would round it.

        Returns:
          The step (B, 3) in m, and the root mean square (B, 1) in m of the returns' distances from
          the surface before the step, in which large distances count less.
        """
        values = self.field(position[:, None] + points)
        distance = values[..., :1]
        weight = valid[..., None] * self.outlier / (self.outlier + distance.abs())
        # Weighted means of the squares and products of distance and normal.
        total = weight.sum(1, keepdim=True).clamp(min=1.0)
        moments = (weight * values).transpose(1, 2) @ values / total
        residual = torch.sqrt(moments[:, 0, :1] + (_LEAST_RESIDUAL * self.outlier) ** 2)
        return -_solve(moments[:, 1:, 1:], moments[:, 1:, 0]), residual


def _solve(matrix: Tensor, right: Tensor) -> Tensor:
    """Solves (A + damping) x = b for x (B, 3) with symmetric A (B, 3, 3), by cofactors."""
    a = (matrix + _DAMPING * torch.eye(3, dtype=matrix.dtype, device=matrix.device)).flatten(1)
    factors = a.index_select(1, torch.tensor(_FACTORS, device=a.device))
    first, second, third, fourth = factors.split(9, dim=1)
    cofactors = first * second - third * fourth
    determinant = (a[:, :3] * cofactors[:, :3]).sum(1, keepdim=True)
    return (cofactors.unflatten(1, (3, 3)) * right[:, None]).sum(2) / determinant
