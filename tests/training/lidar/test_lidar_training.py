"""The lidar networks' training examples, and how fast the networks learn."""

import numpy as np
import pytest
import torch
from short_flights import kleopatra

from proxops.systems import ray_directions
from proxops.systems.lidar.ray_chords import ChordFan
from proxops.systems.shapes.ray_casting import ray_caster
from proxops.training.lidar.frames import (
    cast_grid,
    enclosing_ellipsoid,
    frame_examples,
    grid_positions,
    random_positions,
    ray_examples,
)
from proxops.training.lidar.networks import FrameNetwork, RayNetwork, frame_loss, ray_loss

# --- data -----------------------------------------------------------------------------------------


def test_grid_fills_the_cube_outside_the_body():
    body = kleopatra()
    grid = grid_positions(body, 340e3, 20e3)
    lines = [np.unique(grid[:, axis]) for axis in range(3)]
    for line in lines:
        assert line == pytest.approx(np.arange(-170e3, 171e3, 20e3), abs=1e-6)
    inside = 18**3 - len(grid)
    # The body's share of the grid is its share of the cube, within the grid's coarseness.
    assert inside == pytest.approx(body.shape.volume / (20e3) ** 3, rel=0.15)
    assert not body.gravity_field.evaluate(grid).inside.any()
    assert np.abs(grid_positions(body, 340e3, 50e3)).max() == pytest.approx(150e3)


def test_random_positions_repeat_and_lie_outside():
    body = kleopatra()
    places = random_positions(body, 340e3, 500, 7)
    assert np.array_equal(places, random_positions(body, 340e3, 500, 7))
    assert places.shape == (500, 3)
    assert np.abs(places).max() <= 170e3
    assert not body.gravity_field.evaluate(places).inside.any()


def test_ray_examples_say_where_the_surface_is():
    """The depth of a chord leads back to the true range, and no return is lost."""
    body = kleopatra()
    directions = ray_directions(6, 60)
    fan = ray_caster(body.shape).fan(directions)
    grid = cast_grid(body, fan, 340e3, 60e3, seed=3)
    assert grid.held_out.sum() == len(grid.positions) // 20
    centre, axes = enclosing_ellipsoid(grid.positions, grid.frames, directions)
    places, rays = np.nonzero(np.isfinite(grid.frames))
    points = grid.positions[places] + grid.frames[places, rays, None] * directions[rays]
    assert np.linalg.norm((points - centre) / axes, axis=1).max() < 1.0
    chords = ChordFan(centre, axes, directions)
    (ends, hit, depth, length), near = ray_examples(chords, grid.positions, grid.frames, 6)
    assert int(hit.sum()) == np.isfinite(grid.frames).sum()
    seen = hit.numpy() == 1.0
    assert 0.0 < depth.numpy()[seen].min() < depth.numpy()[seen].max() < 1.0
    unit = ends[:, :3] + depth[:, None] * (ends[:, 3:] - ends[:, :3])
    assert unit.numpy()[seen] * axes + centre == pytest.approx(points, abs=1.0)
    assert near.shape == hit.shape
    assert 0 < int(near.sum()) < len(near)
    whole = np.linalg.norm((ends[:, 3:] - ends[:, :3]).numpy() * axes, axis=1)
    assert length.numpy() == pytest.approx(8.0 * whole / np.cbrt(axes.prod()), rel=1e-4)


def test_frame_examples_are_the_papers():
    frames = np.array([[120e3, np.inf, 3e3]], dtype=np.float32)
    positions, targets = frame_examples(np.array([[170e3, 0.0, -85e3]]), frames, 340e3)
    assert positions.tolist() == [[1.0, 0.0, -0.5]]
    assert targets.numpy() == pytest.approx(np.array([[120.0, -100.0, 3.0]]))
    assert np.isinf(frames[0, 1])  # Those given are left as they are.


@torch.no_grad()
def test_losses():
    torch.manual_seed(0)
    network = RayNetwork(width=8)
    chords = torch.randn(4, 6)
    logit, depth = network(chords)
    hit, length = torch.tensor([1.0, 0.0, 1.0, 0.0]), torch.tensor([2.0, 9.0, 4.0, 9.0])
    wanted = torch.tensor([0.5, 0.0, 0.25, 0.0])
    chance = torch.sigmoid(logit)
    entropy = -(hit * chance.log() + (1 - hit) * (1 - chance).log()).mean()
    error = (2.0 * (depth[0] - 0.5).abs() + 4.0 * (depth[2] - 0.25).abs()) / 2.0
    got = ray_loss(network, chords, hit, wanted, length)
    assert float(got) == pytest.approx(float(entropy + error), rel=1e-5)
    assert torch.isfinite(ray_loss(network, chords, torch.zeros(4), wanted, length))
    frames = FrameNetwork(rays=5)
    places = torch.randn(3, 3)
    assert float(frame_loss(frames, places, frames(places) + 3.0)) == pytest.approx(3.0, rel=1e-5)
