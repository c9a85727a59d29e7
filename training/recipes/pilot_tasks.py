"""The training tasks of the pilot's parts: what each learns from, and its loss."""

from __future__ import annotations

import dataclasses as dc
import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from proxops.systems.common import InputError
from proxops.training.data import PackedFlights, Scaling
from proxops.training.loop import (
    Batch,
    Schedule,
    TensorBatches,
    TrainingTask,
    WindowDataset,
    frame_batches,
)
from proxops.training.networks import (
    MEMORY,
    CoarsePosition,
    GeometryLayer,
    Guidance,
    Motion,
    Pilot,
    StateFilter,
    measurement_noise,
)
from proxops.training.recipes.pilot_examples import Commands, Hits, Transitions
from proxops.training.recipes.recipe import RecipeSettings, force_loss, of_epochs

# Number of a frame's returns in one step of learning the surface; each step draws others.
_HITS_A_STEP = 96
# Lengths and speeds here are those at Kleopatra, in m and m/s; see `Scaling`.
# Limits of the log-uniform distance from the true position at which the layer starts.
_START_ERRORS = (100.0, 5e3)
# Errors below which the loss is quadratic, after two steps and after one.
_ROUNDED = (10.0, 100.0)
# Unit of the layer's errors in m.
_LAYER_UNIT = 1e3
_FIRST_STEP_WEIGHT, _SURFACE_WEIGHT, _NORMAL_WEIGHT = 0.3, 0.1, 0.1
# Units of the filter's errors in m and m/s, and the distance at which its fixes start in m.
_FILTER_POSITION, _FILTER_SPEED = 20.0, 0.1
_FIX_START = 30.0
# Weight of the error of the estimate beside that of the force, which keeps the parts what they are.
_ESTIMATE_WEIGHT = 0.1
# Steps after which errors count: windows begin in flight, at a velocity that is found first.
_FILTER_SETTLES = 12
# Number of frames whose returns are fitted together.
_BLOCK = 512
# Number of rows whose natural acceleration is computed together.
_ROWS = 65536


@dc.dataclass(frozen=True, kw_only=True)
class PilotSettings(RecipeSettings):
    """Settings of a training by our recipe: numbers of examples, sizes, schedules."""

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
    coarse: Schedule = Schedule(epochs=80, batch=512, learning_rate=3e-3, patience=80)
    geometry: Schedule = Schedule(epochs=12, batch=256, learning_rate=3e-2, patience=12)
    motion: Schedule = Schedule(epochs=50, batch=1024, learning_rate=4e-3, patience=50)
    filter: Schedule = Schedule(epochs=20, batch=64, learning_rate=1e-1, patience=20)
    guidance: Schedule = Schedule(epochs=20, batch=1024, learning_rate=2e-3, patience=20)
    end_to_end: Schedule = Schedule(epochs=2, batch=32, learning_rate=2e-4, patience=2)

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

    def limited(self, epochs: int | None, minutes: float | None = None) -> PilotSettings:
        """These, with another number of epochs of the guidance."""
        guidance = of_epochs(dc.replace(self.guidance, minutes=minutes), epochs)
        return dc.replace(self, guidance=guidance)


def coarse_task(
    coarse: CoarsePosition,
    training: Hits,
    validation: Hits,
    settings: PilotSettings,
    identity: str,
) -> TrainingTask:
    """The coarse position learns from its distance to the true position.

    The features are computed once. Only the network from features to position is trained.
    """
    with torch.no_grad():
        features, centre = _features(coarse, training)
        coarse.fit_scale(features)
        columns = _coarse_columns(coarse, features, centre, training)
        held = _coarse_columns(coarse, *_features(coarse, validation), validation)

    def loss(network: nn.Module, batch: tuple[Tensor, Tensor]) -> Tensor:
        normal, wanted = batch
        return (network(normal) - wanted).norm(dim=1).mean()

    return _task("coarse", coarse.network, loss, columns, held, settings, identity)


def _features(coarse: CoarsePosition, hits: Hits) -> tuple[Tensor, Tensor]:
    parts = [
        coarse.features(*(column[start : start + _BLOCK] for column in hits[:4]))
        for start in range(0, len(hits.position), _BLOCK)
    ]
    features, centres = (torch.cat(column) for column in zip(*parts, strict=True))
    return features, centres


def _coarse_columns(
    coarse: CoarsePosition, features: Tensor, centre: Tensor, hits: Hits
) -> tuple[Tensor, Tensor]:
    return coarse.normalised(features), coarse.wanted(hits.position, centre)


def geometry_task(
    geometry: GeometryLayer,
    training: Hits,
    validation: Hits,
    scaling: Scaling,
    settings: PilotSettings,
    identity: str,
) -> TrainingTask:
    """The layer learns the surface from where two of its steps lead from a start that is off."""
    unit = _LAYER_UNIT * scaling.length

    def loss(layer: GeometryLayer, batch: tuple[Tensor, Tensor, Tensor]) -> Tensor:
        points, valid, position = batch
        chosen = torch.randperm(points.shape[1], device=points.device)[:_HITS_A_STEP]
        points, valid = points[:, chosen], valid[:, chosen]
        low, high = (math.log(error * scaling.length) for error in _START_ERRORS)
        far = torch.exp(low + (high - low) * torch.rand(len(points), 1, device=points.device))
        place = position + far * torch.randn_like(position)
        place, _ = layer(place, points, valid)
        total = _FIRST_STEP_WEIGHT * _rounded((place - position) / unit, _ROUNDED[1])
        place, _ = layer(place, points, valid)
        total = total + _rounded((place - position) / unit, _ROUNDED[0])
        surface = layer.field(position[:, None] + points)
        share = valid / valid.sum(1, keepdim=True).clamp(min=1.0)
        off = surface[..., 0].abs() / unit
        length = ((surface[..., 1:] ** 2).sum(2) + 1e-9).sqrt()
        off = _SURFACE_WEIGHT * off + _NORMAL_WEIGHT * (length - 1.0) ** 2
        return total + (share * off).sum(1).mean()

    columns, held = ((hits.points, hits.valid, hits.position) for hits in (training, validation))
    return _task("geometry", geometry, loss, columns, held, settings, identity)


def _rounded(error: Tensor, small: float) -> Tensor:
    """Mean length of errors (B, 3) in the layer's unit; quadratic below `small` in m."""
    return (error.square().sum(1) + (small / _LAYER_UNIT) ** 2).sqrt().mean()


def motion_task(
    motion: Motion,
    training: Transitions,
    validation: Transitions,
    settings: PilotSettings,
    identity: str,
) -> TrainingTask:
    """The motion learns the mean acceleration of each step."""

    def loss(network: Motion, batch: tuple[Tensor, ...]) -> Tensor:
        position, velocity, force, wanted = batch
        found = network.natural(position, velocity) + network.thrust(force)
        return (found - wanted).abs().mean() / network.acceleration

    size, methods = 4 * settings.motion.batch, ("natural", "thrust")
    return _task(
        "motion", motion, loss, training, validation, settings, identity, size, methods=methods
    )


def guidance_task(
    guidance: Guidance,
    motion: Motion,
    training: Commands,
    validation: Commands,
    settings: PilotSettings,
    identity: str,
) -> TrainingTask:
    """The guidance learns the expert's commands.

    The last epoch is kept. Most of the remaining error on other flights is which way round the body
    the expert goes, and that says little about how well the guidance flies.
    """

    def loss(network: Guidance, batch: tuple[Tensor, ...]) -> Tensor:
        *given, wanted = batch
        return force_loss(network(*given), wanted, network.thrust_limit)

    columns, held = (_with_natural(motion, commands) for commands in (training, validation))
    return _task(
        "guidance", guidance, loss, columns, held, settings, identity, 8192, keep_last=True
    )


@torch.no_grad()
def _with_natural(motion: Motion, commands: Commands) -> tuple[Tensor, ...]:
    """Positions, velocities, goals, natural accelerations and forces (N, 3)."""
    position, velocity, goal, force = commands
    parts = zip(position.split(_ROWS), velocity.split(_ROWS), strict=True)
    natural = torch.cat([motion.natural(*part) for part in parts])
    return position, velocity, goal, natural, force


def filter_task(
    pilot: Pilot,
    flights: PackedFlights,
    scaling: Scaling,
    settings: PilotSettings,
    identity: str,
) -> TrainingTask:
    """The filter learns its noise from its errors along windows of flights without kicks.

    The fixes are computed once. They start as far off as the filter's own predictions are.
    """

    def loss(filter_: StateFilter, batch: tuple[Tensor, ...]) -> Tensor:
        fix, off, force, state = batch
        memory = fix.new_zeros(len(fix), MEMORY)
        errors = []
        for step in range(fix.shape[1]):
            memory = filter_.predict(memory, force[:, step])
            innovation = fix[:, step] - memory[:, :3]
            memory = filter_.correct(memory, innovation, off[:, step])
            if step >= _FILTER_SETTLES:
                errors.append(estimate_error(memory[:, :6], state[:, step], scaling).mean())
        return torch.stack(errors).mean()

    columns = {
        part: _fixes(pilot, flights, part, count, _FIX_START * scaling.length, settings)
        for part, count in (
            ("training", settings.windows), ("validation", settings.windows // 4)
        )
    }  # fmt: skip
    given, methods = (columns["training"], columns["validation"]), ("predict", "correct")
    return _task("filter", pilot.filter, loss, *given, settings, identity, methods=methods)


def end_to_end_task(
    pilot: Pilot,
    flights: PackedFlights,
    scaling: Scaling,
    settings: PilotSettings,
    identity: str,
) -> TrainingTask:
    """All parts but the motion learn the expert's forces along windows of flights.

    The windows begin in flight, where the filter has to find position and velocity first. Its
    first steps do not count.
    """

    def loss(network: Pilot, batch: Batch) -> Tensor:
        forces, estimates, _ = network.sequence(
            batch["frames"], batch["target"], batch["commanded_force"]
        )
        settled = slice(_FILTER_SETTLES, None)
        asked = batch["labelled"][:, settled]
        wanted = batch["mpc_force"][:, settled][asked]
        off = force_loss(forces[:, settled][asked], wanted, network.guidance.thrust_limit)
        lost = estimate_error(estimates[:, settled], batch["state"][:, settled], scaling)
        return off + _ESTIMATE_WEIGHT * lost.mean()

    schedule, methods = settings.end_to_end, ("sequence",)
    batches = frame_batches(flights, settings.window, None, schedule.batch, settings.seed)
    return TrainingTask(
        "end_to_end", pilot, loss, *batches, schedule, identity, threads=1, methods=methods
    )


def estimate_error(estimate: Tensor, state: Tensor, scaling: Scaling) -> Tensor:
    """Errors (..., 2) of positions and velocities (..., 6), each in its unit."""
    error = (estimate - state).unflatten(-1, (2, 3)).norm(dim=-1)
    return error / error.new_tensor(
        [_FILTER_POSITION * scaling.length, _FILTER_SPEED * scaling.speed]
    )


@torch.no_grad()
def _fixes(
    pilot: Pilot,
    flights: PackedFlights,
    part: str,
    count: int,
    off: float,
    settings: PilotSettings,
) -> tuple[Tensor, ...]:
    """Fixes (W, T, 3), their measurement noise (W, T, 1), forces (W, T, 3) and states (W, T, 6)."""
    dataset = WindowDataset(flights, part, settings.window)
    order = torch.randperm(len(dataset), generator=torch.Generator().manual_seed(settings.seed))
    rows = dataset.starts[order[:count].numpy()][:, None] + np.arange(settings.window)
    kicked = flights.kick[rows].any(axis=(1, 2))
    rows = rows[~kicked]
    if not len(rows):
        raise InputError(
            f"{flights.folder}: all windows of the {part} part have a kick of the velocity: "
            "collect flights without kicks, too"
        )
    fixes, noises = [], []
    for start in range(0, rows.size, _BLOCK):
        block = rows.ravel()[start : start + _BLOCK]
        frames = torch.from_numpy(flights.frames(block).reshape(len(block), -1))
        points, _, valid, _ = pilot.hits(frames)
        place = torch.from_numpy(flights.state[block, :3].astype(np.float32))
        place = place + off * torch.randn(
            place.shape, generator=torch.Generator().manual_seed(start)
        )
        residual = place[:, :1]
        for _ in range(2):
            place, residual = pilot.geometry(place, points, valid)
        fixes.append(place)
        noises.append(measurement_noise(residual, pilot.usual_residual))
    force = torch.from_numpy(flights.commanded_force[rows].astype(np.float32))
    state = torch.from_numpy(flights.state[rows].astype(np.float32))
    shape = rows.shape
    return torch.cat(fixes).unflatten(0, shape), torch.cat(noises).unflatten(0, shape), force, state


def _task(
    name: str,
    network: nn.Module,
    loss: Callable[..., Tensor],
    training: Sequence[Tensor],
    validation: Sequence[Tensor],
    settings: PilotSettings,
    identity: str,
    held_size: int | None = None,
    **options: Any,
) -> TrainingTask:
    """The task of a part on columns of examples; its schedule is the setting of its name.

    Args:
      held_size: of the batches of validation; None: that of the others.
    """
    schedule: Schedule = getattr(settings, name)
    batches = TensorBatches(training, schedule.batch, shuffle=True, seed=settings.seed)
    held = TensorBatches(validation, held_size or schedule.batch)
    return TrainingTask(name, network, loss, batches, held, schedule, identity, 1, **options)
