"""Our recipe: from expert flights to a pilot that flies, trained part by part and end to end."""

from __future__ import annotations

import dataclasses as dc
import hashlib
import json
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from proxops.diagrams.flight import Workers
from proxops.diagrams.scenario import Scenario, parse_scenario
from proxops.systems.common import InputError, part_of
from proxops.training.data import Labels, PackedFlights, expert_plans, pack_flights, scaling_of
from proxops.training.export import export_recipe, report_title, write_report
from proxops.training.loop import Trained, TrainingTask, seeded, train
from proxops.training.pilot.examples import (
    Commands,
    Hits,
    commands_of,
    hits_of,
    joined,
    labelled_commands,
    transitions_of,
)
from proxops.training.pilot.lidar_hits import HitSelection
from proxops.training.pilot.network import Pilot
from proxops.training.pilot.pilot_file import save_pilot
from proxops.training.pilot.settings import PilotSettings, dimensions_of, origin_of
from proxops.training.pilot.state_filter import MEMORY
from proxops.training.pilot.tasks import (
    coarse_task,
    end_to_end_task,
    filter_task,
    geometry_task,
    guidance_task,
    motion_task,
)
from proxops.training.reports import markdown_page, policy_sections

# Share of the whole work at which each stage ends.
_STAGES = {
    "packing": 0.03,
    "frames": 0.08,
    "coarse": 0.15,
    "geometry": 0.30,
    "motion": 0.34,
    "filter": 0.39,
    "plans": 0.55,
    "guidance": 0.90,
    "end_to_end": 0.96,
}
_PLANS_SEED = 1
_LEARNED_PARTS = ("training", "validation")
# Returns that are kept of each training frame; each step of training sees some of them.
_KEPT_RETURNS = 192


def train_pilot(
    data: Path,
    out: Path,
    settings: PilotSettings,
    workers: Workers = Workers(),
) -> dict[str, Any]:
    """Trains the pilot on what `proxops collect` wrote; writes and returns the report.

    Writes pilot.ckpt, a checkpoint and curves for each part, plans/, report.json, report.md,
    forces.png, and bundle/, which flies, to `out`. After a kill it continues behind the last
    complete epoch, and computes only the plans that are missing.

    Args:
      workers: compute the plans, and report the progress of the training.

    Raises:
      InputError: there are no flights to learn from, or see `pack_flights`, `expert_plans` and
        `train`.
    """
    progress, seed = workers.progress, settings.seed
    scenario = collected_scenario(data)
    flights = pack_flights(data / "flights", progress=part_of(progress, 0.0, _STAGES["packing"]))
    scaling = scaling_of(flights.setting)
    identity = (
        f"proxops recipe, logs {flights.logs_sha256}, {settings.frames} frames, "
        f"{settings.cells} cells, {settings.plans} plans, windows of {settings.window}, "
        f"{settings.hits} returns"
    )
    trained: dict[str, Trained] = {}

    def train_part(task: TrainingTask) -> None:
        options: Any = {"device": settings.device, "precision": settings.precision}
        stage = _stage(task.name, workers)
        trained[task.name] = train(task, out, seed, progress=stage.progress, **options)
        task.network.cpu()

    progress(_STAGES["packing"], "choosing frames")
    frames, held_frames = (_frames(flights, part, settings) for part in _LEARNED_PARTS)
    dimensions = dimensions_of(flights, frames, settings)
    with seeded(seed):
        pilot = dimensions.make()
    motion = pilot.filter.motion
    train_part(coarse_task(pilot.coarse, frames, held_frames, settings.coarse, seed, identity))
    train_part(geometry_task(pilot.geometry, frames, held_frames, scaling, settings.geometry, seed,
                             identity))  # fmt: skip
    position_errors = _fit_residual(pilot, held_frames)
    del frames, held_frames  # Up to some GB.

    steps, held_steps = (transitions_of(flights, part) for part in _LEARNED_PARTS)
    train_part(motion_task(motion, steps, held_steps, settings.motion, seed, identity))
    motion.requires_grad_(False)
    train_part(filter_task(pilot, flights, scaling, settings, identity))

    labels = expert_labels(scenario, out, settings, _stage("plans", workers))
    commands, held_commands = known_commands(flights, labels), commands_of(flights, "validation")
    learned_from = data_sha256(flights, commands)
    identity = f"{identity}, {learned_from}"
    train_part(guidance_task(pilot.guidance, motion, commands, held_commands, settings.guidance,
                             seed, identity))  # fmt: skip
    train_part(end_to_end_task(pilot, flights, scaling, settings, f"{identity}, {settings}"))
    pilot.eval()

    progress(_STAGES["end_to_end"], "replaying the logged flights")
    report = pilot_report(pilot, settings, trained, flights.logs_sha256)
    report |= {"position_errors": position_errors}
    report = write_report(pilot, flights, report, out)
    save_pilot(out, dimensions, pilot, origin_of(flights, settings))
    export_pilot(pilot, flights, report, out / "bundle", learned_from)
    progress(1.0, "done")
    return report


@torch.no_grad()
def _frames(flights: PackedFlights, part: str, settings: PilotSettings) -> Hits:
    """The returns of the frames that the position is learned from, or of those for validation."""
    if not flights.part(part):
        raise InputError(
            f"{flights.folder} has no flights of the {part} part: collect more transits"
        )
    setting, scaling = flights.setting, scaling_of(flights.setting)
    kept = min(max(_KEPT_RETURNS, settings.hits), setting.planes * setting.rays)
    selection = HitSelection(setting.planes, setting.rays, kept, scaling.length)
    count = settings.frames if part == "training" else settings.frames // 8
    return hits_of(flights, selection, part, count, settings.seed)


def expert_labels(
    scenario: Scenario,
    folder: Path,
    settings: PilotSettings,
    workers: Workers = Workers(),
) -> Labels:
    """States and the expert's forces there, from plans that are kept in `folder`/plans."""
    return expert_plans(scenario, _PLANS_SEED, settings.plans, folder / "plans", workers)


def known_commands(flights: PackedFlights, labels: Labels) -> Commands:
    """All that the guidance learns from: the commands of the training flights, and the labels."""
    return joined([commands_of(flights, "training"), labelled_commands(labels)])


def data_sha256(flights: PackedFlights, commands: Commands) -> str:
    """Hash of all that a pilot learns from: the flights and the expert's commands."""
    data = hashlib.sha256(flights.logs_sha256.encode())
    for column in commands:
        data.update(column.numpy().tobytes())
    return data.hexdigest()


def collected_scenario(data: Path) -> Scenario:
    """Reads the scenario of a set of flights from its manifest.

    Raises:
      InputError: `data` is not what `proxops collect` wrote.
    """
    try:
        manifest = json.loads((data / "manifest.json").read_text())
        return parse_scenario(manifest["scenario"], f"{data / 'manifest.json'}")
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise InputError(
            f"{data} is not what `proxops collect` wrote: its manifest.json cannot be read "
            f"({error})"
        ) from error


@torch.no_grad()
def _fit_residual(pilot: Pilot, hits: Hits) -> dict[str, dict[str, float]]:
    """Sets the pilot's usual residual; returns errors of position in m.

    The usual residual is that of good fixes, which start from the true position. The errors are
    those of the coarse position and of three steps of the geometry layer from there.
    """
    parts: list[tuple[Tensor, ...]] = []
    for start in range(0, len(hits.position), 512):
        points, solid, valid, count, position = (each[start : start + 512] for each in hits)
        coarse = pilot.coarse(points, solid, valid, count)
        place = coarse
        for _ in range(3):
            place, _ = pilot.geometry(place, points, valid)
        good, _ = pilot.geometry(position, points, valid)
        _, residual = pilot.geometry(good, points, valid)
        parts.append(((coarse - position).norm(dim=1), (place - position).norm(dim=1), residual))
    coarse, fitted, residual = (torch.cat(column) for column in zip(*parts, strict=True))
    pilot.fit_residual(residual)
    return {
        name: {"median": float(errors.median()), "p95": float(errors.quantile(0.95))}
        for name, errors in (("coarse", coarse), ("fitted", fitted))
    }


def pilot_report(
    pilot: Pilot, settings: Any, trained: dict[str, Trained], data: str
) -> dict[str, Any]:
    """The part of a report that says how the pilot was trained."""
    last = trained["guidance"]
    best = last.history[last.best_epoch]
    return {
        "recipe": "proxops",
        "logs_sha256": data,
        "settings": dc.asdict(settings),
        "parameters": sum(weights.numel() for weights in pilot.parameters()),
        "training": {
            "epochs": len(last.history),
            "best_epoch": last.best_epoch,
            "training_loss": best["training_loss"],
            "validation_loss": best["validation_loss"],
            "cpu_s": sum(each.cpu_s for each in trained.values()),
            "wall_s": sum(each.history[-1]["wall_s"] for each in trained.values()),
        },
        "stages": {
            name: {
                "cpu_s": each.cpu_s,
                "validation_loss": each.history[each.best_epoch]["validation_loss"],
            }
            for name, each in trained.items()
        },
    }


def export_pilot(
    pilot: Pilot, flights: PackedFlights, report: dict[str, Any], folder: Path, learned_from: str
) -> None:
    """Writes the bundle that flies; `learned_from` is the `data_sha256` of its training data."""
    export_recipe(
        pilot,
        flights,
        folder,
        recipe="proxops",
        memory=MEMORY,
        estimates=True,
        data_sha256=learned_from,
        metrics={"parts": report["parts"]},
        report=markdown_page(report_title(report), policy_sections(report)),
    )


def _stage(name: str, workers: Workers) -> Workers:
    """The workers, which report the progress of one stage as a part of the whole."""
    names = list(_STAGES)
    return workers.part(_STAGES[names[names.index(name) - 1]], _STAGES[name])
