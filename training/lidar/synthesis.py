"""Trains the learned lidar: casts the grid, trains both networks, exports them and reports."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

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
from proxops.training.lidar.bundle import Facts, write_bundle, write_frame_bundle
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
from proxops.training.loop import Schedule, Trained, TrainingTask, seeded, train
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
    made = {"spacing_m": settings.spacing, "grid_positions": len(grid.positions)}
    facts: Facts = {
        "planes": lidar.planes,
        "rays": lidar.rays,
        "cube_m": float(cube),
        "body": body.config.name,
        "shape_sha256": body.shape.sha256,
        "training": made | {"seed": settings.seed},
    }
    # One network after the other, so that only one set of examples is in memory.
    halves = (part_of(progress, 0.0, 0.5), part_of(progress, 0.5, 1.0))
    trained = {
        OURS: _train_ray_network(grid, facts, settings, out, halves[0]),
        PAPERS: _train_frame_network(grid, facts, settings, out, halves[1]),
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
        **facts,
        **made,
        "bundle_sha256": ours.bundle.sha256,
        "paper_bundle_sha256": papers.bundle.sha256,
        "settings": asdict(settings),
        "training": {name: each.figures() for name, each in trained.items()},
    }
    positions = random_positions(body, cube, settings.test_positions, settings.seed + _TEST_STREAM)
    figures, pictures = _judge(methods, fan, positions, lidar, cube)
    report |= figures
    write_json(out / "report.json", report)
    title = f"The learned lidar of {body.config.name}"
    write_markdown(out, title, frame_errors.frame_sections(report, pictures))
    return report


def _train_ray_network(
    grid: GridFrames, facts: Facts, settings: LidarSettings, out: Path, progress: Progress
) -> Trained:
    """Trains our network and writes its bundle."""
    planes = facts["planes"]
    directions = ray_directions(planes, facts["rays"])
    ellipsoid = enclosing_ellipsoid(grid.positions, grid.frames, directions)
    fan, kept = ChordFan(*ellipsoid, directions), ~grid.held_out
    examples, near = ray_examples(fan, grid.positions[kept], grid.frames[kept], planes)
    held, _ = ray_examples(fan, grid.positions[~kept], grid.frames[~kept], planes)
    with seeded(settings.seed):
        network = RayNetwork(settings.width)
    task = TrainingTask.on_tensors(
        "ray_network",
        network,
        lambda network, batch: ray_loss(network, *batch),
        (examples, held),
        settings.ray,
        settings.seed,
        _identity(facts, settings),
        often=near.nonzero()[:, 0],
        threads=1,
    )
    trained = train(task, out, settings.seed, device="cpu", progress=progress)
    checks = next(iter(task.validation))[0][:_EXPORT_CHECKS].numpy()
    write_bundle(out / "bundle", network, _told(facts, trained), ellipsoid, checks)
    return trained


def _train_frame_network(
    grid: GridFrames, facts: Facts, settings: LidarSettings, out: Path, progress: Progress
) -> Trained:
    """Trains the paper's network and writes its bundle."""
    cube, kept = facts["cube_m"], ~grid.held_out
    columns = [
        frame_examples(grid.positions[rows], grid.frames[rows], cube) for rows in (kept, ~kept)
    ]
    with seeded(settings.seed):
        network = FrameNetwork(grid.frames.shape[1])
    task = TrainingTask.on_tensors(
        "frame_network",
        network,
        lambda network, batch: frame_loss(network, *batch),
        columns,
        settings.frame,
        settings.seed,
        _identity(facts, settings),
        threads=1,
    )
    trained = train(task, out, settings.seed, device="cpu", progress=progress)
    checks, unit = grid.positions[grid.held_out][:_CHECKED_FRAMES], cube / LENGTH_UNITS_PER_CUBE
    write_frame_bundle(out / "paper_bundle", network, _told(facts, trained), unit, checks)
    return trained


def _identity(facts: Facts, settings: LidarSettings) -> str:
    """Names the examples in the identity of a training."""
    return (
        f"body {facts['shape_sha256']}, cube {facts['cube_m']}, spacing {settings.spacing}, "
        f"{facts['planes']} x {facts['rays']}"
    )


def _told(facts: Facts, trained: Trained) -> Facts:
    """The facts in a bundle, with the figures of its training."""
    return facts | {"training": facts["training"] | trained.figures()}


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


def _true_frames(lidar: LearnedLidar, positions: np.ndarray) -> np.ndarray:
    """Noiseless frames (N, R) in m of a learned lidar, position by position as in flight."""
    frames = np.full((len(positions), len(lidar.directions)), np.inf, dtype=np.float32)
    for frame, position in zip(frames, positions, strict=True):
        returns = lidar.true_returns(position)
        frame[returns.rays] = returns.distances
    return frames
