"""Our end-to-end recipe: from expert flights to a pilot that flies, part by part and as a whole."""

from __future__ import annotations

import dataclasses as dc
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from proxops.diagrams.flight import Workers
from proxops.diagrams.scenario import Scenario, parse_scenario
from proxops.systems.common import InputError, Progress, file_sha256
from proxops.training.data import (
    Labels,
    PackedFlights,
    body_length,
    expert_plans,
    joined_labels,
    keep_out_of,
    pack_flights,
    scaling_of,
)
from proxops.training.export import export_recipe, report_title, write_report
from proxops.training.loop import Trained, TrainingTask, seeded
from proxops.training.networks import (
    MEMORY,
    PILOT_FILE,
    HitSelection,
    Pilot,
    PilotDimensions,
    load_pilot,
    save_pilot,
)
from proxops.training.recipes.pilot_examples import (
    Hits,
    box_of,
    commands_of,
    flight_labels,
    hits_of,
    transitions_of,
)
from proxops.training.recipes.pilot_tasks import (
    PilotSettings,
    coarse_task,
    end_to_end_task,
    filter_task,
    geometry_task,
    guidance_task,
    motion_task,
)
from proxops.training.recipes.recipe import (
    Learner,
    Round,
    learned,
    report_head,
    sha256_of,
    trained_settings,
)
from proxops.training.reports import markdown_page, policy_sections

# The surface is learned in a box this many grid spacings beyond the returns.
_BOX_MARGIN = 1.5
# The guidance's ellipsoid starts as the keep-out's, this much larger.
_KEEP_OUT_SHARE = 1.02
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
    data: Path, out: Path, settings: PilotSettings, workers: Workers = Workers()
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
    scenario = collected_scenario(data)
    flights = pack_flights(data / "flights", progress=_stage("packing", workers).progress)
    scaling = scaling_of(flights.setting)
    identity = (
        f"proxops recipe, logs {flights.logs_sha256}, {settings.frames} frames, "
        f"{settings.cells} cells, {settings.plans} plans, windows of {settings.window}, "
        f"{settings.hits} returns"
    )
    trained: dict[str, Trained] = {}

    def train_part(task: TrainingTask) -> None:
        progress = _stage(task.name, workers).progress
        trained[task.name] = learned(task, out, settings, progress)

    _stage("frames", workers).progress(0.0, "choosing frames")
    frames, held_frames = (_frames(flights, part, settings) for part in _LEARNED_PARTS)
    dimensions = dimensions_of(flights, frames, settings)
    with seeded(settings.seed):
        pilot = dimensions.make()
    motion = pilot.filter.motion
    train_part(coarse_task(pilot.coarse, frames, held_frames, settings, identity))
    train_part(geometry_task(pilot.geometry, frames, held_frames, scaling, settings, identity))
    position_errors = _fit_residual(pilot, held_frames)
    del frames, held_frames  # Up to some GB.

    steps, held_steps = (transitions_of(flights, part) for part in _LEARNED_PARTS)
    train_part(motion_task(motion, steps, held_steps, settings, identity))
    motion.requires_grad_(False)
    train_part(filter_task(pilot, flights, scaling, settings, identity))

    labels = known_labels(scenario, flights, out, settings, _stage("plans", workers))
    commands, held = commands_of(labels), commands_of(flight_labels(flights, "validation"))
    data_sha256 = sha256_of(commands, flights.logs_sha256)
    identity = f"{identity}, {data_sha256}"
    train_part(guidance_task(pilot.guidance, motion, commands, held, settings, identity))
    train_part(end_to_end_task(pilot, flights, scaling, settings, f"{identity}, {settings}"))

    workers.progress(_STAGES["end_to_end"], "replaying the logged flights")
    report = report_head("proxops", settings, {"logs_sha256": flights.logs_sha256})
    report |= {"position_errors": position_errors}
    report = _written(pilot, dimensions, flights, trained, report, data_sha256, out)
    workers.progress(1.0, "done")
    return report


def pilot_learner(data: Path, first: Path, workers: Workers) -> Learner:
    """The pilot in a folder, which DAgger goes on with; only its guidance learns.

    A round takes as many steps as the first training, although it has more examples. Only the last,
    whose pilot is kept, shows each example as often as the first training did.

    Args:
      data: from which it was trained. first: what `train_pilot` wrote.

    Raises:
      InputError: it was trained from other data or by another version.
    """
    scenario = collected_scenario(data)
    flights = pack_flights(data / "flights", progress=workers.part(0.0, 0.5).progress)
    settings, known = trained_settings(first, PilotSettings, "proxops")
    dimensions, pilot = load_pilot(first)
    if known.get("logs_sha256") != flights.logs_sha256:
        raise InputError(f"the pilot in {first} was trained from other data than {data}")
    labels = known_labels(scenario, flights, first, settings, workers.part(0.5, 1.0))
    expert_only = len(labels["state"])
    held, origin = (
        commands_of(flight_labels(flights, "validation")),
        file_sha256(first / PILOT_FILE),
    )

    def learn(labels: Labels, folder: Path, this: Round, progress: Progress) -> dict[str, Any]:
        share = 1.0 if this.last else expert_only / len(labels["state"])
        epochs = this.epochs or max(1, round(share * settings.guidance.epochs))
        schedule = dc.replace(settings.guidance, epochs=epochs)
        own = dc.replace(settings, seed=settings.seed + this.number, guidance=schedule)
        fresh, commands = restarted(dimensions, pilot, own.seed), commands_of(labels)
        data_sha256 = sha256_of(commands, flights.logs_sha256)
        identity = f"proxops recipe, DAgger from {origin}, data {data_sha256}"
        motion = fresh.filter.motion
        task = guidance_task(fresh.guidance, motion, commands, held, own, identity)
        # If more rounds are asked for later, the last one becomes another, of fewer epochs.
        task = dc.replace(task, name=f"guidance_{epochs}_epochs")
        trained = {"guidance": learned(task, folder, own, progress)}
        report = report_head("proxops, DAgger", settings, {"logs_sha256": flights.logs_sha256})
        report |= {"rounds": list(this.outcomes)}
        return _written(fresh, dimensions, flights, trained, report, data_sha256, folder)

    files = (PILOT_FILE, "report.json", "report.md", "forces.png")
    return Learner(first, labels, lambda number: [scenario], learn, files, flights=240)


def restarted(dimensions: PilotDimensions, pilot: Pilot, seed: int) -> Pilot:
    """A pilot with the parts of the one given, but with a new guidance."""
    with seeded(seed):
        fresh = dimensions.make()
    kept = {
        name: weights
        for name, weights in pilot.state_dict().items()
        if not name.startswith("guidance.")
    }
    fresh.load_state_dict(kept, strict=False)
    fresh.filter.motion.requires_grad_(False)
    return fresh


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


def known_labels(
    scenario: Scenario,
    flights: PackedFlights,
    folder: Path,
    settings: PilotSettings,
    workers: Workers,
) -> Labels:
    """All that the guidance learns from: the training flights, and plans kept in `folder`/plans."""
    plans = expert_plans(scenario, _PLANS_SEED, settings.plans, folder / "plans", workers)
    return joined_labels([flight_labels(flights, "training"), plans])


def dimensions_of(flights: PackedFlights, hits: Hits, settings: PilotSettings) -> PilotDimensions:
    """The dimensions of a pilot for the lidar, spacecraft and body of the flights."""
    setting = flights.setting
    keep_out = keep_out_of(setting)
    low, high = box_of(hits)
    spacing = float((high - low).max()) / settings.cells
    low, high = low - _BOX_MARGIN * spacing, high + _BOX_MARGIN * spacing
    x, y, z = (_KEEP_OUT_SHARE * keep_out).tolist()
    return PilotDimensions(
        planes=setting.planes,
        rays=setting.rays,
        hits=min(settings.hits, setting.planes * setting.rays),
        period=setting.control_period_s,
        mass=setting.mass_kg,
        thrust_limit=setting.thrust_limit_n,
        length=body_length(keep_out),
        keep_out=(x, y, z),
        low=tuple(low.tolist()),
        high=tuple(high.tolist()),
        spacing=spacing,
        guidance_width=settings.width,
    )


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


def _written(
    pilot: Pilot,
    dimensions: PilotDimensions,
    flights: PackedFlights,
    trained: Mapping[str, Trained],
    report: dict[str, Any],
    data_sha256: str,
    out: Path,
) -> dict[str, Any]:
    """Writes a trained pilot, its bundle and its report, which it completes and returns.

    Args:
      trained: the parts that were trained, the guidance among them.
      data_sha256: hash of what it learned from.
    """
    pilot.eval()
    figures = {name: each.figures() for name, each in trained.items()}
    clocks = {name: sum(each[name] for each in figures.values()) for name in ("cpu_s", "wall_s")}
    report = report | {
        "parameters": sum(weights.numel() for weights in pilot.parameters()),
        "training": figures["guidance"] | clocks,
        "stages": {
            name: {"cpu_s": each["cpu_s"], "validation_loss": each["validation_loss"]}
            for name, each in figures.items()
        },
    }
    report = write_report(pilot, flights, report, out)
    save_pilot(out, dimensions, pilot)
    export_recipe(
        pilot,
        flights,
        out / "bundle",
        recipe="proxops",
        memory=MEMORY,
        estimates=True,
        data_sha256=data_sha256,
        metrics={"parts": report["parts"]},
        report=markdown_page(report_title(report), policy_sections(report)),
    )
    return report


def _stage(name: str, workers: Workers) -> Workers:
    """The workers, which report the progress of one stage as a part of the whole."""
    ends = dict(zip(_STAGES, [0.0, *_STAGES.values()], strict=False))
    return workers.part(ends[name], _STAGES[name])
