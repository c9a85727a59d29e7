"""`Recipe`: how one kind of policy is trained; and what all recipes share."""

from __future__ import annotations

import dataclasses as dc
import hashlib
import json
from collections.abc import Callable, Iterable, Sequence
from importlib import metadata
from pathlib import Path
from typing import Any, ClassVar, Self, TypeVar

from torch import Tensor

from proxops.diagrams.scenario import Scenario
from proxops.systems.common import InputError, Progress, silent
from proxops.training.data import Labels
from proxops.training.loop import Schedule, Trained, TrainingTask, train
from proxops.training.reports import Text

# Errors of force over the thrust limit. Below the first, the loss is quadratic. Beyond the second,
# which a hybrid's gate refuses, a greater error costs little more: it mostly shows that the expert
# goes the other way around the body.
_SMALL_FORCE, _TAKEN_FORCE = 0.1 / 7.0, 0.8 / 7.0
# Weight of the error's length in the loss.
_LENGTH_SHARE = 1.4


@dc.dataclass(frozen=True, kw_only=True)
class RecipeSettings:
    """Settings that every recipe has; each adds its own sizes and schedules."""

    MAIN: ClassVar[str] = "schedule"
    """Name of the schedule of the network that learns the expert's force."""
    seed: int = 0
    """Seed of the first weights and of the order of the examples."""
    device: str = "cpu"
    """For Lightning Fabric. Our networks are small, so a CPU is as fast as any other device."""
    precision: str = "32-true"

    def quick(self) -> Self:
        """Settings for a first try: small networks, few data and epochs; it flies less well."""
        raise NotImplementedError

    def limited(self, epochs: int | None, minutes: float | None = None) -> Self:
        """These, with another number of epochs, all of which are run, and a limit of time.

        They are those of the network that learns the expert's force. None: as many as before.
        """
        schedule: Schedule = dc.replace(getattr(self, self.MAIN), minutes=minutes)
        if epochs is not None:
            schedule = dc.replace(schedule, epochs=epochs, patience=None)
        return dc.replace(self, **{self.MAIN: schedule})


Settings = TypeVar("Settings", bound=RecipeSettings)


@dc.dataclass(frozen=True)
class Recipe:
    """A kind of policy: its settings and its training."""

    settings: type[RecipeSettings]
    train: Callable[..., dict[str, Any]]
    """Takes the data, the folder to write to, the settings and the workers; gives the report."""


@dc.dataclass(frozen=True)
class Learner:
    """A trained policy that learns on: what `run_dagger` has to know of it."""

    folder: Path
    """Holds its `bundle`, which flies in the first round."""
    labels: Labels
    """All that is known of the expert before the first round, with the column `member`."""
    scenarios: Callable[[int], Sequence[Scenario]]
    """Gives those in which it flies in a round, from 1; a label's `member` is an index in them."""
    learn: Callable[[Labels, Path, Round, Progress], dict[str, Any]]
    """Trains the guidance from nothing on labels; writes the policy to a folder; gives the report.
    """
    files: Sequence[str]
    """Names of what it writes besides `bundle`."""
    flights: int
    """Usual number of flights of a round in each scenario."""
    states: int | None = None
    """So many states of a flight are labelled at most; None: all."""
    own_mass: bool = False
    """Whether it flies with the scenario's mass also in worlds where another one is drawn."""


@dc.dataclass(frozen=True)
class Round:
    """A round of DAgger, whose policy is to learn."""

    number: int
    last: bool
    """Whether it is the last one, whose policy is kept."""
    epochs: int | None
    """Epochs that are asked for; None: as the recipe does."""
    outcomes: Sequence[dict[str, int]]
    """How the flights of this round and those before went."""


def force_loss(force: Tensor, wanted: Tensor, thrust_limit: float) -> Tensor:
    """Mean loss of forces (N, 3): the length of their errors, and a square of it that saturates.

    The saturating square is that of S. Geman and D. E. McClure, Statistical methods for tomographic
    image reconstruction, Bulletin of the International Statistical Institute 52, 1987.
    """
    squared = ((force - wanted) / thrust_limit).square().sum(1)
    length = (squared + _SMALL_FORCE**2).sqrt()
    return (_LENGTH_SHARE * length + squared / (squared + _TAKEN_FORCE**2)).mean()


def learned(
    task: TrainingTask, out: Path, settings: RecipeSettings, progress: Progress = silent
) -> Trained:
    """Trains a network of a recipe, see `train`; leaves it on the CPU."""
    trained = train(
        task,
        out,
        settings.seed,
        device=settings.device,
        precision=settings.precision,
        progress=progress,
    )
    task.network.cpu()
    return trained


def sha256_of(columns: Iterable[Tensor], start: str = "") -> str:
    """Hash of what a policy learns from: a text and tensors."""
    data = hashlib.sha256(start.encode())
    for column in columns:
        data.update(column.numpy().tobytes())
    return data.hexdigest()


def trained_text(run: dict[str, Any]) -> Text:
    """Says how a training at bodies, some of which were held out, went."""
    return Text(
        f"{run['epochs']} epochs, {run['cpu_s']:.0f} s of processor time, loss "
        f"{run['training_loss']:.4f}, and {run['validation_loss']:.4f} at the bodies that were "
        "held out."
    )


def report_head(recipe: str, settings: RecipeSettings, data: dict[str, str]) -> dict[str, Any]:
    """The beginning of a recipe's report, from which `trained_settings` reads."""
    made = {"recipe": recipe, "proxops": metadata.version("proxops")}
    return made | data | {"settings": dc.asdict(settings)}


def trained_settings(
    folder: Path, kind: type[Settings], recipe: str
) -> tuple[Settings, dict[str, Any]]:
    """The settings with which a recipe trained the policy in a folder, and its report.

    Raises:
      InputError: the folder holds none, or it was trained by another version.
    """
    try:
        report = json.loads((folder / "report.json").read_text())
        version, fields = report.get("proxops", "before 1.6.0"), dict(report["settings"])
        for name, value in fields.items():
            if isinstance(value, dict):
                fields[name] = Schedule(**value)
        settings = kind(**fields)
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise InputError(
            f"{folder} is not what `proxops train --recipe {recipe}` wrote: its report.json "
            f"cannot be read ({error})"
        ) from error
    if version != metadata.version("proxops"):
        raise InputError(
            f"{folder} was made by proxops {version}, and this is {metadata.version('proxops')}: "
            "train anew in another folder"
        )
    return settings, report
