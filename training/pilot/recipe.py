"""Our recipe: the learned pilot from expert flights, part by part and whole, to a bundle."""

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
from proxops.training.loop import Schedule, Trained, TrainingTask, seeded, train
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
from proxops.training.pilot.settings import PilotSettings, shape_of
from proxops.training.pilot.shape import save_pilot
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

# Share of the bar at which each stage ends.
_STAGES = {
    "packing": 0.03,
    "looking": 0.08,
    "coarse": 0.15,
    "geometry": 0.30,
    "motion": 0.34,
    "filter": 0.39,
    "plans": 0.55,
    "guidance": 0.90,
    "end_to_end": 0.96,
    "replaying": 1.0,
}
_PLANS_SEED = 1


def train_pilot(
    data: Path,
    out: Path,
    settings: PilotSettings,
    workers: Workers = Workers(),
) -> dict[str, Any]:
    """Trains the pilot on what `proxops collect` wrote; writes and returns the report.

    Writes pilot.ckpt, a checkpoint and curves for each part, plans/, report.json, report.md,
    forces.png, and bundle/, which flies, in `out`. Run again after a kill, it goes on behind the
    last whole epoch, and with the plans that are not there yet.

    Args:
      workers: compute plans, and report how far the training is.

    Raises:
      InputError: there are no flights to learn from, or see `pack_flights`, `expert_plans` and
        `training_loop.train`.
    """
    progress = workers.progress
    scenario = collected_scenario(data)
    flights = pack_flights(data / "flights", progress=part_of(progress, 0.0, _STAGES["packing"]))
    identity = (
        f"proxops recipe, logs {flights.logs_sha256}, {settings.frames} frames, "
        f"{settings.cells} cells, {settings.plans} plans, windows of {settings.window}"
    )
    trained: dict[str, Trained] = {}

    def teach(task: TrainingTask, schedule: Schedule) -> None:
        trained[task.name] = train(
            task,
            schedule,
            out,
            settings.seed,
            device=settings.device,
            precision=settings.precision,
            progress=_stage(task.name, workers).progress,
        )
        task.network.cpu()

    progress(_STAGES["packing"], "looking at frames")
    setting, scaling = flights.setting, scaling_of(flights.setting)
    selection = HitSelection(setting.planes, setting.rays, _kept(settings.hits), scaling.length)
    with torch.no_grad():
        seen = {
            part: hits_of(flights, selection, part, count, settings.seed)
            for part, count in (("training", settings.frames), ("validation", settings.frames // 8))
        }
    shape = shape_of(flights, seen["training"], settings)
    with seeded(settings.seed):
        pilot = shape.make()
    examples = seen["training"], seen["validation"]
    taught = settings.coarse, settings.seed, identity
    teach(coarse_task(pilot.coarse, *examples, *taught), settings.coarse)
    taught = settings.geometry, settings.seed, identity
    teach(geometry_task(pilot.geometry, *examples, scaling, *taught), settings.geometry)
    position_errors = _position_errors(pilot, seen["validation"])
    del seen, examples

    period = flights.setting.control_period_s
    flown, held = (transitions_of(flights, part, period) for part in ("training", "validation"))
    motion = pilot.filter.motion
    taught = settings.motion, settings.seed, identity
    teach(motion_task(motion, flown, held, *taught), settings.motion)
    motion.requires_grad_(False)
    taught = settings.filter, settings.seed, identity
    task = filter_task(pilot, flights, scaling, settings.window, settings.windows, *taught)
    teach(task, settings.filter)

    labels = expert_labels(scenario, out, settings, _stage("plans", workers))
    known = known_commands(flights, labels)
    learned_from = data_sha256(flights, known)
    taught = settings.guidance, settings.seed, f"{identity}, {learned_from}"
    task = guidance_task(
        pilot.guidance,
        motion,
        known,
        commands_of(flights, "validation"),
        *taught,
    )
    teach(task, settings.guidance)
    task = end_to_end_task(
        pilot, flights, scaling, settings.window, settings.end_to_end, settings.seed,
        f"{identity}, {learned_from}, {settings}",
    )  # fmt: skip
    teach(task, settings.end_to_end)
    pilot.eval()

    progress(_STAGES["end_to_end"], "flying through the logs")
    report = pilot_report(pilot, settings, trained, flights.logs_sha256)
    report |= {"position_errors": position_errors}
    report = write_report(pilot, flights, report, out)
    origin = {"logs_sha256": flights.logs_sha256, "settings": dc.asdict(settings)}
    save_pilot(out, shape, pilot, origin)
    export_pilot(pilot, flights, report, out / "bundle", learned_from)
    progress(1.0, "done")
    return report


def expert_labels(
    scenario: Scenario,
    folder: Path,
    settings: PilotSettings,
    workers: Workers = Workers(),
) -> Labels:
    """The plans that the guidance learns from, computed once and kept in `folder`/plans."""
    return expert_plans(scenario, _PLANS_SEED, settings.plans, folder / "plans", workers)


def known_commands(flights: PackedFlights, labels: Labels) -> Commands:
    """All that the guidance learns from: the flights to train on, and plans."""
    return joined([commands_of(flights, "training"), labelled_commands(labels)])


def data_sha256(flights: PackedFlights, known: Commands) -> str:
    """Hash of all that a pilot learns from: the flights, and what is known of the expert."""
    data = hashlib.sha256(flights.logs_sha256.encode())
    for column in known:
        data.update(column.numpy().tobytes())
    return data.hexdigest()


def collected_scenario(data: Path) -> Scenario:
    """The scenario of a set of flights, by its manifest.

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
def _position_errors(pilot: Pilot, hits: Hits) -> dict[str, dict[str, float]]:
    """Errors in m of the coarse position and after three steps of the layer; fits the residual.

    The residual is that of fixes that are good because they start from the truth.
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
    """What a report says of how the pilot was trained."""
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
    """Writes the bundle that flies; `learned_from` is the `data_sha256` of what the pilot saw."""
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
    names = list(_STAGES)
    return workers.part(_STAGES[names[names.index(name) - 1]], _STAGES[name])


def _kept(hits: int) -> int:
    """Returns kept of each frame to learn from; each step of learning looks at some of them."""
    return max(192, hits)
