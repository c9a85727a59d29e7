"""Errors of a learned lidar against the ray caster's frames, and the report on them."""

from __future__ import annotations

import itertools
import statistics
import time
import typing
from collections.abc import Callable

import numpy as np
from scipy.spatial import KDTree

from proxops.training.lidar.frames import GridFrames, near_silhouette
from proxops.training.reports import DASH, Picture, Section, Table, Text, number_text

_NEIGHBOURS = 8
# Limits of bands of distance from the body's centre, over half of the cube's edge.
_BANDS = (0.0, 0.5, 0.75, 1.0, 1.25, 3.0**0.5)
TARGET_IOU = 0.97
TARGET_MEDIAN_M = 500.0

Frames = Callable[[np.ndarray], np.ndarray]
"""Frames (N, R) in m, +inf where nothing returns, from positions (N, 3) in m in K."""
Figures = dict[str, typing.Any]


def nearest_frames(grid: GridFrames) -> Frames:
    """Takes the frame of the nearest grid position."""
    tree = KDTree(grid.positions)
    return lambda positions: grid.frames[tree.query(positions)[1]]


def weighted_frames(grid: GridFrames) -> Frames:
    """Weights the 8 nearest grid frames by the inverse of their distance (Shepard).

    A ray returns if frames with at least half of the weight return; its range is their weighted
    mean.
    """
    tree = KDTree(grid.positions)

    def frames(positions: np.ndarray) -> np.ndarray:
        out = np.empty((len(positions), grid.frames.shape[1]), dtype=np.float32)
        for k, position in enumerate(positions):
            distances, places = tree.query(position, _NEIGHBOURS)
            weights = 1.0 / np.maximum(distances, 1e-9 * distances[-1])
            near = grid.frames[places]
            hits = np.isfinite(near)
            votes = weights @ hits
            total = weights @ np.where(hits, near, 0.0)
            with np.errstate(invalid="ignore", divide="ignore"):
                out[k] = np.where(votes >= 0.5 * weights.sum(), total / votes, np.inf)
        return out

    return frames


def frame_figures(
    truth: np.ndarray, guess: np.ndarray, chosen: np.ndarray | None = None
) -> Figures:
    """Figures of merit of frames (N, R) against the true ones, on all rays or the chosen (N, R).

    Returns:
      mask_iou: rays that return in both over rays that return in either.
      false_hits: share of the returns given that are none. missed_hits: share of the true ones
      that are not given. range_error_m: mean, median, p95 of the absolute error on true hits that
      are given. Shares of nothing are None.
    """
    real, given = np.isfinite(truth), np.isfinite(guess)
    if chosen is not None:
        real, given = real & chosen, given & chosen
    both = real & given
    errors = np.abs(truth[both].astype(np.float64) - guess[both])
    none = errors.size == 0
    return {
        "true_hits": int(real.sum()),
        "mask_iou": _share(both.sum(), (real | given).sum()),
        "false_hits": _share((given & ~real).sum(), given.sum()),
        "missed_hits": _share((real & ~given).sum(), real.sum()),
        "range_error_m": {
            "mean": None if none else float(errors.mean()),
            "median": None if none else float(np.median(errors)),
            "p95": None if none else float(np.percentile(errors, 95)),
        },
    }


def all_figures(
    positions: np.ndarray, truth: np.ndarray, guess: np.ndarray, planes: int, cube: float
) -> Figures:
    """`frame_figures` on all rays, on those near silhouettes, and by distance from the centre."""
    distances = np.linalg.norm(positions, axis=1) / (0.5 * cube)
    bands = []
    for near, far in itertools.pairwise(_BANDS):
        chosen = (distances >= near) & (distances < far)
        bands.append(
            {
                "from_m": near * 0.5 * cube,
                "to_m": far * 0.5 * cube,
                "positions": int(chosen.sum()),
                **frame_figures(truth[chosen], guess[chosen]),
            }
        )
    near = near_silhouette(truth, planes)
    return {
        "all": frame_figures(truth, guess),
        "near_silhouettes": frame_figures(truth, guess, near),
        "bands": bands,
    }


def frame_milliseconds(methods: dict[str, Frames], positions: np.ndarray) -> dict[str, float]:
    """Median time in ms of one frame by each method, measured in turns: all share what disturbs."""
    times: dict[str, list[float]] = {name: [] for name in methods}
    for position in positions:
        for name, frames in methods.items():
            started = time.perf_counter()
            frames(position[None])
            times[name].append(1e3 * (time.perf_counter() - started))
    return {name: statistics.median(values) for name, values in times.items()}


def meets_targets(figures: Figures) -> bool:
    """Whether a method's figures reach what the learned lidar is built for."""
    overall = figures["all"]
    iou, median = overall["mask_iou"], overall["range_error_m"]["median"]
    return bool(iou and median is not None and iou >= TARGET_IOU and median <= TARGET_MEDIAN_M)


def frame_sections(report: Figures, pictures: Picture) -> list[Section]:
    """The report for reading.

    Args:
      pictures: real and generated frames beside each other.
    """
    methods = report["methods"]
    introduction = _INTRODUCTION.format(
        grid=report["grid_positions"],
        spacing=report["spacing_m"] / 1e3,
        test=report["test_positions"],
    )
    lines = [
        [name, *_cells(entry["all"]), number_text(entry["frame_ms"], ".3f")]
        for name, entry in methods.items()
    ]
    lines.append(["ray-caster", *[DASH] * 6, number_text(report["ray_caster_frame_ms"], ".3f")])
    outlines = [[name, *_cells(entry["near_silhouettes"])] for name, entry in methods.items()]
    near = Text("Rays within two rays of the outline, in their plane.")
    return [
        Section("All rays", [Text(introduction), Table([*_HEAD, "ms a frame"], lines)]),
        Section("Near silhouettes", [near, Table(_HEAD, outlines)]),
        Section("By distance from the body's centre", [_bands_table(methods)]),
        Section("Training", [Text(_training_text(report)), pictures]),
    ]


def _bands_table(methods: Figures) -> Table:
    lines = [
        [
            f"{band['from_m'] / 1e3:.0f} to {band['to_m'] / 1e3:.0f}",
            str(band["positions"]),
            name,
            *_cells(band),
        ]
        for k in range(len(_BANDS) - 1)
        for name, band in ((name, entry["bands"][k]) for name, entry in methods.items())
    ]
    return Table(["km", "positions", *_HEAD], lines)


def _training_text(report: Figures) -> str:
    times = ", ".join(f"{name} {run['cpu_s']:.0f}" for name, run in report["training"].items())
    met = "met" if report["targets_met"] else "not met"
    return (
        f"In seconds of CPU time: {times}. Targets (IoU ≥ {TARGET_IOU}, median ≤ "
        f"{TARGET_MEDIAN_M / 1e3} km): {met}."
    )


_INTRODUCTION = (
    "Trained on {grid} positions, a grid of {spacing:g} km; judged on {test} random positions in "
    "the same cube outside the body, against noiseless frames of the ray-caster. False hits are a "
    "share of the returns given, missed hits of the true ones. Errors are on rays that truly "
    "return and are given a return, in km."
)
_HEAD = ["method", "mask IoU", "false hits", "missed hits", "mean error", "median", "p95"]


def _cells(figures: Figures) -> list[str]:
    errors = figures["range_error_m"]
    return [
        number_text(figures["mask_iou"], ".4f"),
        number_text(figures["false_hits"], ".2%"),
        number_text(figures["missed_hits"], ".2%"),
        *(number_text(errors[k], ".3f", 1e-3) for k in ("mean", "median", "p95")),
    ]


def _share(part: typing.Any, whole: typing.Any) -> float | None:
    return float(part) / float(whole) if whole else None
