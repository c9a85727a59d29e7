"""The one loop that every network of proxops is trained by."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Sized
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import torch
from lightning.fabric import Fabric
from lightning.fabric.loggers.tensorboard import TensorBoardLogger
from torch import Tensor, nn

from proxops.systems.common import InputError, Progress, derived_seed, make_folder, silent
from proxops.training.loop.checkpoints import load_checkpoint, save_checkpoint
from proxops.training.loop.training_history import (
    History,
    Trained,
    best_epoch,
    finished,
    learning_rate,
    write_curves,
)

_WEIGHT_DECAY = 1e-4
# Gradients grow at times, above all through many steps of a recurrent network: their norm is cut to
# this.
_GRADIENT_NORM = 1.0


class Batches(Sized, Protocol):
    """Examples in batches; its length is the number of batches."""

    @property
    def epoch(self) -> int:
        """Set before each epoch: what is drawn is a function of it."""
        ...

    @epoch.setter
    def epoch(self, value: int) -> None: ...

    def __iter__(self) -> Iterator[Any]:
        """Gives the batches, tensors in whatever containers the loss takes."""
        ...


@dataclass(frozen=True)
class Schedule:
    """How long a network is trained, and how fast it learns."""

    epochs: int
    batch: int
    """Examples in a batch: frames, states, or windows."""
    learning_rate: float
    """The greatest."""
    patience: int
    """Training ends early after this many epochs without a better validation loss."""
    minutes: float | None = None
    """Training ends when it has taken so long, all runs of it together; None: by epochs alone."""


@dataclass(frozen=True)
class TrainingTask:
    """A network and what it learns from."""

    name: str
    """Of its files."""
    network: nn.Module
    loss: Callable[[Any, Any], Tensor]
    """Called with the network and a batch; a mean over the batch."""
    training: Batches
    validation: Batches
    identity: str
    """Says what is learned from: a checkpoint of another identity is not gone on with."""
    threads: int | None = None
    """Of the CPU: a small network is trained as fast by one. None: as many as there are."""
    methods: tuple[str, ...] = ()
    """Those of the network, besides `forward`, that the loss calls."""
    keep_last: bool = False
    """Keeps the last epoch's weights, not those of the best one on validation."""


def train(
    task: TrainingTask,
    schedule: Schedule,
    folder: Path,
    seed: int,
    *,
    device: str = "auto",
    precision: Any = "32-true",
    progress: Progress = silent,
) -> Trained:
    """Trains a network; the best epoch on the validation examples wins, or the last.

    After every epoch a checkpoint is written to `folder`/NAME.ckpt and the curves to
    `folder`/curves: NAME.csv, and NAME/ for TensorBoard. Run again after a kill, it goes on behind
    the last whole epoch; without a budget of minutes it ends with the same weights.

    Args:
      seed: of what the loss draws while training. The network's first weights, and the order of
        the examples, are the caller's.
      device, precision: Lightning Fabric's, for instance `cpu` or `cuda`, and `bf16-mixed`.
      progress: is called with the share done and a text.

    Raises:
      InputError: the checkpoint there is damaged or of another training, the device is not there,
        or the loss became no number.
    """
    if task.threads is not None:
        # Here, not at the start of the program: numba's kernels set the same number.
        torch.set_num_threads(task.threads)
    make_folder(folder / "curves")
    logger = TensorBoardLogger(root_dir=folder / "curves", name=task.name, version="")
    fabric = _fabric(device, precision, logger)
    bare = torch.optim.AdamW(task.network.parameters(), weight_decay=_WEIGHT_DECAY)
    network, optimizer = fabric.setup(task.network, bare)
    for method in task.methods:
        network.mark_forward_method(method)
    steps = len(task.training)

    checkpoint = folder / f"{task.name}.ckpt"
    identity = f"{task.identity}; {schedule}; seed {seed}; {steps} steps; {task.network}"
    history: History = []
    best: dict[str, Tensor] = {}
    saved = load_checkpoint(fabric, checkpoint, identity)
    if saved is not None:
        network.load_state_dict(saved["network"])
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
        task.training.epoch = epoch
        total, examples, rate = 0.0, 0, 0.0
        network.train()
        for step, batch in enumerate(task.training):
            done = share(epoch * steps + step)
            if done >= 1.0 and step > 0:
                break
            rate = learning_rate(schedule.learning_rate, min(1.0, done))
            for group in optimizer.param_groups:
                group["lr"] = rate
            batch = fabric.to_device(batch)
            loss = task.loss(network, batch)
            optimizer.zero_grad()
            fabric.backward(loss)
            fabric.clip_gradients(
                network, optimizer, max_norm=_GRADIENT_NORM, error_if_nonfinite=False
            )
            optimizer.step()
            total += float(loss.detach()) * _size(batch)
            examples += _size(batch)
            progress(done, f"{task.name}, epoch {epoch + 1}, loss {total / examples:.4f}")

        row = {
            "epoch": epoch,
            "training_loss": total / examples,
            "validation_loss": evaluate(fabric, network, task),
            "learning_rate": rate,
            "cpu_s": earlier_cpu + time.process_time() - started_cpu,
            "wall_s": wall(),
        }
        if not math.isfinite(row["validation_loss"]):
            raise InputError(f"{task.name}: the loss is {row['validation_loss']} in epoch "
                             f"{epoch}; lower the learning rate")  # fmt: skip
        history.append(row)
        if best_epoch(history) == epoch:
            best = {name: value.clone() for name, value in network.state_dict().items()}
        fabric.log_dict({key: value for key, value in row.items() if key != "epoch"}, step=epoch)
        state = {
            "network": network.state_dict(),
            "optimizer": optimizer.state_dict(),
            "history": history,
            "best": best,
        }
        save_checkpoint(checkpoint, identity, state)
        write_curves(folder / "curves" / f"{task.name}.csv", history)
    logger.finalize("success")

    if not task.keep_last:
        task.network.load_state_dict(best)
    task.network.eval()
    kept = len(history) - 1 if task.keep_last else best_epoch(history)
    return Trained(history, kept, history[-1]["cpu_s"])


@torch.no_grad()
def evaluate(fabric: Fabric, network: Any, task: TrainingTask) -> float:
    """The mean loss over the validation batches, each counted by its number of examples."""
    network.eval()
    total, examples = 0.0, 0
    for batch in task.validation:
        batch = fabric.to_device(batch)
        total += float(task.loss(network, batch)) * _size(batch)
        examples += _size(batch)
    return total / examples


def _size(batch: Any) -> int:
    columns = batch.values() if isinstance(batch, dict) else batch
    return len(next(iter(columns)))


def _fabric(device: str, precision: Any, logger: TensorBoardLogger) -> Fabric:
    try:
        return Fabric(accelerator=device, devices=1, precision=precision, loggers=logger)
    except Exception as error:  # What is not there or cannot be together raises all sorts.
        raise InputError(
            f"cannot train on device {device!r} with precision {precision!r}: {error}"
        ) from error
