"""The history of a training: one row an epoch, the best epoch, the end, the learning rate."""

from __future__ import annotations

import csv
import io
import math
from dataclasses import dataclass
from pathlib import Path

from proxops.systems.common import write_whole

# Share of all steps in which the learning rate rises; afterwards it falls as a cosine.
_WARM_UP = 0.1

History = list[dict[str, float]]
"""One row for each epoch; `validation_loss` is among its columns."""


@dataclass(frozen=True)
class Trained:
    """The result of a training; the network itself holds the weights that are kept."""

    history: History
    """One row for each epoch: its number, losses, learning rate, and times so far."""
    best_epoch: int
    """The epoch whose weights are kept."""

    def figures(self) -> dict[str, float]:
        """Figures for a report: losses of the weights that are kept, and times over all runs."""
        best, last = self.history[self.best_epoch], self.history[-1]
        return {
            "epochs": len(self.history),
            "best_epoch": self.best_epoch,
            "training_loss": best["training_loss"],
            "validation_loss": best["validation_loss"],
            "cpu_s": last["cpu_s"],
            "wall_s": last["wall_s"],
        }


def best_epoch(history: History) -> int:
    """The first epoch with the least validation loss."""
    return min(range(len(history)), key=lambda epoch: history[epoch]["validation_loss"])


def finished(history: History, epochs: int, patience: int | None) -> bool:
    """Whether the epochs are used up, or the last `patience` of them brought no better loss."""
    if not history or patience is None:
        return len(history) >= epochs
    return len(history) >= epochs or len(history) - 1 - best_epoch(history) >= patience


def learning_rate(greatest: float, done: float) -> float:
    """The learning rate after a share `done` of all steps, from 0 to 1."""
    if done < _WARM_UP:
        return greatest * (0.04 + 0.96 * done / _WARM_UP)
    cosine = math.cos(math.pi * (done - _WARM_UP) / (1.0 - _WARM_UP))
    return greatest * 0.5 * (1.0 + cosine)


def write_curves(path: Path, history: History) -> None:
    """Writes the history as CSV; the file is complete or not there."""
    text = io.StringIO()
    writer = csv.DictWriter(text, history[0].keys(), lineterminator="\n")
    writer.writeheader()
    writer.writerows(history)
    write_whole(path, lambda name: name.write_text(text.getvalue()))
