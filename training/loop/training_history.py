"""What every training loop keeps and decides by: rows of an epoch each, the best, the end."""

from __future__ import annotations

import csv
import io
import math
from dataclasses import dataclass
from pathlib import Path

from proxops.systems.common import write_whole

# Share of all steps in which the learning rate rises; it falls as a cosine afterwards.
_WARM_UP = 0.1

History = list[dict[str, float]]
"""One row an epoch; `validation_loss` is among its columns."""


@dataclass(frozen=True)
class Trained:
    """What came of a training. The network that was given holds the weights that are kept."""

    history: History
    """One row an epoch: its number, losses, learning rate, CPU time so far."""
    best_epoch: int
    """That whose weights are kept."""
    cpu_s: float
    """CPU time of this process while training, all runs of it together."""


def best_epoch(history: History) -> int:
    """The epoch of the least validation loss, the first if several have it."""
    return min(range(len(history)), key=lambda epoch: history[epoch]["validation_loss"])


def finished(history: History, epochs: int, patience: int) -> bool:
    """Whether there were `epochs`, or `patience` in a row without a better validation loss."""
    if not history:
        return False
    idle = len(history) - 1 - best_epoch(history)
    return len(history) >= epochs or idle >= patience


def learning_rate(greatest: float, done: float) -> float:
    """The learning rate when a share `done`, from 0 to 1, of all steps is over."""
    if done < _WARM_UP:
        return greatest * (0.04 + 0.96 * done / _WARM_UP)
    cosine = math.cos(math.pi * (done - _WARM_UP) / (1.0 - _WARM_UP))
    return greatest * 0.5 * (1.0 + cosine)


def write_curves(path: Path, history: History) -> None:
    """The history as CSV, whole or not at all."""
    text = io.StringIO()
    writer = csv.DictWriter(text, history[0].keys(), lineterminator="\n")
    writer.writeheader()
    writer.writerows(history)
    write_whole(path, lambda name: name.write_text(text.getvalue()))
