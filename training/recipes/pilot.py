"""Our end-to-end recipe: from expert flights to a pilot that flies, part by part and as a whole."""

from __future__ import annotations

import dataclasses as dc
import functools
import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn

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
from proxops.training.loop import (
    Schedule,
    Trained,
    TrainingTask,
    frame_batches,
    seeded,
)
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
    Commands,
    Hits,
    box_of,
    coarse_examples,
    commands_of,
    fixes_of,
    flight_labels,
    hits_of,
    natural_commands,
    transitions_of,
)
from proxops.training.recipes.pilot_losses import (
    coarse_loss,
    end_to_end_loss,
    filter_loss,
    geometry_loss,
    guidance_loss,
    motion_loss,
)
from proxops.training.recipes.recipe import (
    Learner,
    RecipeSettings,
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


@dc.dataclass(frozen=True, kw_only=True)
class PilotSettings(RecipeSettings):
    """Settings of a training by our recipe: numbers of examples, sizes, schedules."""

    MAIN = "guidance"
    frames: int = 60_000
    """Greatest number of frames from which the position is learned."""
    hits: int = 64
    """Returns of a frame that the pilot uses."""
    cells: int = 48
    """Cells of the surface's grid along the body's longest side."""
    plans: int = 24_000
    """Transits whose plans the guidance learns from, besides the flights."""
    windows: int = 1200
    """Greatest number of windows of flights that the filter learns from."""
    window: int = 40
    """Steps in a window, for the filter and for the end-to-end training."""
    width: int = 256
    """Width of the guidance's layers."""
    coarse: Schedule = Schedule(epochs=80, batch=512, learning_rate=3e-3)
    geometry: Schedule = Schedule(epochs=12, batch=256, learning_rate=3e-2)
    motion: Schedule = Schedule(epochs=50, batch=1024, learning_rate=4e-3)
    filter: Schedule = Schedule(epochs=20, batch=64, learning_rate=1e-1)
    guidance: Schedule = Schedule(epochs=20, batch=1024, learning_rate=2e-3)
    end_to_end: Schedule = Schedule(epochs=2, batch=32, learning_rate=2e-4)

    def quick(self) -> PilotSettings:
        """Settings for a smaller pilot, trained in about a minute; it flies less well."""
        return dc.replace(
            self,
            frames=3000,
            cells=32,
            plans=200,
            windows=32,
            width=64,
            coarse=dc.replace(self.coarse, epochs=20, batch=64),
            geometry=dc.replace(self.geometry, batch=64),
            motion=dc.replace(self.motion, epochs=20, batch=256),
            filter=dc.replace(self.filter, epochs=6, batch=8),
            guidance=dc.replace(self.guidance, epochs=8, batch=256),
            end_to_end=dc.replace(self.end_to_end, batch=8),
        )


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
    part = functools.partial(part_task, settings=settings, identity=identity)
    trained: dict[str, Trained] = {}

    def train_part(task: TrainingTask) -> None:
        progress = _stage(task.name, workers).progress
        trained[task.name] = learned(task, out, settings, progress)

    _stage("frames", workers).progress(0.0, "choosing frames")
    frames = [_frames(flights, name, settings) for name in _LEARNED_PARTS]
    dimensions = dimensions_of(flights, frames[0], settings)
    with seeded(settings.seed):
        pilot = dimensions.make()
    examples = coarse_examples(pilot.coarse, *frames)
    train_part(part("coarse", pilot.coarse.network, coarse_loss, examples))
    loss = functools.partial(geometry_loss, scaling=scaling)
    train_part(part("geometry", pilot.geometry, loss, frames))
    position_errors = _fit_residual(pilot, frames[1])
    del frames, examples  # Up to some GB.

    motion, steps = pilot.filter.motion, [transitions_of(flights, name) for name in _LEARNED_PARTS]
    size, methods = 4 * settings.motion.batch, ("natural", "thrust")
    train_part(part("motion", motion, motion_loss, steps, held_size=size, methods=methods))
    motion.requires_grad_(False)
    counts = zip(_LEARNED_PARTS, (settings.windows, settings.windows // 4), strict=True)
    fixes = [fixes_of(pilot, flights, *each, settings.window, settings.seed) for each in counts]
    loss, methods = functools.partial(filter_loss, scaling=scaling), ("predict", "correct")
    train_part(part("filter", pilot.filter, loss, fixes, methods=methods))

    labels = known_labels(scenario, flights, out, settings, _stage("plans", workers))
    commands, held = commands_of(labels), commands_of(flight_labels(flights, "validation"))
    data_sha256 = sha256_of(commands, flights.logs_sha256)
    identity = f"{identity}, {data_sha256}"
    train_part(guidance_task(pilot, commands, held, settings, identity))
    # All parts but the motion learn from the force.
    loss, schedule = functools.partial(end_to_end_loss, scaling=scaling), settings.end_to_end
    windows = frame_batches(flights, settings.window, None, schedule.batch, settings.seed)
    told, methods = f"{identity}, {settings}", ("sequence",)
    train_part(TrainingTask("end_to_end", pilot, loss, *windows, schedule, told, 1, methods))

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
    held = commands_of(flight_labels(flights, "validation"))
    origin = file_sha256(first / PILOT_FILE)

    def learn(labels: Labels, folder: Path, this: Round, progress: Progress) -> dict[str, Any]:
        share = 1.0 if this.last else expert_only / len(labels["state"])
        epochs = this.epochs or max(1, round(share * settings.guidance.epochs))
        schedule = dc.replace(settings.guidance, epochs=epochs)
        own = dc.replace(settings, seed=settings.seed + this.number, guidance=schedule)
        fresh, commands = restarted(dimensions, pilot, own.seed), commands_of(labels)
        data_sha256 = sha256_of(commands, flights.logs_sha256)
        identity = f"proxops recipe, DAgger from {origin}, data {data_sha256}"
        task = guidance_task(fresh, commands, held, own, identity)
        # If more rounds are asked for later, the last one becomes another, of fewer epochs.
        task = dc.replace(task, name=f"guidance_{epochs}_epochs")
        trained = {"guidance": learned(task, folder, own, progress)}
        report = report_head("proxops, DAgger", settings, {"logs_sha256": flights.logs_sha256})
        report |= {"rounds": list(this.outcomes)}
        return _written(fresh, dimensions, flights, trained, report, data_sha256, folder)

    files = (PILOT_FILE, "report.json", "report.md", "forces.png")
    return Learner(first, labels, lambda number: [scenario], learn, files, flights=240)


def part_task(
    name: str,
    network: nn.Module,
    loss: Callable[..., Tensor],
    columns: Sequence[Sequence[Tensor]],
    settings: PilotSettings,
    identity: str,
    **options: Any,
) -> TrainingTask:
    """The task of a part, as of `TrainingTask.on_tensors`; its schedule is named as the part."""
    schedule, seed = getattr(settings, name), settings.seed
    return TrainingTask.on_tensors(
        name, network, loss, columns, schedule, seed, identity, threads=1, **options
    )


def guidance_task(
    pilot: Pilot, training: Commands, validation: Commands, settings: PilotSettings, identity: str
) -> TrainingTask:
    """The guidance learns the expert's commands.

    The last epoch is kept. Most of the remaining error on other flights is which way round the body
    the expert goes, and that says little about how well the guidance flies.
    """
    columns = [natural_commands(pilot.filter.motion, each) for each in (training, validation)]
    options: dict[str, Any] = {"held_size": 8192, "keep_last": True}
    return part_task(
        "guidance", pilot.guidance, guidance_loss, columns, settings, identity, **options
    )


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
