"""The training loop and its data: order, resuming, early stop, refusals."""

import csv
from pathlib import Path

import numpy as np
import pytest
import torch
from short_flights import kleopatra
from torch import nn

from proxops.systems import InputError, ray_directions
from proxops.systems.ray_caster import ray_caster
from proxops.systems.ray_chords import ChordFan
from proxops.training.lidar_data import (
    cast_grid,
    frame_examples,
    grid_positions,
    holding_ellipsoid,
    random_positions,
    ray_examples,
)
from proxops.training.lidar_networks import FrameNetwork, RayNetwork, frame_loss, ray_loss
from proxops.training.lidar_training import Lesson, Schedule, train
from proxops.training.training_history import learning_rate

SCHEDULE = Schedule(epochs=5, batch=16, learning_rate=1e-1, patience=5)


def squared(network: nn.Module, x: torch.Tensor, y: torch.Tensor) -> torch.Tensor:
    return ((network(x)[:, 0] - y) ** 2).mean()


def lesson(noise: bool = False) -> Lesson:
    """A plane to learn; with `noise`, nothing that validation could gain from."""
    torch.manual_seed(0)
    network = nn.Linear(3, 1)
    x = torch.randn(200, 3)
    y = x @ torch.tensor([1.0, -2.0, 0.5])
    held = torch.randn(64, 3)
    wanted = 100.0 - y[:64] if noise else held @ torch.tensor([1.0, -2.0, 0.5])
    often = torch.arange(10)
    return Lesson("plane", network, squared, (x, y), (held, wanted), often, "test")


class KilledError(Exception):
    pass


def test_learns_and_keeps_curves(tmp_path: Path):
    trained = train(lesson(), SCHEDULE, tmp_path, seed=1)
    losses = [row["validation_loss"] for row in trained.history]
    assert len(losses) == 5
    assert losses[-1] < 0.5 * losses[0]
    assert trained.best_epoch == int(np.argmin(losses))
    with (tmp_path / "curves" / "plane.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [float(row["validation_loss"]) for row in rows] == losses
    assert [float(row["cpu_s"]) for row in rows] == sorted(float(row["cpu_s"]) for row in rows)
    assert list((tmp_path / "curves" / "plane").glob("events.out.tfevents.*"))


@pytest.mark.parametrize("calls", [1, 3, 8])
def test_a_kill_changes_nothing(tmp_path: Path, calls: int):
    whole = lesson()
    train(whole, SCHEDULE, tmp_path / "whole", seed=1)
    told = 0

    def kill(done: float, text: str) -> None:
        nonlocal told
        told += 1
        if told == calls:
            raise KilledError

    with pytest.raises(KilledError):
        train(lesson(), SCHEDULE, tmp_path / "parts", seed=1, progress=kill)
    resumed = lesson()
    nn.init.zeros_(resumed.network.weight)  # pyright: ignore[reportArgumentType]
    if calls == 1:  # No epoch was whole: it begins with what it is given.
        resumed = lesson()
    train(resumed, SCHEDULE, tmp_path / "parts", seed=1)
    for one, other in zip(whole.network.parameters(), resumed.network.parameters(), strict=True):
        assert torch.equal(one, other)


def test_what_is_finished_is_not_trained_again(tmp_path: Path):
    first = train(lesson(), SCHEDULE, tmp_path, seed=1)

    def never(done: float, text: str) -> None:
        raise AssertionError

    again = lesson()
    assert train(again, SCHEDULE, tmp_path, seed=1, progress=never) == first


def test_stops_early_and_keeps_the_best(tmp_path: Path):
    patient = Schedule(epochs=30, batch=16, learning_rate=1e-2, patience=3)
    taught = lesson(noise=True)
    trained = train(taught, patient, tmp_path, seed=1)
    assert len(trained.history) == trained.best_epoch + 1 + 3 < 30
    with torch.no_grad():
        loss = float(squared(taught.network, *taught.validation))
    best = trained.history[trained.best_epoch]["validation_loss"]
    assert loss == pytest.approx(best, rel=1e-5)


def test_seed_sets_the_order(tmp_path: Path):
    ends = []
    for name, seed in (("a", 1), ("b", 1), ("c", 2)):
        taught = lesson()
        train(taught, SCHEDULE, tmp_path / name, seed)
        ends.append(taught.network.weight)
    assert torch.equal(ends[0], ends[1])  # pyright: ignore[reportArgumentType]
    assert not torch.equal(ends[0], ends[2])  # pyright: ignore[reportArgumentType]


def test_checkpoint_of_another_training_is_refused(tmp_path: Path):
    train(lesson(), SCHEDULE, tmp_path, seed=1)
    with pytest.raises(InputError, match="with other settings, data, body or version"):
        train(lesson(), SCHEDULE, tmp_path, seed=2)
    (tmp_path / "plane.ckpt").write_bytes(b"half a checkpo")
    with pytest.raises(InputError, match="is not a checkpoint"):
        train(lesson(), SCHEDULE, tmp_path, seed=1)


def test_a_loss_that_is_no_number_is_said(tmp_path: Path):
    wild = Schedule(epochs=20, batch=16, learning_rate=1e30, patience=20)
    with pytest.raises(InputError, match="lower the learning rate"):
        train(lesson(), wild, tmp_path, seed=1)


def test_learning_rate_rises_then_falls_to_nothing():
    rates = [learning_rate(1e-1, done) for done in np.linspace(0.0, 1.0, 101)]
    assert max(rates) == pytest.approx(1e-1)
    assert int(np.argmax(rates)) == 10
    assert rates[:11] == sorted(rates[:11])
    assert rates[10:] == sorted(rates[10:], reverse=True)
    assert rates[-1] == pytest.approx(0.0, abs=1e-12)


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


@pytest.mark.parametrize("spacing", [-1.0, 0.0, np.nan, 400e3, 150e3])
def test_spacing_that_leaves_nothing_is_refused(spacing: float):
    with pytest.raises(InputError, match="spacing"):
        grid_positions(kleopatra(), 340e3, spacing)


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
    centre, axes = holding_ellipsoid(grid.positions, grid.frames, directions)
    places, rays = np.nonzero(np.isfinite(grid.frames))
    points = grid.positions[places] + grid.frames[places, rays, None] * directions[rays]
    assert np.linalg.norm((points - centre) / axes, axis=1).max() < 1.0
    chords = ChordFan(centre, axes, directions)
    (ends, hit, depth, length), near = ray_examples(chords, grid.positions, grid.frames, 6, 8.0)
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
    network = RayNetwork(width=8, layers=1)
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
    frames = FrameNetwork(rays=5, width=8)
    places = torch.randn(3, 3)
    assert float(frame_loss(frames, places, frames(places) + 3.0)) == pytest.approx(3.0, rel=1e-5)
