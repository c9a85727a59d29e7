"""Files of labels: states, goals, and what the expert commands there."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from proxops.systems.common import InputError, write_whole
from proxops.systems.expert import Plan

Labels = dict[str, np.ndarray]
"""`state` (N, 6), `goal` (N, 3) and `force` (N, 3), in K and SI."""

_NAMES = ("state", "goal", "force")
# A plan with more slack breaks a limit or misses the target: its later knots are no example.
_SLACK = 1e-3
# Where less than so many least horizons is left of a plan, or an interval is more than this share
# of what is left, forces are off what the expert commands there by 1 to 3 N, else by 0.1 to 0.3.
_LEAST_LEFT, _COARSEST = 2.0, 0.2


def labels_of(plans: list[Plan], least_horizon: float | None = None) -> Labels:
    """States, goals and forces of the knots of plans; of one with slack, of its start alone.

    A knot says what the expert would command there only while what is left of the plan is well
    above the expert's least horizon (s), which a plan from there would not go below, and not much
    coarser than such a plan. None: starts alone.
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
            f"{path} holds labels of something else: remove it, or name another folder"
        )
    return content
