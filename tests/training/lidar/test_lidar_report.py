"""Figures of merit of synthetic frames, on frames small enough to count by hand."""

import numpy as np
import pytest

from proxops.training.lidar.frame_errors import (
    all_figures,
    frame_figures,
    meets_targets,
    nearest_frames,
    weighted_frames,
)
from proxops.training.lidar.frames import GridFrames, near_silhouette

INF = np.inf


def grid(*rows: tuple[float, list[float]]) -> GridFrames:
    """Frames at positions along x; farther ones, that never count, make eight neighbours."""
    far = [(1e4 + k, [INF] * len(rows[0][1])) for k in range(8)]
    positions = np.array([[x, 0.0, 0.0] for x, _ in [*rows, *far]])
    frames = np.array([ranges for _, ranges in [*rows, *far]], dtype=np.float32)
    return GridFrames(positions, frames, np.zeros(len(positions), dtype=bool))


def at(x: float) -> np.ndarray:
    return np.array([[x, 0.0, 0.0]])


def test_figures_counted_by_hand():
    truth = np.array([[100.0, 200.0, 300.0, INF, INF, INF, 50.0]])
    guess = np.array([[110.0, 180.0, INF, 7.0, INF, INF, 51.0]])
    figures = frame_figures(truth, guess)
    assert figures["true_hits"] == 4
    assert figures["mask_iou"] == pytest.approx(3 / 5)
    assert figures["false_hits"] == pytest.approx(1 / 4)
    assert figures["missed_hits"] == pytest.approx(1 / 4)
    assert figures["range_error_m"]["median"] == pytest.approx(10.0)
    assert figures["range_error_m"]["mean"] == pytest.approx(31.0 / 3.0)
    assert figures["range_error_m"]["p95"] == pytest.approx(19.0)
    some = frame_figures(truth, guess, np.array([[True, False, False, False, True, False, False]]))
    assert (some["mask_iou"], some["range_error_m"]["median"]) == (1.0, pytest.approx(10.0))


@pytest.mark.parametrize(
    ("iou", "median", "met"), [(0.97, 500.0, True), (0.9699, 100.0, False), (0.99, 501.0, False)]
)
def test_targets(iou: float, median: float, met: bool):
    assert meets_targets({"all": {"mask_iou": iou, "range_error_m": {"median": median}}}) is met


def test_bands_hold_every_position_once():
    positions = np.array([[1.0, 0, 0], [0, 60.0, 0], [0, 0, 80.0], [80.0, 80, 0], [99.0, 99, 99]])
    frames = np.arange(1.0, 31.0).reshape(5, 6)
    figures = all_figures(positions, frames, frames, planes=2, cube=200.0)
    assert [band["positions"] for band in figures["bands"]] == [1, 1, 1, 1, 1]
    assert figures["all"]["mask_iou"] == 1.0
    assert figures["bands"][0]["to_m"] == figures["bands"][1]["from_m"] == 50.0


def test_silhouette_is_two_rays_wide_and_stays_in_its_plane():
    frame = np.full((1, 2, 10), INF)
    frame[0, 0, 4:] = 1.0  # The plane is a circle: rays 0 and 9 are neighbours.
    near = near_silhouette(frame.reshape(1, 20), 2).reshape(2, 10)
    assert np.flatnonzero(near[0]).tolist() == [0, 1, 2, 3, 4, 5, 8, 9]
    assert not near[1].any()


def test_nearest_frame():
    frames = nearest_frames(grid((0.0, [1.0, INF]), (10.0, [3.0, 4.0])))
    assert frames(at(4.0)).tolist() == [[1.0, INF]]
    assert frames(at(6.0)).tolist() == [[3.0, 4.0]]


def test_inverse_distance_weighting():
    frames = weighted_frames(grid((0.0, [10.0, INF, 5.0]), (4.0, [30.0, 20.0, INF])))
    # At 1 the weights are 1 and 1/3: range (10 + 30/3) / (4/3); only ray 2 has the votes of 0.
    assert frames(at(1.0))[0] == pytest.approx([15.0, INF, 5.0], rel=1e-6)
    assert frames(at(3.0))[0] == pytest.approx([25.0, 20.0, INF], rel=1e-6)
    assert frames(at(0.0))[0] == pytest.approx([10.0, INF, 5.0], rel=1e-4)
