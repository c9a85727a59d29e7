"""The geometry layer on a ball, whose signed distance and normals are known in closed form."""

import numpy as np
import torch
from torch import Tensor, nn

from proxops.training.networks.geometry_layer import GeometryLayer, SurfaceField, _solve

RADIUS = 50e3


class Ball(nn.Module):
    def forward(self, points: Tensor) -> Tensor:
        distance = points.norm(dim=-1, keepdim=True)
        return torch.cat([distance - RADIUS, points / distance], dim=-1)


def seen_from(position: Tensor, count: int, seed: int) -> Tensor:
    """Points (count, 3) of the ball's near side, from the spacecraft."""
    ways = torch.randn(4 * count, 3, generator=torch.Generator().manual_seed(seed))
    ways = ways / ways.norm(dim=1, keepdim=True)
    near = ways[(ways @ (position / position.norm())) > RADIUS / float(position.norm())]
    return RADIUS * near[:count] - position


def test_steps_lead_to_where_the_returns_lie_on_the_surface():
    truth = torch.tensor([[120e3, 30e3, -20e3]])
    points = seen_from(truth[0], 64, 0)[None]
    layer = GeometryLayer(Ball(), outlier=1e3)  # pyright: ignore[reportArgumentType]
    place = truth + torch.tensor([[900.0, -700.0, 400.0]])
    valid = torch.ones(1, 64)
    _, first = layer(place, points, valid)
    for _ in range(6):
        place, _ = layer(place, points, valid)
    _, residual = layer(place, points, valid)
    assert float((place - truth).norm()) < 5.0
    assert float(residual) < 1.0 < float(first)


def test_solution_is_numpys():
    factors = torch.randn(20, 3, 3, generator=torch.Generator().manual_seed(0))
    matrix, right = factors @ factors.transpose(1, 2), factors[:, 0]
    damped = matrix.numpy() + 1e-2 * np.eye(3)
    expected = np.linalg.solve(damped, right.numpy()[..., None])[..., 0]
    np.testing.assert_allclose(_solve(matrix, right).numpy(), expected, rtol=2e-2, atol=2e-2)


def test_field_is_linear_between_its_points_and_constant_beyond():
    field = SurfaceField(np.full(3, -10e3), np.full(3, 10e3), 5e3)
    grid = [np.linspace(-10e3, 10e3, 5)] * 3
    places = np.stack(np.meshgrid(*grid, indexing="ij"), axis=-1)
    slope = np.array([[0.1, -0.2, 0.3, 0.05], [0.2, 0.1, 0.0, -0.1], [-0.3, 0.2, 0.1, 0.2]]) / 5e3
    with torch.no_grad():
        field.values.copy_(torch.tensor((places @ slope).T[None]))
    points = np.random.default_rng(0).uniform(-9.9e3, 9.9e3, (50, 3))
    units = np.array([5e3, 1.0, 1.0, 1.0])
    found = field(torch.tensor(points, dtype=torch.float32)).detach().numpy()
    np.testing.assert_allclose(found, points @ slope * units, rtol=1e-4, atol=2e-2)
    ends = field(torch.tensor([[10e3, 0.0, 0.0], [50e3, 0.0, 0.0]]))
    torch.testing.assert_close(ends[0], ends[1])
