"""Files of labels: states, goals, and the expert's forces there."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from proxops.systems.common import InputError, write_whole
from proxops.systems.expert import Plan

Labels = dict[str, np.ndarray]
"""`state` (N, 6), `goal` (N, 3) and `force` (N, 3), in K and SI."""

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
    """Joins labels."""
    return {name: np.concatenate([part[name] for part in parts]) for name in _NAMES}


def save_labels(path: Path, labels: Labels, origin: str) -> None:
    """Writes labels and their origin; the file is complete or not there."""
    content = labels | {"origin": np.array(origin)}

    def write(name: Path) -> None:
        with name.open("wb") as file:
            np.savez(file, allow_pickle=False, **content)

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
        count = len(content["state"])
        shapes = {"state": (count, 6), "goal": (count, 3), "force": (count, 3)}
        sound = all(
            content[key].shape == shape and content[key].dtype == np.float64
            for key, shape in shapes.items()
        )
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
