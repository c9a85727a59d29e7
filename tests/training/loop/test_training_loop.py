"""The training loop: learning, the best epoch, resuming, budgets, refusals."""

import csv
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import torch
from torch import Tensor, nn

from proxops.systems import InputError
from proxops.training.data import PackedFlights
from proxops.training.loop import WindowDataset
from proxops.training.loop.tensor_batches import TensorBatches
from proxops.training.loop.training_loop import Schedule, TrainingTask, train
from proxops.training.loop.windows import Batch, WindowBatches

SCHEDULE = Schedule(epochs=4, batch=3, learning_rate=3e-2, patience=4)


class Straight(nn.Module):
    """Says a force from the true state, forgetting some of it by chance while it learns."""

    def __init__(self):
        super().__init__()
        self.layer = nn.Sequential(nn.Dropout(0.1), nn.Linear(6, 3))

    def sequence(self, state: Tensor) -> Tensor:
        return self.layer(state)


def squares(policy: Straight, batch: Batch) -> Tensor:
    return ((policy.sequence(batch["state"]) - batch["mpc_force"]) ** 2).mean()


def task(
    packed: PackedFlights,
    loss: Callable[[Any, Batch], Tensor] = squares,
    batch: int = SCHEDULE.batch,
) -> TrainingTask:
    torch.manual_seed(0)
    batches, held = (
        WindowBatches(WindowDataset(packed, part, 4, 1), batch, shuffle=part == "training", seed=1)
        for part in ("training", "validation")
    )
    return TrainingTask(
        "straight", Straight(), loss, batches, held, SCHEDULE, "test", methods=("sequence",)
    )


def run(learned: TrainingTask, schedule: Schedule, folder: Path, seed: int = 1, **options: Any):
    return train(replace(learned, schedule=schedule), folder, seed, device="cpu", **options)


def weights(learned: TrainingTask) -> Tensor:
    return torch.cat([each.detach().flatten() for each in learned.network.parameters()])


def scripted(values: list[float], seen: list[Tensor]) -> Callable[[Any, Batch], Tensor]:
    """A loss that on validation gives these values, one an epoch, and notes the weights."""

    def loss(policy: Any, batch: Batch) -> Tensor:
        if policy.training:
            return squares(policy, batch)
        if batch["time"][0, 0] == 0.0:  # The first batch of the part.
            seen.append(torch.cat([each.flatten().clone() for each in policy.parameters()]))
        return torch.tensor(values[len(seen) - 1])

    return loss


class KilledError(Exception):
    pass


def test_learns_and_keeps_curves(packed: PackedFlights, tmp_path: Path):
    trained = run(task(packed), SCHEDULE, tmp_path)
    losses = [row["training_loss"] for row in trained.history]
    assert len(losses) == 4
    assert losses[-1] < 0.7 * losses[0]
    with (tmp_path / "curves" / "straight.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [float(row["training_loss"]) for row in rows] == losses
    for clock in ("cpu_s", "wall_s"):
        assert [float(row[clock]) for row in rows] == sorted(float(row[clock]) for row in rows)
    assert list((tmp_path / "curves" / "straight").glob("events.out.tfevents.*"))


def test_validation_loss_is_the_mean_over_windows(packed: PackedFlights, tmp_path: Path):
    """The loss of the last epoch's weights, without dropout, whatever the batches."""
    learned = task(packed, batch=7)
    trained = run(learned, Schedule(epochs=1, batch=7, learning_rate=1e-2, patience=1), tmp_path)
    held = WindowDataset(packed, "validation", 4, 1)
    assert len(held) % 7 != 0
    with torch.no_grad():
        wanted = squares(learned.network, held.batch(range(len(held))))  # pyright: ignore[reportArgumentType]
    assert trained.history[0]["validation_loss"] == pytest.approx(float(wanted), rel=1e-5)


def test_the_best_on_validation_wins(packed: PackedFlights, tmp_path: Path):
    seen: list[Tensor] = []
    learned = task(packed, scripted([3.0, 1.0, 2.0, 1.0], seen))
    trained = run(learned, SCHEDULE, tmp_path)
    assert trained.best_epoch == 1
    assert [row["validation_loss"] for row in trained.history] == [3.0, 1.0, 2.0, 1.0]
    assert torch.equal(weights(learned), seen[1])
    assert not torch.equal(weights(learned), seen[3])
    assert not learned.network.training


def test_a_kill_changes_nothing(packed: PackedFlights, tmp_path: Path):
    whole = task(packed)
    once = run(whole, SCHEDULE, tmp_path / "whole")
    told = 0

    def kill(done: float, text: str) -> None:
        nonlocal told
        told += 1
        if told == 14:
            raise KilledError

    with pytest.raises(KilledError):
        run(task(packed), SCHEDULE, tmp_path / "parts", progress=kill)
    torch.manual_seed(99)
    resumed = task(packed)
    twice = run(resumed, SCHEDULE, tmp_path / "parts")
    assert torch.equal(weights(whole), weights(resumed))
    for one, other in zip(once.history, twice.history, strict=True):
        assert one["validation_loss"] == other["validation_loss"]


def test_what_is_finished_is_not_trained_again(packed: PackedFlights, tmp_path: Path):
    first = run(task(packed), SCHEDULE, tmp_path)

    def never(done: float, text: str) -> None:
        raise AssertionError

    again = task(packed)
    for parameter in again.network.parameters():
        nn.init.zeros_(parameter)
    assert run(again, SCHEDULE, tmp_path, progress=never) == first
    assert weights(again).abs().min() > 0.0


def test_a_budget_of_minutes_ends_it(packed: PackedFlights, tmp_path: Path):
    shares = []
    schedule = Schedule(epochs=1000, batch=3, learning_rate=1e-3, patience=1000, minutes=0.01)
    trained = run(task(packed), schedule, tmp_path, progress=lambda done, text: shares.append(done))
    assert 1 <= len(trained.history) < 1000
    assert [row["wall_s"] >= 0.6 for row in trained.history] == [False] * (
        len(trained.history) - 1
    ) + [True]
    assert shares == sorted(shares)
    assert run(task(packed), schedule, tmp_path) == trained


@pytest.mark.parametrize(
    "content", [[], {"proxops": "0", "identity": 3}, {"network": 0}, torch.zeros(3)]
)
def test_a_foreign_checkpoint_is_refused(packed: PackedFlights, tmp_path: Path, content: Any):
    torch.save(content, tmp_path / "straight.ckpt")
    with pytest.raises(InputError, match="is not a checkpoint of a training"):
        run(task(packed), SCHEDULE, tmp_path)


@pytest.mark.parametrize("shuffle", [True, False])
def test_tensor_batches(shuffle: bool):
    """All examples once an epoch, those shown often twice, in an order of (seed, epoch)."""
    x = torch.arange(10)
    batches = TensorBatches((x, 2 * x), 3, shuffle=shuffle, seed=4, often=torch.tensor([7, 8]))
    epochs = []
    for epoch in (0, 1, 0):
        batches.epoch = epoch
        epochs.append(list(batches))
        assert len(epochs[-1]) == len(batches) == 4
    first, other, again = ([torch.cat(column) for column in zip(*e, strict=True)] for e in epochs)
    assert torch.equal(first[1], 2 * first[0])
    assert sorted(first[0].tolist()) == [0, 1, 2, 3, 4, 5, 6, 7, 7, 8, 8, 9]
    assert torch.equal(first[0], again[0])
    assert torch.equal(first[0], other[0]) is not shuffle
    rest = TensorBatches((x,), 4, shuffle=shuffle)
    assert [len(batch[0]) for batch in rest] == ([4, 4] if shuffle else [4, 4, 2])


def test_tiny_numbers_are_zero_while_it_learns_and_no_longer(packed: PackedFlights, tmp_path: Path):
    """Processors are slow with them, and other code in this process may count on them."""
    tiny, seen = torch.tensor([1e-39]), []

    def loss(policy: Straight, batch: Batch) -> Tensor:
        seen.append(float(tiny * 1.0))
        return squares(policy, batch)

    train(task(packed, loss), tmp_path, 1)
    assert set(seen) == {0.0}
    assert float(tiny * 1.0) > 0.0


def test_refusals(packed: PackedFlights, tmp_path: Path):
    for device, precision in (("abacus", "32-true"), ("cpu", "7")):
        with pytest.raises(InputError, match="cannot train on device"):
            train(task(packed), tmp_path, 1, device=device, precision=precision)
    endless = task(packed, lambda policy, batch: squares(policy, batch) * torch.inf)
    with pytest.raises(InputError, match="in epoch 1: train in full precision"):
        run(endless, SCHEDULE, tmp_path / "endless")
    run(task(packed), SCHEDULE, tmp_path)
    for seed, precision in ((2, "32-true"), (1, "bf16-mixed")):
        with pytest.raises(InputError, match="with other settings, data or body"):
            run(task(packed), SCHEDULE, tmp_path, seed, precision=precision)
    path = tmp_path / "straight.ckpt"
    torch.save(torch.load(path, weights_only=True) | {"proxops": "0.1.2"}, path)
    with pytest.raises(InputError, match=r"was written by proxops 0\.1\.2, and this is"):
        run(task(packed), SCHEDULE, tmp_path)
    path.write_bytes(b"half a checkpo")
    with pytest.raises(InputError, match="is not a checkpoint"):
        run(task(packed), SCHEDULE, tmp_path)
