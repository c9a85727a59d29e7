"""Imitation: the one training loop of every policy, on windows of expert flights."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from lightning.fabric import Fabric
from lightning.fabric.loggers.tensorboard import TensorBoardLogger
from torch import Tensor, nn
from torch.utils.data import DataLoader

from proxops.diagrams.flight_log import make_folder
from proxops.systems.counter_noise import derived_seed
from proxops.systems.errors import InputError
from proxops.training.checkpoints import load_checkpoint, save_checkpoint
from proxops.training.training_history import (
    History,
    Trained,
    best_epoch,
    finished,
    learning_rate,
    write_curves,
)
from proxops.training.windows import Batch, WindowDataset, window_loader

_WEIGHT_DECAY = 1e-4
# Through many steps of a recurrent network gradients grow at times: their norm is cut to this.
_GRADIENT_NORM = 1.0


@dataclass(frozen=True)
class Schedule:
    """How long a policy is trained, and how fast it learns."""

    epochs: int
    batch: int
    """In windows."""
    learning_rate: float
    """The greatest."""
    patience: int
    """Training ends early after this many epochs without a better validation loss."""
    minutes: float | None = None
    """Training ends when it has taken so long, all runs of it together; None: by epochs alone."""


@dataclass(frozen=True)
class Lesson:
    """A policy and what it learns from."""

    name: str
    """Of its files."""
    policy: nn.Module
    """With a method `sequence`, which `loss` calls."""
    loss: Callable[[Any, Batch], Tensor]
    """Called with the policy and a batch of windows; a mean over the windows."""
    training: WindowDataset
    validation: WindowDataset
    identity: str
    """Says what is learned from: a checkpoint of another identity is not gone on with."""


def train(
    lesson: Lesson,
    schedule: Schedule,
    folder: Path,
    seed: int,
    *,
    device: str = "auto",
    precision: Any = "32-true",
    progress: Callable[[float, str], Any] | None = None,
) -> Trained:
    """Trains a policy; the best epoch on the validation windows wins.

    After every epoch a checkpoint is written to `folder`/NAME.ckpt and the curves to
    `folder`/curves: NAME.csv, and NAME/ for TensorBoard. Run again after a kill, it goes on behind
    the last whole epoch; without a budget of minutes it ends with the same weights.

    Args:
      seed: of the order of the windows and of what is drawn while training. The policy's first
        weights are the caller's.
      device, precision: Lightning Fabric's, for instance `cpu` or `cuda`, and `bf16-mixed`.
      progress: is called with the share done and a text.

    Raises:
      InputError: the checkpoint there is damaged or of another training, the device is not there,
        or the loss became no number.
    """
    make_folder(folder / "curves")
    logger = TensorBoardLogger(root_dir=folder / "curves", name=lesson.name, version="")
    fabric = _fabric(device, precision, logger)
    bare = torch.optim.AdamW(lesson.policy.parameters(), weight_decay=_WEIGHT_DECAY)
    policy, optimizer = fabric.setup(lesson.policy, bare)
    policy.mark_forward_method("sequence")
    loader, held = fabric.setup_dataloaders(
        window_loader(lesson.training, schedule.batch, shuffle=True, seed=seed),
        window_loader(lesson.validation, schedule.batch),
        use_distributed_sampler=False,
    )
    steps = len(loader)

    checkpoint = folder / f"{lesson.name}.ckpt"
    identity = f"{lesson.identity}; {schedule}; seed {seed}; {steps} steps; {lesson.policy}"
    history: History = []
    best: dict[str, Tensor] = {}
    saved = load_checkpoint(fabric, checkpoint, identity)
    if saved is not None:
        policy.load_state_dict(saved["policy"])
        optimizer.load_state_dict(saved["optimizer"])
        history, best = saved["history"], saved["best"]

    limit_s = math.inf if schedule.minutes is None else 60.0 * schedule.minutes
    earlier_cpu, earlier_wall = (history[-1]["cpu_s"], history[-1]["wall_s"]) if history else (0, 0)
    started_cpu, started_wall = time.process_time(), time.perf_counter()

    def wall() -> float:
        return earlier_wall + time.perf_counter() - started_wall

    def share(step: int) -> float:
        """Of the budget that is used up, in epochs or minutes, whichever ends first."""
        return max(step / (schedule.epochs * steps), wall() / limit_s if limit_s > 0.0 else 1.0)

    while not finished(history, schedule.epochs, schedule.patience):
        epoch = len(history)
        # By the time on record, so that a training that is over stays so when it is run again.
        if history and history[-1]["wall_s"] >= limit_s:
            break
        # What is drawn depends on (seed, epoch) alone, so that an epoch may be begun anew.
        torch.manual_seed(derived_seed(seed, epoch))
        lesson.training.epoch = epoch
        total, windows, rate = 0.0, 0, 0.0
        policy.train()
        for step, batch in enumerate(loader):
            done = share(epoch * steps + step)
            if done >= 1.0 and step > 0:
                break
            rate = learning_rate(schedule.learning_rate, min(1.0, done))
            for group in optimizer.param_groups:
                group["lr"] = rate
            loss = lesson.loss(policy, batch)
            optimizer.zero_grad()
            fabric.backward(loss)
            fabric.clip_gradients(
                policy, optimizer, max_norm=_GRADIENT_NORM, error_if_nonfinite=False
            )
            optimizer.step()
            total += float(loss.detach()) * len(batch["target"])
            windows += len(batch["target"])
            if progress is not None:
                progress(done, f"epoch {epoch + 1}, loss {total / windows:.4f}")

        row = {
            "epoch": epoch,
            "training_loss": total / windows,
            "validation_loss": evaluate(policy, lesson.loss, held),
            "learning_rate": rate,
            "cpu_s": earlier_cpu + time.process_time() - started_cpu,
            "wall_s": wall(),
        }
        if not math.isfinite(row["validation_loss"]):
            raise InputError(f"{lesson.name}: the loss is {row['validation_loss']} in epoch "
                             f"{epoch}; lower the learning rate")  # fmt: skip
        history.append(row)
        if best_epoch(history) == epoch:
            best = {name: value.clone() for name, value in policy.state_dict().items()}
        fabric.log_dict({key: value for key, value in row.items() if key != "epoch"}, step=epoch)
        state = {
            "policy": policy.state_dict(),
            "optimizer": optimizer.state_dict(),
            "history": history,
            "best": best,
        }
        save_checkpoint(checkpoint, identity, state)
        write_curves(folder / "curves" / f"{lesson.name}.csv", history)
    logger.finalize("success")

    lesson.policy.load_state_dict(best)
    lesson.policy.eval()
    return Trained(history, best_epoch(history), history[-1]["cpu_s"])


@torch.no_grad()
def evaluate(
    policy: Any, loss: Callable[[Any, Batch], Tensor], batches: DataLoader[Batch] | Any
) -> float:
    """The mean loss over batches of windows, each counted by its number of windows."""
    policy.eval()
    total, windows = 0.0, 0
    for batch in batches:
        total += float(loss(policy, batch)) * len(batch["target"])
        windows += len(batch["target"])
    return total / windows


def _fabric(device: str, precision: Any, logger: TensorBoardLogger) -> Fabric:
    try:
        return Fabric(accelerator=device, devices=1, precision=precision, loggers=logger)
    except Exception as error:  # What is not there or cannot be together raises all sorts.
        raise InputError(
            f"cannot train on device {device!r} with precision {precision!r}: {error}"
        ) from error
