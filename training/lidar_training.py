"""Training of the lidar's networks: one plain loop, the same for both."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from lightning.fabric import Fabric
from lightning.fabric.loggers.tensorboard import TensorBoardLogger
from torch import Tensor, nn

from proxops.diagrams.flight_log import make_folder
from proxops.systems.counter_noise import derived_seed
from proxops.systems.errors import InputError
from proxops.training.checkpoints import load_checkpoint, save_checkpoint
from proxops.training.training_history import (
    Trained,
    best_epoch,
    finished,
    learning_rate,
    write_curves,
)

_WEIGHT_DECAY = 1e-4


@dataclass(frozen=True)
class Schedule:
    """How long a network is trained, and how fast it learns."""

    epochs: int
    batch: int
    learning_rate: float
    """The greatest."""
    patience: int
    """Training ends early after this many epochs without a better validation loss."""


@dataclass(frozen=True)
class Lesson:
    """A network and what it learns. Tensors are the loss's arguments; the first axis counts."""

    name: str
    """Of its files."""
    network: nn.Module
    loss: Callable[..., Tensor]
    """Called with the network and a batch of the examples; a mean over the batch."""
    examples: Sequence[Tensor]
    validation: Sequence[Tensor]
    often: Tensor
    """(K,) indices of examples that are shown a second time in every epoch."""
    identity: str
    """Says what is learned from: a checkpoint of another identity is not gone on with."""


def train(
    lesson: Lesson,
    schedule: Schedule,
    folder: Path,
    seed: int,
    progress: Callable[[float, str], Any] | None = None,
) -> Trained:
    """Trains a network on one CPU thread; the best epoch on the validation examples wins.

    After every epoch a checkpoint is written to `folder`/NAME.ckpt and the curves to
    `folder`/curves: NAME.csv, and NAME/ for TensorBoard. Run again after a kill, it goes on behind
    the last whole epoch and ends with the same weights.

    Args:
      seed: of the order of the examples. The network's first weights are the caller's.
      progress: is called with the share done and a text.

    Raises:
      InputError: the checkpoint there is damaged or of another training.
    """
    torch.set_num_threads(1)
    make_folder(folder / "curves")
    logger = TensorBoardLogger(root_dir=folder / "curves", name=lesson.name, version="")
    fabric = Fabric(accelerator="cpu", devices=1, loggers=logger)
    bare = torch.optim.AdamW(lesson.network.parameters(), weight_decay=_WEIGHT_DECAY)
    network, optimizer = fabric.setup(lesson.network, bare)
    count = len(lesson.examples[0])
    shown = torch.cat([torch.arange(count), lesson.often])
    batch = min(schedule.batch, len(shown))
    steps = len(shown) // batch

    checkpoint = folder / f"{lesson.name}.ckpt"
    identity = f"{lesson.identity}; {schedule}; seed {seed}; {count} examples; {lesson.network}"
    history: list[dict[str, float]] = []
    best: dict[str, Tensor] = {}
    saved = load_checkpoint(fabric, checkpoint, identity)
    if saved is not None:
        network.load_state_dict(saved["network"])
        optimizer.load_state_dict(saved["optimizer"])
        history, best = saved["history"], saved["best"]

    earlier = history[-1]["cpu_s"] if history else 0.0
    started = time.process_time()
    while not finished(history, schedule.epochs, schedule.patience):
        epoch = len(history)
        # The order depends on (seed, epoch) alone, so that an epoch may be begun anew.
        order = torch.Generator().manual_seed(derived_seed(seed, epoch))
        shuffled = shown[torch.randperm(len(shown), generator=order)]
        total, rate = 0.0, 0.0
        network.train()
        for step in range(steps):
            chosen = shuffled[step * batch : (step + 1) * batch]
            loss = lesson.loss(network, *(column[chosen] for column in lesson.examples))
            optimizer.zero_grad()
            fabric.backward(loss)
            share = (epoch * steps + step) / (schedule.epochs * steps)
            rate = learning_rate(schedule.learning_rate, share)
            for group in optimizer.param_groups:
                group["lr"] = rate
            optimizer.step()
            total += float(loss.detach())
            if progress is not None and step % 8 == 0:
                done = (epoch + step / steps) / schedule.epochs
                progress(done, f"{lesson.name}, epoch {epoch + 1}, loss {total / (step + 1):.4f}")

        validation = evaluate(network, lesson.loss, lesson.validation, schedule.batch)
        row = {
            "epoch": epoch,
            "training_loss": total / steps,
            "validation_loss": validation,
            "learning_rate": rate,
            "cpu_s": earlier + time.process_time() - started,
        }
        if not math.isfinite(validation):
            raise InputError(f"{lesson.name}: the loss is {validation} in epoch {epoch}; lower the "
                             "learning rate")  # fmt: skip
        if not history or validation < min(past["validation_loss"] for past in history):
            best = {name: value.clone() for name, value in network.state_dict().items()}
        history.append(row)
        fabric.log_dict({key: value for key, value in row.items() if key != "epoch"}, step=epoch)
        state = {
            "network": network.state_dict(),
            "optimizer": optimizer.state_dict(),
            "history": history,
            "best": best,
        }
        save_checkpoint(checkpoint, identity, state)
        write_curves(folder / "curves" / f"{lesson.name}.csv", history)
    logger.finalize("success")

    lesson.network.load_state_dict(best)
    lesson.network.eval()
    return Trained(history, best_epoch(history), history[-1]["cpu_s"])


@torch.no_grad()
def evaluate(
    network: nn.Module, loss: Callable[..., Tensor], examples: Sequence[Tensor], batch: int
) -> float:
    """The mean loss over the batches of the examples, each counted by its size."""
    network.eval()
    count, total = len(examples[0]), 0.0
    for start in range(0, count, batch):
        part = [column[start : start + batch] for column in examples]
        total += float(loss(network, *part)) * len(part[0])
    return total / count
