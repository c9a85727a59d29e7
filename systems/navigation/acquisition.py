"""Finds position and attitude from one frame, with the attitude known to a degree or so."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from proxops.systems.navigation._frame_kernel import FLATTEST
from proxops.systems.navigation._motion_kernel import turned
from proxops.systems.navigation.frame_model import FrameModel

# First guesses: beyond the mean of the returns by these shares of the body's length.
_BEYOND = (0.15, 0.3, 0.45)
_MEAN_STEPS, _FIT_STEPS = 12, 12
# If they fail, as they may close to the body: so many places in a ball of this radius over the
# body's length, then so many around each of the best, of which again the best are tried.
_WIDE, _CLOSE = (300, 0.45), (60, 0.07)
_BEST = 8
# Rays that these places are judged by, and the error, over the body's length, that counts as one.
_SAMPLE, _FAR = 300, 0.05
# Fewer returns than this say too little.
_FEWEST = 6
# Of the rays that are predicted to meet the body, at least this share must return.
_RETURNING = 0.5
# The greatest misfit that is believed, and what it grows by with the map's error over the size.
_MISFIT, _MISFIT_OF_MAP = 0.02, 10.0
# It also grows by this times the share of rays with a false return, up to a limit: some of them lie
# close to the body.
_MISFIT_OF_FALSE, _MOST_OF_FALSE = 0.75, 0.15


class Acquired(NamedTuple):
    """A pose that explains a frame."""

    position: np.ndarray
    """(3,) in m in K."""
    rotation: np.ndarray
    """R_KS (3, 3)."""
    misfit: float
    """Share of the rays of the measured and of the predicted body that disagree."""


def acquire(
    model: FrameModel,
    ranges: np.ndarray,
    attitude: np.ndarray,
    attitude_std: float,
    thorough: bool = False,
) -> Acquired | None:
    """Finds the pose from a frame (planes * rays,) in m, +inf for no return.

    Args:
      model: predicts frames.
      ranges: the frame.
      attitude: R_KS (3, 3) as known. attitude_std: its standard deviation in rad.
      thorough: starts from many places at once, not from the mean of the returns.

    Returns:
      The pose, or None if none explains the frame.
    """
    rays = _neighbourly(model, ranges)
    if rays.size < _FEWEST:
        return None
    measured = ranges[rays]
    cloud = measured[:, None] * (model.directions[rays] @ attitude.T)
    mean = cloud.mean(axis=0)
    size = model.shape.extents.max()
    false = np.count_nonzero(ranges < np.inf) - rays.size
    allowed = _MISFIT + _MISFIT_OF_MAP * model.map_error.std / size
    allowed += min(_MISFIT_OF_FALSE * false / (ranges.size - rays.size + 1), _MOST_OF_FALSE)

    def tried(starts: list[np.ndarray]) -> Acquired | None:
        poses = (_fitted(model, p, attitude, attitude_std, rays, measured) for p in starts)
        found = [_judged(model, *pose, ranges, rays) for pose in poses]
        best = min(found, key=lambda each: each.misfit)
        return best if best.misfit < allowed else None

    outwards = -mean / np.linalg.norm(mean)
    found = None
    if not thorough:
        guesses = [-mean + share * size * outwards for share in _BEYOND]
        found = tried([_with_mean(model, guess, attitude, mean) for guess in guesses])
    middle = -mean + 0.15 * size * outwards
    return found or tried(_likely_places(model, middle, attitude, ranges, rays))


def _neighbourly(model: FrameModel, ranges: np.ndarray) -> np.ndarray:
    """Rays that have a neighbour in their plane with a like range: a false return rarely has."""
    geometry = model.geometry
    frame = ranges.reshape(geometry.planes, geometry.rays)
    alike = np.zeros(frame.shape, dtype=int)
    near = 0.1 * model.shape.extents.max()
    with np.errstate(invalid="ignore"):
        for shift in (1, 2):
            close = np.abs(frame - np.roll(frame, shift, axis=1)) < near
            alike += close
            alike += np.roll(close, -shift, axis=1)
    kept = np.flatnonzero((alike >= 2) & (frame < np.inf))
    if kept.size >= _FEWEST:
        return kept
    return np.flatnonzero(ranges < np.inf)


def _with_mean(
    model: FrameModel, position: np.ndarray, rotation: np.ndarray, mean: np.ndarray
) -> np.ndarray:
    """The position moved until the predicted returns have the mean (3,) of the measured ones."""
    for _ in range(_MEAN_STEPS):
        _, rays, distances, _ = model.fan.hits(position[None], rotation)
        if not rays.size:
            break
        directions = model.directions[rays] @ rotation.T
        step = (distances[:, None] * directions).mean(axis=0) - mean
        position = position + step
        if step @ step < (0.003 * model.shape.extents.max()) ** 2:
            break
    return position


def _fitted(
    model: FrameModel,
    position: np.ndarray,
    rotation: np.ndarray,
    attitude_std: float,
    rays: np.ndarray,
    measured: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Robust Gauss-Newton steps of position and attitude; the attitude has a prior."""
    turn = np.zeros(3)
    for _ in range(_FIT_STEPS):
        directions = model.directions[rays] @ rotation.T
        distances, facets, _ = model.first_hits(position, directions)
        met = np.flatnonzero(facets >= 0)
        if met.size < _FEWEST:
            break
        directions, r = directions[met], distances[met]
        normals = model.normals[facets[met]]
        q = -np.einsum("ki,ki->k", normals, directions)
        usable = q >= FLATTEST
        directions, normals, r, q = directions[usable], normals[usable], r[usable], q[usable]
        e = q * (measured[met][usable] - r)
        if e.size < _FEWEST:
            break
        scale = max(3.0 * model.noise_std, 1.5 * float(np.median(np.abs(e))), 1e-9)
        weights = 1.0 / (1.0 + (e / scale) ** 2)
        rows = np.hstack([normals, r[:, None] * np.cross(directions, normals)])
        spread = max(model.noise_std, 0.5 * scale / 3.0)
        system = (rows * weights[:, None]).T @ rows / spread**2
        system[3:, 3:] += np.eye(3) / attitude_std**2
        system[:3, :3] += np.eye(3) * 1e-12 * np.trace(system[:3, :3])
        pull = (weights * e) @ rows / spread**2
        pull[3:] -= turn / attitude_std**2
        step = np.linalg.solve(system, pull)
        size = np.linalg.norm(step[3:])
        if size > 3.0 * attitude_std:
            step[3:] *= 3.0 * attitude_std / size
        position = position + step[:3]
        turn = turn + step[3:]
        rotation = turned(rotation, step[3:])
        if np.linalg.norm(step[:3]) < 0.02 * spread and size * r.mean() < 0.02 * spread:
            break
    return position, rotation


def _likely_places(
    model: FrameModel,
    middle: np.ndarray,
    rotation: np.ndarray,
    ranges: np.ndarray,
    rays: np.ndarray,
) -> list[np.ndarray]:
    """The places around `middle` (3,) from which the body looks most like the frame."""
    size = model.shape.extents.max()
    blank = np.setdiff1d(np.flatnonzero(np.isinf(ranges)), rays)
    sample = np.concatenate([_thinned(rays, _SAMPLE // 2), _thinned(blank, _SAMPLE // 2)])
    directions, measured = model.directions[sample] @ rotation.T, ranges[sample]

    def unlikeness(point: np.ndarray) -> float:
        distances, facets, _ = model.first_hits(point, directions)
        met = (facets >= 0) & (distances < model.geometry.max_range)
        with np.errstate(invalid="ignore"):
            off = np.minimum(np.abs(distances - measured) / (_FAR * size), 1.0)
        off[~met] = measured[~met] < np.inf
        return float(off.mean())

    def likeliest(points: np.ndarray) -> np.ndarray:
        order = np.argsort([unlikeness(point) for point in points], kind="stable")
        return points[order[:_BEST]]

    (count, radius), (more, close) = _WIDE, _CLOSE
    places = likeliest(middle + radius * size * _ball(count))
    around = (places[:, None] + close * size * _ball(more)).reshape(-1, 3)
    return list(likeliest(around))


def _ball(count: int) -> np.ndarray:
    """Points (count, 3), spread evenly in the unit ball."""
    from scipy.stats import qmc  # It is slow to import, so only when it is needed.

    cube = qmc.Halton(3, scramble=False).random(2 * count + 30)[1:]
    points = 2.0 * cube - 1.0
    return points[np.linalg.norm(points, axis=1) <= 1.0][:count]


def _thinned(indices: np.ndarray, count: int) -> np.ndarray:
    return indices[:: max(1, indices.size // count)]


def _judged(
    model: FrameModel,
    position: np.ndarray,
    rotation: np.ndarray,
    ranges: np.ndarray,
    rays: np.ndarray,
) -> Acquired:
    """The pose, with how well it explains the frame and the rays that see the measured body."""
    _, hit, distances, _ = model.fan.hits(position[None], rotation)
    predicted = np.full(ranges.size, np.inf)
    predicted[hit] = distances
    predicted[predicted > model.geometry.max_range] = np.inf
    tolerance = 6.0 * model.noise_std + 6.0 * model.map_error.std
    tolerance += 0.01 * model.shape.extents.max()
    with np.errstate(invalid="ignore"):
        disagree = np.count_nonzero(~(np.abs(ranges[rays] - predicted[rays]) < tolerance))
    # A return may be lost, but hardly three rays beside one another.
    geometry = model.geometry
    frame = ranges.reshape(geometry.planes, geometry.rays)
    lost = np.isinf(frame) & np.isinf(np.roll(frame, 1, axis=1)) & np.isinf(np.roll(frame, -1, 1))
    expected = predicted < np.inf
    blank = np.count_nonzero(expected & lost.ravel())
    if np.count_nonzero(expected & (ranges < np.inf)) < _RETURNING * np.count_nonzero(expected):
        return Acquired(position, rotation, 1.0)
    return Acquired(position, rotation, (disagree + blank) / (rays.size + blank))
