"""The paper's recipe: from flight logs to a trained policy, its bundle and its report."""

from __future__ import annotations

import dataclasses as dc
from pathlib import Path
from typing import Any

from torch import Tensor

from proxops.systems.common import Progress, part_of, silent
from proxops.training.data import PackedFlights, pack_flights
from proxops.training.export import export_recipe, write_report
from proxops.training.loop import (
    Batch,
    Schedule,
    Trained,
    TrainingTask,
    frame_batches,
    seeded,
    train,
)
from proxops.training.paper.policy import PaperPolicy

# Shares of the whole work at which packing and training end; the report follows.
_PACKED, _TRAINED = 0.05, 0.95


@dc.dataclass(frozen=True)
class PaperSettings:
    """Settings of a training by the paper's recipe, with the paper's values where it gives any."""

    schedule: Schedule = dc.field(
        default_factory=lambda: Schedule(epochs=12, batch=8, learning_rate=1e-3, patience=10)
    )
    window: int = 64
    """Steps of a window, through which gradients run; in flight the memory lasts longer."""
    stride: int | None = None
    """Steps from the start of one window to that of the next; None: the length of a window."""
    channels: tuple[int, ...] = (32, 64, 64)
    width: int = 128
    layers: int = 2
    """Layers of the LSTM."""
    seed: int = 0
    """Seed of the first weights and of the order of the examples."""
    device: str = "auto"
    precision: str = "32-true"

    def quick(self) -> PaperSettings:
        """Settings for a first try: a small network, two epochs, few of the data."""
        return dc.replace(
            self,
            schedule=dc.replace(self.schedule, epochs=2),
            window=8,
            stride=64,
            channels=(8, 8, 8),
            width=32,
        )


def rms_force_loss(policy: PaperPolicy, batch: Batch) -> Tensor:
    """The paper's loss: root mean square difference from the MPC's force in N, over all axes."""
    force, _, _ = policy.sequence(batch["frames"], batch["target"], batch["commanded_force"])
    squares = ((force - batch["mpc_force"]) ** 2).mean(dim=-1) * batch["labelled"]
    # Without this, the slope of the root at 0 would be infinite.
    return (squares.sum() / batch["labelled"].sum().clamp(min=1) + 1e-12).sqrt()


def train_paper_policy(
    data: Path, out: Path, settings: PaperSettings, progress: Progress = silent
) -> dict[str, Any]:
    """Trains the paper's policy on expert flights; writes and returns the report.

    Writes policy.ckpt, curves/, report.json, report.md, forces.png, and bundle/, which flies, to
    `out`. After a kill it continues behind the last complete epoch.

    Args:
      data: what `proxops collect` wrote, or a folder of logs.

    Raises:
      InputError: there are no flights to learn from, or see `pack_flights` and
        `training_loop.train`.
    """
    logs = data / "flights" if (data / "flights").is_dir() else data
    flights = pack_flights(logs, progress=part_of(progress, 0.0, _PACKED))
    policy = make_policy(flights, settings)
    trained = train(
        _task(flights, policy, settings),
        out,
        settings.seed,
        device=settings.device,
        precision=settings.precision,
        progress=part_of(progress, _PACKED, _TRAINED),
    )
    progress(_TRAINED, "flying through the logs")
    report = _report(trained, policy, settings, flights.logs_sha256)
    report = write_report(policy, flights, report, out)
    export_recipe(
        policy,
        flights,
        out / "bundle",
        recipe="paper",
        memory=policy.memory_size,
        estimates=False,
        data_sha256=flights.logs_sha256,
        metrics={"parts": report["parts"]},
    )
    progress(1.0, "done")
    return report


def make_policy(flights: PackedFlights, settings: PaperSettings) -> PaperPolicy:
    """The network, with the weights that the settings' seed gives."""
    with seeded(settings.seed):
        return PaperPolicy(
            flights.normalisation,
            flights.setting.planes,
            flights.setting.rays,
            settings.channels,
            settings.width,
            settings.layers,
        )


def _task(flights: PackedFlights, policy: PaperPolicy, settings: PaperSettings) -> TrainingTask:
    batches = frame_batches(
        flights, settings.window, settings.stride, settings.schedule.batch, settings.seed
    )
    identity = (
        f"paper recipe, logs {flights.logs_sha256}, "
        f"windows of {settings.window} every {settings.stride}"
    )
    return TrainingTask(
        "policy",
        policy,
        rms_force_loss,
        *batches,
        settings.schedule,
        identity,
        methods=("sequence",),
    )


def _report(
    trained: Trained, policy: PaperPolicy, settings: PaperSettings, data: str
) -> dict[str, Any]:
    best = trained.history[trained.best_epoch]
    return {
        "recipe": "paper",
        "logs_sha256": data,
        "settings": dc.asdict(settings),
        "parameters": sum(weights.numel() for weights in policy.parameters()),
        "training": {
            "epochs": len(trained.history),
            "best_epoch": trained.best_epoch,
            "training_loss": best["training_loss"],
            "validation_loss": best["validation_loss"],
            "cpu_s": trained.cpu_s,
            "wall_s": trained.history[-1]["wall_s"],
        },
    }
