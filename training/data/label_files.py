"""Files of labels: states, goals, and the expert's forces there."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from pathlib import Path
from typing import Protocol

import numpy as np

from proxops.diagrams.flight import Workers
from proxops.systems.common import InputError, make_folder, write_whole
from proxops.systems.expert import Plan

Labels = dict[str, np.ndarray]
"""`state` (N, 6), `goal` (N, 3) and `force` (N, 3), in K and SI; in those of a family also `member`
(N,), the number of the scenario that they are of."""

_NAMES = ("state", "goal", "force")
# A plan with more slack breaks a limit or misses the target: its later knots are no examples.
_SLACK = 1e-3
# If less than this many least horizons is left of a plan, or an interval is more than this share of
# what is left, a knot's force is 1 to 3 N off the expert's command there; elsewhere 0.1 to 0.3 N.
_LEAST_LEFT, _COARSEST = 2.0, 0.2


def labels_of(plans: list[Plan], least_horizon: float | None = None) -> Labels:
    """States, goals and forces at the knots of plans.

    A knot is an example of the expert's command only if the rest of the plan is well above the
    least horizon, which a new plan from there would not go below, and if its interval is not much
    longer than those of such a plan. A plan with slack gives only its start.

    Args:
      plans: the expert's plans.
      least_horizon: the expert's least horizon in s; None: only the starts.
    """
    states, goals, forces = [np.zeros((0, 6))], [np.zeros((0, 3))], [np.zeros((0, 3))]
    for plan in plans:
        left = plan.times[-1] - plan.times[:-1]
        kept = np.arange(len(left)) == 0
        if least_horizon is not None and plan.slack <= _SLACK:
            kept |= (left >= _LEAST_LEFT * least_horizon) & (
                np.diff(plan.times) <= _COARSEST * left
            )
        states.append(plan.states[:-1][kept])
        forces.append(plan.forces[kept])
        goals.append(np.tile(plan.target[:3], (int(kept.sum()), 1)))
    parts = {"state": states, "goal": goals, "force": forces}
    return {key: np.concatenate(values) for key, values in parts.items()}


def joined_labels(parts: list[Labels]) -> Labels:
    """Joins labels; the columns are those of the first."""
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


class Piece(Protocol):
    """What is labelled together and kept in one file; plain values that any worker can receive."""

    @property
    def name(self) -> str:
        """Name of the file, without its ending."""
        ...

    @property
    def count(self) -> int:
        """How much it is, for the progress."""
        ...

    @property
    def origin(self) -> str:
        """Names all that the labels depend on."""
        ...

    def compute(self) -> Labels:
        """Computes the labels."""
        ...


def kept_labels(
    pieces: Sequence[Piece], folder: Path, workers: Workers, words: str
) -> list[Labels]:
    """Labels of each piece; those that the folder does not hold yet are computed and kept there.

    Args:
      folder: for one file of each.
      workers: compute the labels, and report how many are ready.
      words: what is done, for the progress.

    Raises:
      InputError: a file in the folder is damaged or holds other labels.
    """
    make_folder(folder)
    total = sum(piece.count for piece in pieces)
    todo = [piece for piece in pieces if not (folder / f"{piece.name}.npz").exists()]
    counts = {piece.name: piece.count for piece in todo}
    ready = total - sum(counts.values())
    workers.progress(ready / total, f"{words}, {ready} of {total}")
    for name, _ in workers.results(todo, functools.partial(_keep, folder=folder.resolve())):
        ready += counts[name]
        workers.progress(ready / total, f"{words}, {ready} of {total}")
    return [load_labels(folder / f"{piece.name}.npz", piece.origin) for piece in pieces]


def _keep(piece: Piece, folder: Path) -> None:
    """Writes the labels of a piece and their origin; the file is complete or not there."""
    save_labels(folder / f"{piece.name}.npz", piece.compute(), piece.origin)


def save_labels(path: Path, labels: Labels, origin: str) -> None:
    """Writes labels and their origin; the file is complete or not there."""

    def write(name: Path) -> None:
        with name.open("wb") as file:
            np.savez(file, allow_pickle=False, origin=np.array(origin), **labels)

    write_whole(path, write)


def load_labels(path: Path, origin: str) -> Labels:
    """Reads what `save_labels` wrote.

    Raises:
      InputError: the file is damaged, or its labels have another origin.
    """
    try:
        # Opened here, so that it is closed even if numpy finds it damaged.
        with path.open("rb") as opened, np.load(opened, allow_pickle=False) as file:
            content = {key: file[key] for key in (*_NAMES, "origin")}
        known = str(content.pop("origin"))
        shapes = [content[key].shape for key in _NAMES]
        sound = shapes == [(len(content["state"]), width) for width in (6, 3, 3)]
    except Exception as error:  # A damaged file makes numpy raise all sorts of errors.
        raise InputError(f"{path} holds no labels: remove it") from error
    if not sound:
        raise InputError(f"{path} holds no labels: remove it")
    if known != origin:
        raise InputError(
            f"{path} holds labels of other flights, plans or another version of proxops: "
            "remove it, or name another folder"
        )
    return content
