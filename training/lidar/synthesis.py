"""Trains the learned lidar: casts the grid, trains both networks, exports them and reports."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch

from proxops.diagrams.scenario import Body, LidarConfig, Scenario
from proxops.systems.common import (
    InputError,
    Progress,
    make_folder,
    part_of,
    silent,
    write_json,
)
from proxops.systems.lidar import (
    ChordFan,
    LearnedLidar,
    LidarErrors,
    LidarGeometry,
    ray_directions,
)
from proxops.systems.shapes import RayFan, ray_caster
from proxops.training.lidar import frame_errors
from proxops.training.lidar.bundle import BundleFacts, write_bundle, write_frame_bundle
from proxops.training.lidar.frames import (
    LENGTH_UNITS_PER_CUBE,
    GridFrames,
    cast_grid,
    enclosing_ellipsoid,
    frame_examples,
    random_positions,
    ray_examples,
)
from proxops.training.lidar.networks import FrameNetwork, RayNetwork, frame_loss, ray_loss
from proxops.training.loop import Schedule, TensorBatches, Trained, TrainingTask, seeded, train
from proxops.training.reports import Picture, picture, plot_frames, write_markdown

_RAY_SCHEDULE = Schedule(epochs=24, batch=8192, learning_rate=4e-3, patience=8)
_FRAME_SCHEDULE = Schedule(epochs=60, batch=64, learning_rate=1e-3, patience=15)
# Added to the seed for the test positions, so that no other numbers come from the same seed.
_TEST_STREAM = 1_000_003
OURS, PAPERS = "ray network (ours)", "frame network (paper)"
_TIMED_FRAMES = 200
_PICTURES = 4
# Chords, and frames, on which an exported network is compared with the trained one.
_EXPORT_CHECKS = 4096
_CHECKED_FRAMES = 32


@dataclass(frozen=True)
class LidarSettings:
    """Settings of the training of both networks, and of the test."""

    spacing: float = 20e3
    """Spacing of the grid in m."""
    seed: int = 0
    width: int = 128
    """Width of the ray network's layers."""
    ray: Schedule = _RAY_SCHEDULE
    frame: Schedule = _FRAME_SCHEDULE
    test_positions: int = 1000

    def quick(self) -> LidarSettings:
        """Settings for a first try in seconds: a coarse grid and few steps."""
        return replace(
            self,
            spacing=2.0 * self.spacing,
            width=64,
            ray=replace(self.ray, epochs=4, batch=2048),
            frame=replace(self.frame, epochs=4),
            test_positions=100,
        )


def train_lidar(
    scenario: Scenario,
    body: Body,
    settings: LidarSettings,
    out: Path,
    progress: Progress = silent,
) -> dict[str, Any]:
    """Trains both networks, exports them and compares them with the ray caster.

    Writes bundle/ (our ray network), paper_bundle/ (the paper's frame network), report.json,
    report.md, frames.png and curves/ to `out`. After a kill it continues with the network and the
    epoch where it was.

    Returns:
      The content of `report.json`.

    Raises:
      InputError: the scenario's lidar is a learned one, the grid has too few positions, or `out`
        holds another training.
    """
    lidar = scenario.lidar
    if not isinstance(lidar, LidarConfig):
        raise InputError("train-lidar learns from the ray-cast lidar: give a scenario with that")
    make_folder(out)
    cube = scenario.transit.cube_m
    fan = ray_caster(body.shape).fan(ray_directions(lidar.planes, lidar.rays))
    grid = cast_grid(body, fan, cube, settings.spacing, settings.seed)
    examples = _Examples(body, lidar, cube, grid, settings)
    # One network after the other, so that only one set of examples is in memory.
    trained = {
        OURS: _train_ray_network(examples, out, part_of(progress, 0.0, 0.5)),
        PAPERS: _train_frame_network(examples, out, part_of(progress, 0.5, 1.0)),
    }

    geometry = LidarGeometry(lidar.planes, lidar.rays, np.inf)
    ours, papers = (
        LearnedLidar(out / name, LidarErrors(noise_std=0.0), geometry)
        for name in ("bundle", "paper_bundle")
    )
    methods = {
        OURS: lambda positions: _true_frames(ours, positions),
        PAPERS: lambda positions: _true_frames(papers, positions),
        "nearest grid frame": frame_errors.nearest_frames(grid),
        "inverse distance, 8 frames": frame_errors.weighted_frames(grid),
    }
    report = {
        "body": body.config.name,
        "shape_sha256": body.shape.sha256,
        "bundle_sha256": ours.bundle.sha256,
        "paper_bundle_sha256": papers.bundle.sha256,
        "cube_m": cube,
        "planes": lidar.planes,
        "rays": lidar.rays,
        "spacing_m": settings.spacing,
        "grid_positions": len(grid.positions),
        "settings": asdict(settings),
        "training": {name: _training_figures(each) for name, each in trained.items()},
    }
    positions = random_positions(body, cube, settings.test_positions, settings.seed + _TEST_STREAM)
    figures, pictures = _judge(methods, fan, positions, lidar, cube)
    report |= figures
    write_json(out / "report.json", report)
    title = f"The learned lidar of {body.config.name}"
    write_markdown(out, title, frame_errors.frame_sections(report, pictures))
    return report


@dataclass(frozen=True)
class _Examples:
    """The examples and settings that both networks share."""

    body: Body
    lidar: LidarConfig
    cube: float
    grid: GridFrames
    settings: LidarSettings

    @property
    def identity(self) -> str:
        """Names the examples in the identity of a training."""
        return (
            f"body {self.body.shape.sha256}, cube {self.cube}, spacing {self.settings.spacing}, "
            f"{self.lidar.planes} x {self.lidar.rays}"
        )

    def facts(self, trained: Trained) -> BundleFacts:
        """The facts in a bundle of this training."""
        return BundleFacts(
            planes=self.lidar.planes,
            rays=self.lidar.rays,
            cube=self.cube,
            body=self.body.config.name,
            shape_sha256=self.body.shape.sha256,
            training={
                "spacing_m": self.settings.spacing,
                "grid_positions": len(self.grid.positions),
                "seed": self.settings.seed,
                **_training_figures(trained),
            },
        )


def _train_ray_network(examples: _Examples, out: Path, progress: Progress) -> Trained:
    """Trains our network and writes its bundle."""
    grid, lidar, settings = examples.grid, examples.lidar, examples.settings
    directions = ray_directions(lidar.planes, lidar.rays)
    ellipsoid = enclosing_ellipsoid(grid.positions, grid.frames, directions)
    chords = ChordFan(*ellipsoid, directions)
    task = _ray_task(chords, grid, lidar.planes, settings, examples.identity)
    trained = train(task, out, settings.seed, device="cpu", progress=progress)
    checks = next(iter(task.validation))[0][:_EXPORT_CHECKS].numpy()
    write_bundle(out / "bundle", task.network, examples.facts(trained), ellipsoid, checks)
    return trained


def _train_frame_network(examples: _Examples, out: Path, progress: Progress) -> Trained:
    """Trains the paper's network and writes its bundle."""
    grid, cube, settings = examples.grid, examples.cube, examples.settings
    task = _frame_task(grid, cube, settings, examples.identity)
    trained = train(task, out, settings.seed, device="cpu", progress=progress)
    checks = grid.positions[grid.held_out][:_CHECKED_FRAMES]
    unit = cube / LENGTH_UNITS_PER_CUBE
    write_frame_bundle(out / "paper_bundle", task.network, examples.facts(trained), unit, checks)
    return trained


def _judge(
    methods: dict[str, frame_errors.Frames],
    fan: RayFan,
    positions: np.ndarray,
    lidar: LidarConfig,
    cube: float,
) -> tuple[dict[str, Any], Picture]:
    """Errors of the methods at the test positions (N, 3), and pictures of some frames."""
    truth = fan.frames(positions)
    guesses = {name: frames(positions) for name, frames in methods.items()}
    times = frame_errors.frame_milliseconds(
        {**methods, "ray-caster": fan.frames}, positions[:_TIMED_FRAMES]
    )
    sources = {"ray-caster": truth, **{name: guesses[name] for name in (OURS, PAPERS)}}
    figure = plot_frames(
        positions[:_PICTURES],
        {name: frames[:_PICTURES] for name, frames in sources.items()},
        lidar.planes,
    )
    caption = "Frames of the ray-caster and of the two networks, from the same positions."
    figures = {
        name: frame_errors.all_figures(positions, truth, guess, lidar.planes, cube)
        | {"frame_ms": times[name]}
        for name, guess in guesses.items()
    }
    results = {
        "test_positions": len(positions),
        "targets": {
            "mask_iou": frame_errors.TARGET_IOU, "median_m": frame_errors.TARGET_MEDIAN_M
        },
        "targets_met": frame_errors.meets_targets(figures[OURS]),
        "ray_caster_frame_ms": times["ray-caster"],
        "methods": figures,
    }  # fmt: skip
    return results, picture("frames", figure, caption)


def _ray_task(
    fan: ChordFan, grid: GridFrames, planes: int, settings: LidarSettings, identity: str
) -> TrainingTask:
    with seeded(settings.seed):
        network = RayNetwork(settings.width)
    kept = ~grid.held_out
    examples, near = ray_examples(fan, grid.positions[kept], grid.frames[kept], planes)
    validation, _ = ray_examples(fan, grid.positions[~kept], grid.frames[~kept], planes)
    often = near.nonzero()[:, 0]
    return _task(
        "ray_network", network, ray_loss, examples, validation, settings.ray, settings.seed,
        identity, often,
    )  # fmt: skip


def _frame_task(
    grid: GridFrames, cube: float, settings: LidarSettings, identity: str
) -> TrainingTask:
    with seeded(settings.seed):
        network = FrameNetwork(grid.frames.shape[1])
    kept = ~grid.held_out
    examples = frame_examples(grid.positions[kept], grid.frames[kept], cube)
    validation = frame_examples(grid.positions[~kept], grid.frames[~kept], cube)
    return _task(
        "frame_network", network, frame_loss, examples, validation, settings.frame, settings.seed,
        identity,
    )  # fmt: skip


def _task(
    name: str,
    network: torch.nn.Module,
    loss: Callable[..., torch.Tensor],
    examples: tuple[torch.Tensor, ...],
    validation: tuple[torch.Tensor, ...],
    schedule: Schedule,
    seed: int,
    identity: str,
    often: torch.Tensor | None = None,
) -> TrainingTask:
    return TrainingTask(
        name,
        network,
        lambda network, batch: loss(network, *batch),
        TensorBatches(examples, schedule.batch, shuffle=True, seed=seed, often=often),
        TensorBatches(validation, schedule.batch),
        schedule,
        identity,
        threads=1,
    )


def _true_frames(lidar: LearnedLidar, positions: np.ndarray) -> np.ndarray:
    """Noiseless frames (N, R) in m of a learned lidar, position by position as in flight."""
    frames = np.full((len(positions), len(lidar.directions)), np.inf, dtype=np.float32)
    for frame, position in zip(frames, positions, strict=True):
        returns = lidar.true_returns(position)
        frame[returns.rays] = returns.distances
    return frames


def _training_figures(trained: Trained) -> dict[str, float]:
    best = trained.history[trained.best_epoch]
    return {
        "epochs": len(trained.history),
        "best_epoch": trained.best_epoch,
        "best_validation_loss": best["validation_loss"],
        "cpu_s": trained.cpu_s,
    }
