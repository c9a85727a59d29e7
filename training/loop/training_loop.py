"""The one loop that trains every network of proxops."""

from __future__ import annotations

import contextlib
import math
import time
from collections.abc import Callable, Generator, Iterator, Sequence, Sized
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import torch
from torch import Tensor, nn

from proxops.systems.common import InputError, Progress, derived_seed, make_folder, silent
from proxops.training.loop.checkpoints import load_checkpoint, save_checkpoint
from proxops.training.loop.tensor_batches import TensorBatches
from proxops.training.loop.training_history import (
    History,
    Trained,
    best_epoch,
    finished,
    learning_rate,
    write_curves,
)

if TYPE_CHECKING:
    from lightning.fabric import Fabric

_WEIGHT_DECAY = 1e-4
# The norm of a gradient is cut to this: through many steps of a recurrent network gradients grow.
_GRADIENT_NORM = 1.0


class Batches(Sized, Protocol):
    """Examples in batches; the length is the number of batches."""

    epoch: int
    """Set before each epoch; the order of the examples is a function of it."""

    def __iter__(self) -> Iterator[Any]:
        """Gives the batches: tensors, in the containers that the loss takes."""
        ...


@dataclass(frozen=True)
class Schedule:
    """How long a network is trained, and with which learning rate."""

    epochs: int
    batch: int
    """Examples in a batch: frames, states, or windows."""
    learning_rate: float
    """Its greatest value, after the warm-up."""
    patience: int | None = None
    """Training ends early after this many epochs without a better validation loss; None: never."""
    minutes: float | None = None
    """Training ends after this time, summed over all its runs; None: only by epochs."""


@dataclass(frozen=True)
class TrainingTask:
    """A network, its loss, and the examples that it learns from."""

    name: str
    """Name of its files."""
    network: nn.Module
    loss: Callable[[Any, Any], Tensor]
    """Takes the network and a batch; gives the mean over the batch."""
    training: Batches
    validation: Batches
    schedule: Schedule
    identity: str
    """Says what is learned from: a checkpoint with another identity is refused."""
    threads: int | None = None
    """CPU threads. A small network trains about as fast on one. None: as many as there are."""
    methods: tuple[str, ...] = ()
    """Methods of the network, besides `forward`, that the loss calls."""
    keep_last: bool = False
    """Keeps the weights of the last epoch, not those of the best one on validation."""

    @classmethod
    def on_tensors(
        cls,
        name: str,
        network: nn.Module,
        loss: Callable[[Any, Any], Tensor],
        columns: Sequence[Sequence[Tensor]],
        schedule: Schedule,
        seed: int,
        identity: str,
        *,
        often: Tensor | None = None,
        held_size: int | None = None,
        **options: Any,
    ) -> TrainingTask:
        """A task on examples in memory.

        Args:
          columns: examples to train on, and those for validation, as `TensorBatches` takes them.
          seed: of the order of the examples. often: see `TensorBatches`.
          held_size: of the batches of validation; None: that of the others.
          options: the other fields.
        """
        training, held = columns
        batches = TensorBatches(training, schedule.batch, shuffle=True, seed=seed, often=often)
        validation = TensorBatches(held, held_size or schedule.batch)
        return cls(name, network, loss, batches, validation, schedule, identity, **options)


def train(
    task: TrainingTask,
    folder: Path,
    seed: int,
    *,
    device: str = "auto",
    precision: Any = "32-true",
    progress: Progress = silent,
) -> Trained:
    """Trains a network and keeps the weights of its best epoch on validation, or of its last.

    After every epoch it writes a checkpoint to `folder`/NAME.ckpt and the curves to
    `folder`/curves: NAME.csv, and NAME/ for TensorBoard. After a kill it continues behind the last
    complete epoch. Without a limit of minutes it then ends with the same weights, but for
    `16-mixed`: the scale of its gradients begins anew.

    Args:
      seed: for what the loss draws while training. The caller chooses the network's first weights
        and the order of the examples.
      device: for Lightning Fabric, for instance `cpu` or `cuda`.
      precision: for Lightning Fabric, for instance `bf16-mixed`.
      progress: is called with the share done and a text.

    Raises:
      InputError: the checkpoint there is damaged, or of another training or version; there is no
        such device; or the loss is not finite.
    """
    threads = torch.get_num_threads()
    if task.threads is not None:
        # Here and not when the program starts, because numba's kernels set this number too.
        torch.set_num_threads(task.threads)
    try:
        fabric = _fabric(device, precision, task, folder)
        training = _Training(task, folder, seed, precision, fabric)
        while not training.is_over():
            training.run_epoch(progress)
        return training.end()
    finally:
        torch.set_num_threads(threads)


@contextlib.contextmanager
def seeded(seed: int) -> Iterator[None]:
    """Inside, torch's random numbers begin with `seed`; afterwards they go on as before."""
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        yield


@contextlib.contextmanager
def _tiny_is_zero() -> Generator[None]:
    """Takes numbers below 1.2e-38 for zero, in this thread.

    A network that is sure of its answers has such gradients, and processors are slow with them: an
    epoch of the lidar's ray network took four times as long at the end as at the beginning.
    """
    torch.set_flush_denormal(True)
    try:
        yield
    finally:
        torch.set_flush_denormal(False)


class _Training:
    """A training between two epochs: the network, the optimiser, and the history so far."""

    def __init__(self, task: TrainingTask, folder: Path, seed: int, precision: Any, fabric: Fabric):
        schedule = task.schedule
        self._task, self._schedule, self._seed, self._fabric = task, schedule, seed, fabric
        optimizer = torch.optim.AdamW(task.network.parameters(), weight_decay=_WEIGHT_DECAY)
        self._network, self._optimizer = fabric.setup(task.network, optimizer)
        for method in task.methods:
            self._network.mark_forward_method(method)
        self._steps = len(task.training)
        self._limit_s = math.inf if schedule.minutes is None else 60.0 * schedule.minutes

        self._curves = folder / "curves" / f"{task.name}.csv"
        self._checkpoint = folder / f"{task.name}.ckpt"
        self._identity = (
            f"{task.identity}; {schedule}; seed {seed}, precision {precision}; "
            f"{self._steps} steps; {task.network}"
        )
        self._history: History = []
        self._best: dict[str, Tensor] = {}
        saved = load_checkpoint(self._checkpoint, self._identity)
        if saved is not None:
            self._restore(saved)
        earlier = self._history[-1] if self._history else {"cpu_s": 0.0, "wall_s": 0.0}
        # Clocks that would have shown 0 when the first run began.
        self._cpu_start = time.process_time() - earlier["cpu_s"]
        self._wall_start = time.perf_counter() - earlier["wall_s"]

    def _restore(self, saved: dict[str, Any]) -> None:
        """Takes over what a checkpoint holds.

        Raises:
          InputError: its contents do not fit this network.
        """
        try:
            self._network.load_state_dict(saved["network"])
            self._optimizer.load_state_dict(saved["optimizer"])
        except Exception as error:  # torch raises all sorts of errors for what does not fit.
            raise InputError(
                f"{self._checkpoint} is not a checkpoint of a training: remove it"
            ) from error
        self._history, self._best = saved["history"], saved["best"]

    def is_over(self) -> bool:
        """Whether the epochs, the patience or the minutes are used up."""
        if finished(self._history, self._schedule.epochs, self._schedule.patience):
            return True
        # The recorded time decides, so that a training that is over stays over when run again.
        return bool(self._history) and self._history[-1]["wall_s"] >= self._limit_s

    def run_epoch(self, progress: Progress) -> None:
        """Trains for one epoch, validates, and writes the checkpoint and the curves."""
        epoch = len(self._history)
        training_loss, rate = self._learn(epoch, progress)
        row = {
            "epoch": epoch,
            "training_loss": training_loss,
            "validation_loss": self._validate(),
            "learning_rate": rate,
            "cpu_s": time.process_time() - self._cpu_start,
            "wall_s": time.perf_counter() - self._wall_start,
        }
        if not math.isfinite(row["validation_loss"]):
            raise InputError(
                f"{self._task.name}: the loss is {row['validation_loss']} in epoch {epoch + 1}: "
                "train in full precision (32-true), or anew in another folder with another seed"
            )
        self._history.append(row)
        if best_epoch(self._history) == epoch:
            self._best = {name: each.clone() for name, each in self._network.state_dict().items()}
        self._save(row)

    def end(self) -> Trained:
        """Puts the kept weights into the network; returns the history."""
        self._fabric.logger.finalize("success")
        if not self._task.keep_last:
            self._task.network.load_state_dict(self._best)
        self._task.network.eval()
        kept = len(self._history) - 1 if self._task.keep_last else best_epoch(self._history)
        return Trained(self._history, kept)

    def _learn(self, epoch: int, progress: Progress) -> tuple[float, float]:
        """One epoch of steps; returns the mean training loss and the last learning rate."""
        # What is drawn depends on (seed, epoch) alone, so that an epoch can begin again.
        torch.manual_seed(derived_seed(self._seed, epoch))
        self._task.training.epoch = epoch
        total, examples, rate = 0.0, 0, 0.0
        self._network.train()
        for step, batch in enumerate(self._task.training):
            done = self._share_used(epoch * self._steps + step)
            if done >= 1.0 and step > 0:
                break
            rate = learning_rate(self._schedule.learning_rate, min(1.0, done))
            loss = self._step(batch, rate)
            total += loss * _size(batch)
            examples += _size(batch)
            progress(done, f"{self._task.name}, epoch {epoch + 1}, loss {total / examples:.4f}")
        return total / examples, rate

    @_tiny_is_zero()
    def _step(self, batch: Any, rate: float) -> float:
        """One step of the optimiser; returns the loss before it."""
        for group in self._optimizer.param_groups:
            group["lr"] = rate
        loss = self._task.loss(self._network, self._fabric.to_device(batch))
        self._optimizer.zero_grad()
        self._fabric.backward(loss)
        self._fabric.clip_gradients(
            self._network, self._optimizer, max_norm=_GRADIENT_NORM, error_if_nonfinite=False
        )
        self._optimizer.step()
        return float(loss.detach())

    @torch.no_grad()
    def _validate(self) -> float:
        """The mean loss over the validation examples."""
        self._network.eval()
        total, examples = 0.0, 0
        for batch in self._task.validation:
            with _tiny_is_zero():
                loss = self._task.loss(self._network, self._fabric.to_device(batch))
            total += float(loss) * _size(batch)
            examples += _size(batch)
        return total / examples

    def _save(self, row: dict[str, float]) -> None:
        """Writes the checkpoint and the curves."""
        values = {key: value for key, value in row.items() if key != "epoch"}
        self._fabric.log_dict(values, step=int(row["epoch"]))
        state = {
            "network": self._network.state_dict(),
            "optimizer": self._optimizer.state_dict(),
            "history": self._history,
            "best": self._best,
        }
        save_checkpoint(self._checkpoint, self._identity, state)
        write_curves(self._curves, self._history)

    def _share_used(self, step: int) -> float:
        """Share of the epochs or of the minutes that is used up, whichever is more."""
        wall_s = time.perf_counter() - self._wall_start
        minutes = wall_s / self._limit_s if self._limit_s > 0.0 else 1.0
        return max(step / (self._schedule.epochs * self._steps), minutes)


def _size(batch: Any) -> int:
    """Number of examples in a batch."""
    columns = batch.values() if isinstance(batch, dict) else batch
    return len(next(iter(columns)))


def _fabric(device: str, precision: Any, task: TrainingTask, folder: Path) -> Fabric:
    """Lightning Fabric on a device, with TensorBoard's curves in `folder`/curves."""
    # Twice as slow to import as torch, so only when something is trained.
    from lightning.fabric import Fabric
    from lightning.fabric.loggers.tensorboard import TensorBoardLogger

    make_folder(folder / "curves")
    logger = TensorBoardLogger(root_dir=folder / "curves", name=task.name, version="")
    try:
        return Fabric(accelerator=device, devices=1, precision=precision, loggers=logger)
    except Exception as error:  # Fabric raises all sorts of errors for what it does not have.
        raise InputError(
            f"cannot train on device {device!r} with precision {precision!r}: {error}"
        ) from error
