"""The paper's recipe: a CNN and an LSTM on lidar frames imitate the expert's force."""

from __future__ import annotations

import dataclasses as dc
from pathlib import Path
from typing import Any

from torch import Tensor

from proxops.diagrams.flight import Workers
from proxops.training.data import PackedFlights, pack_flights
from proxops.training.export import export_recipe, write_report
from proxops.training.loop import Batch, Schedule, TrainingTask, frame_batches, seeded
from proxops.training.networks import PaperPolicy
from proxops.training.recipes.recipe import RecipeSettings, learned, report_head

# Shares of the whole work at which packing and training end; the report follows.
_PACKED, _TRAINED = 0.05, 0.95


@dc.dataclass(frozen=True, kw_only=True)
class PaperSettings(RecipeSettings):
    """Settings of the paper's recipe, with the paper's values where it gives any."""

    schedule: Schedule = Schedule(epochs=12, batch=8, learning_rate=1e-3, patience=10)
    window: int = 64
    """Steps of a window, through which gradients run; in flight the memory lasts longer."""
    stride: int | None = None
    """Steps from the start of one window to that of the next; None: the length of a window."""
    channels: tuple[int, ...] = (32, 64, 64)
    width: int = 128
    layers: int = 2
    """Layers of the LSTM."""
    device: str = "auto"

    def quick(self) -> PaperSettings:
        """Settings for a first try: a small network, two epochs, few of the data."""
        schedule = dc.replace(self.schedule, epochs=2)
        small: dict[str, Any] = {"window": 8, "stride": 64, "channels": (8, 8, 8), "width": 32}
        return dc.replace(self, schedule=schedule, **small)


def train_paper_policy(
    data: Path, out: Path, settings: PaperSettings, workers: Workers = Workers()
) -> dict[str, Any]:
    """Trains the paper's policy on expert flights; writes and returns the report.

    Writes policy.ckpt, curves/, report.json, report.md, forces.png, and bundle/, which flies, to
    `out`. After a kill it continues behind the last complete epoch.

    Args:
      data: what `proxops collect` wrote, or a folder of logs.
      workers: report the progress.

    Raises:
      InputError: there are no flights to learn from, or see `pack_flights` and `train`.
    """
    logs = data / "flights" if (data / "flights").is_dir() else data
    flights = pack_flights(logs, progress=workers.part(0.0, _PACKED).progress)
    policy = make_policy(flights, settings)
    trained = learned(
        TrainingTask(
            "policy",
            policy,
            rms_force_loss,
            *frame_batches(
                flights, settings.window, settings.stride, settings.schedule.batch, settings.seed
            ),
            settings.schedule,
            f"paper recipe, logs {flights.logs_sha256}, "
            f"windows of {settings.window} every {settings.stride}",
            methods=("sequence",),
        ),
        out,
        settings,
        workers.part(_PACKED, _TRAINED).progress,
    )
    workers.progress(_TRAINED, "flying through the logs")
    report = report_head("paper", settings, {"logs_sha256": flights.logs_sha256}) | {
        "parameters": sum(weights.numel() for weights in policy.parameters()),
        "training": trained.figures(),
    }
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
    workers.progress(1.0, "done")
    return report


def make_policy(flights: PackedFlights, settings: PaperSettings) -> PaperPolicy:
    """The network for the flights, with the weights that the settings' seed gives."""
    lidar = flights.setting
    sizes = settings.channels, settings.width, settings.layers
    with seeded(settings.seed):
        return PaperPolicy(flights.normalisation, lidar.planes, lidar.rays, *sizes)


def rms_force_loss(policy: PaperPolicy, batch: Batch) -> Tensor:
    """The paper's loss: root mean square difference from the MPC's force in N, over all axes."""
    force, _, _ = policy.sequence(batch["frames"], batch["target"], batch["commanded_force"])
    squares = ((force - batch["mpc_force"]) ** 2).mean(dim=-1) * batch["labelled"]
    # Without this, the slope of the root at 0 would be infinite.
    return (squares.sum() / batch["labelled"].sum().clamp(min=1) + 1e-12).sqrt()
