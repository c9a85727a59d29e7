"""Files of labels: states, goals, and what the expert commands there."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from proxops.diagrams.flight_log import write_whole
from proxops.systems.errors import InputError
from proxops.systems.plan import Plan

Labels = dict[str, np.ndarray]
"""`state` (N, 6), `goal` (N, 3) and `force` (N, 3), in K and SI."""

_NAMES = ("state", "goal", "force")
# A plan with more slack breaks a limit or misses the target: its later knots are no example.
_SLACK = 1e-3


def labels_of(plans: list[Plan], *, starts_only: bool = False) -> Labels:
    """States, goals and forces of the knots of plans; of one with slack, of its start alone."""
    states, goals, forces = [np.zeros((0, 6))], [np.zeros((0, 3))], [np.zeros((0, 3))]
    for plan in plans:
        knots = 1 if starts_only or plan.slack > _SLACK else len(plan.forces)
        states.append(plan.states[:knots])
        forces.append(plan.forces[:knots])
        goals.append(np.tile(plan.target[:3], (knots, 1)))
    parts = {"state": states, "goal": goals, "force": forces}
    return {key: np.concatenate(values) for key, values in parts.items()}


def joined_labels(parts: list[Labels]) -> Labels:
    """All of them in one."""
    return {name: np.concatenate([part[name] for part in parts]) for name in _NAMES}


def save_labels(path: Path, labels: Labels, origin: str) -> None:
    """Writes labels and what they come from, whole or not at all."""
    content = labels | {"origin": np.array(origin)}

    def write(name: Path) -> None:
        with name.open("wb") as file:
            np.savez(file, allow_pickle=False, **content)

    write_whole(path, write)


def load_labels(path: Path, origin: str) -> Labels:
    """What `save_labels` wrote.

    Raises:
      InputError: the file is damaged, or its labels come from something else.
    """
    try:
        # Opened here, so that it is closed even if numpy finds it damaged.
        with path.open("rb") as opened, np.load(opened, allow_pickle=False) as file:
            content = {key: file[key] for key in (*_NAMES, "origin")}
    except Exception as error:  # A damaged file makes numpy raise all sorts.
        raise InputError(f"{path} holds no labels: remove it") from error
    if str(content.pop("origin")) != origin:
        raise InputError(
            f"{path} holds labels of another scenario: remove it, or name another folder"
        )
    return content
