"""Where the spacecraft is, to some 30 m: returns fitted to a learned field of the surface."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor, nn

# Of the residual, over the distance from which on returns count less, so that it has a slope at 0.
_LEAST_RESIDUAL = 3e-5
# Added to the normal equations, whose trace is about 1.
_DAMPING = 1e-2
# Of a matrix's nine entries, row by row, those of which its nine cofactors are made: products of
# the first two kinds less products of the last two. Rows of the adjugate of a symmetric matrix are
# cross products of the other two rows.
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
    """Signed distance and normal of the body's surface as a grid of four learned channels.

    Between grid points it is trilinear, beyond the grid constant.
    """

    units: Tensor
    centre: Tensor
    reach: Tensor

    def __init__(self, low: np.ndarray, high: np.ndarray, spacing: float):
        """Takes the corners (3,) of a box round the body and the grid's spacing, all in m.

        It starts as that of an ellipsoid in the box.
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
    """Gauss-Newton steps of a position towards where the returns lie on the learned surface."""

    def __init__(self, field: SurfaceField, outlier: float):
        """`outlier`: returns farther than this from the surface, in m, count less (Huber)."""
        super().__init__()
        self.field, self.outlier = field, outlier

    def forward(self, position: Tensor, points: Tensor, valid: Tensor) -> tuple[Tensor, Tensor]:
        """One step from positions (B, 3), in m in K, with returns (B, K, 3) relative to them.

        Returns the new positions, and the residual as `step` does.
        """
        step, residual = self.step(position, points, valid)
        return position + step, residual

    def step(self, position: Tensor, points: Tensor, valid: Tensor) -> tuple[Tensor, Tensor]:
        """The step (B, 3) alone, in m, which positions would round.

        Beside it the root mean square (B, 1) of the distances, in m, that the returns had from the
        surface before the step, large ones counted less.
        """
        values = self.field(position[:, None] + points)
        distance = values[..., :1]
        weight = valid[..., None] * self.outlier / (self.outlier + distance.abs())
        # Of distance and normal: squares and products, each a weighted mean.
        total = weight.sum(1, keepdim=True).clamp(min=1.0)
        moments = (weight * values).transpose(1, 2) @ values / total
        residual = torch.sqrt(moments[:, 0, :1] + (_LEAST_RESIDUAL * self.outlier) ** 2)
        return -_solve(moments[:, 1:, 1:], moments[:, 1:, 0]), residual


def _solve(matrix: Tensor, right: Tensor) -> Tensor:
    """x (B, 3) of (A + damping) x = b for symmetric A (B, 3, 3), by cofactors."""
    a = (matrix + _DAMPING * torch.eye(3, dtype=matrix.dtype)).flatten(1)
    factors = a.index_select(1, torch.tensor(_FACTORS, device=a.device))
    first, second, third, fourth = factors.split(9, dim=1)
    cofactors = first * second - third * fourth
    determinant = (a[:, :3] * cofactors[:, :3]).sum(1, keepdim=True)
    return (cofactors.unflatten(1, (3, 3)) * right[:, None]).sum(2) / determinant
