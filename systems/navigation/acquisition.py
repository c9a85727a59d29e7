"""Finds position and attitude from one frame, with the attitude known to a degree or so."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from proxops.systems.common import Matrix3, Vector3
from proxops.systems.navigation._motion_kernel import turned
from proxops.systems.navigation.correction import ENOUGH, GATE
from proxops.systems.navigation.frame_model import FrameModel
from proxops.systems.navigation.likely_poses import Sight, thinned

# First guesses from afar: beyond the mean of the returns by these shares of the body's length.
_BEYOND = (0.15, 0.3, 0.45)
# A search does not use rays that meet the surface at a flatter angle (cosine of the incidence):
# its places are too far off.
_FLATTEST = 0.15
_MEAN_STEPS, _FIT_STEPS = 12, 12
# A nearest return below this share of the length is close to the body.
_NEAR = 0.25
# Fewer returns than this say too little.
FEWEST = 6
# An attitude that is known exactly is taken to be known to this (rad).
_LEAST_ATTITUDE_STD = 1e-9
# Of the rays that are predicted to meet the body, at least this share must return.
_RETURNING = 0.5
# The greatest misfit that is believed, and what it grows by with the map's error over the size.
_MISFIT, _MISFIT_OF_MAP = 0.02, 10.0
# It also grows by this times the share of rays with a false return, up to a limit: some of them lie
# close to the body.
_MISFIT_OF_FALSE, _MOST_OF_FALSE = 0.75, 0.15


class Acquired(NamedTuple):
    """A pose that explains a frame."""

    position: Vector3
    """(3,) in m in K."""
    rotation: Matrix3
    """R_KS (3, 3)."""
    misfit: float
    """Share of the rays of the measured and of the predicted body that disagree by far."""
    cost: float
    """Mean square of the residuals, each divided by the greatest that noise explains and at most 1.
    A ray that should return, and is blank as are its neighbours, counts 1."""


def acquire(
    model: FrameModel,
    ranges: np.ndarray,
    attitude: Matrix3,
    attitude_std: float,
    search: int = 0,
) -> Acquired | None:
    """Finds the pose from a frame (planes * rays,) in m, +inf for no return.

    Args:
      model: predicts frames.
      ranges: the frame.
      attitude: R_KS (3, 3) as known. attitude_std: its standard deviation in rad.
      search: 0 ends with the first place that explains the frame. The thorough searches 1, 2, ...
        look on, each at other places, for the one that explains it best.

    Returns:
      The pose, or None if none explains the frame.
    """
    rays = _neighbourly(model, ranges)
    if rays.size < FEWEST:
        return None
    measured = ranges[rays]
    cloud = measured[:, None] * (model.directions[rays] @ attitude.T)
    mean = cloud.mean(axis=0)
    size = model.shape.extents.max()
    allowed = _MISFIT + _MISFIT_OF_MAP * model.map_error.std / size
    allowed += _false_on_body(ranges, rays)

    fitted = thinned(rays, ENOUGH)

    def tried(starts: Sequence[tuple[np.ndarray, np.ndarray]]) -> Acquired | None:
        poses = (_fitted(model, *start, attitude_std, fitted, ranges[fitted]) for start in starts)
        found = [_judged(model, *pose, ranges, rays) for pose in poses]
        believed = [each for each in found if each.misfit < allowed]
        return min(believed, key=lambda each: each.cost, default=None)

    sight = Sight(model, attitude, attitude_std, ranges, rays, search)
    outwards = -mean / np.linalg.norm(mean)

    def afar() -> Acquired | None:
        guesses = [-mean + share * size * outwards for share in _BEYOND]
        return tried([(_with_mean(model, one, attitude, mean), attitude) for one in guesses])

    def above() -> Acquired | None:
        return tried(sight.above_the_nearest())

    def around() -> Acquired | None:
        return tried(sight.anywhere(-mean + 0.15 * size * outwards))

    found: list[Acquired] = []
    ways = (above, afar, around) if sight.distance < _NEAR * size else (afar, around)
    for way in ways:
        one = way()
        found += [] if one is None else [one]
        if found and not search:
            break
    return min(found, key=lambda each: each.cost, default=None)


def outlier_share(
    model: FrameModel, position: Vector3, rotation: Matrix3, ranges: np.ndarray
) -> float:
    """Share of the rays that see the body, or should, which no noise or false return explains.

    Args:
      model: predicts frames.
      position: (3,) in m in K. rotation: R_KS (3, 3).
      ranges: the frame (planes * rays,) in m, +inf for no return.
    """
    rays = _neighbourly(model, ranges)
    misfit = _judged(model, position, rotation, ranges, rays).misfit
    return max(0.0, misfit - _false_on_body(ranges, rays))


def _false_on_body(ranges: np.ndarray, rays: np.ndarray) -> float:
    """The greatest share of the rays (K,) taken for the body's that are false returns."""
    false = np.count_nonzero(ranges < np.inf) - rays.size
    return min(_MISFIT_OF_FALSE * false / (ranges.size - rays.size + 1), _MOST_OF_FALSE)


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
    if kept.size >= FEWEST:
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
    turn, attitude_std = np.zeros(3), max(attitude_std, _LEAST_ATTITUDE_STD)
    for _ in range(_FIT_STEPS):
        directions = model.directions[rays] @ rotation.T
        distances, facets, _ = model.first_hits(position, directions)
        met = np.flatnonzero(facets >= 0)
        if met.size < FEWEST:
            break
        directions, r = directions[met], distances[met]
        normals = model.normals[facets[met]]
        q = -np.einsum("ki,ki->k", normals, directions)
        usable = q >= _FLATTEST
        directions, normals, r, q = directions[usable], normals[usable], r[usable], q[usable]
        e = q * (measured[met][usable] - r)
        if e.size < FEWEST:
            break
        scale = max(3.0 * model.noise_std, 1.5 * float(np.median(np.abs(e))), 1e-9)
        weights = 1.0 / (1.0 + (e / scale) ** 2)
        rows = np.hstack([normals, r[:, None] * np.cross(directions, normals)])
        spread = max(model.noise_std, 0.5 * scale / 3.0)
        information = (rows * weights[:, None]).T @ rows / spread**2
        information[3:, 3:] += np.eye(3) / attitude_std**2
        information[:3, :3] += np.eye(3) * 1e-12 * np.trace(information[:3, :3])
        vector = (weights * e) @ rows / spread**2
        vector[3:] -= turn / attitude_std**2
        step = np.linalg.solve(information, vector)
        size = np.linalg.norm(step[3:])
        if size > 3.0 * attitude_std:
            step[3:] *= 3.0 * attitude_std / size
        position = position + step[:3]
        turn = turn + step[3:]
        rotation = turned(rotation, step[3:])
        if np.linalg.norm(step[:3]) < 0.02 * spread and size * r.mean() < 0.02 * spread:
            break
    return position, rotation


def _judged(
    model: FrameModel,
    position: np.ndarray,
    rotation: np.ndarray,
    ranges: np.ndarray,
    rays: np.ndarray,
) -> Acquired:
    """The pose, with how well it explains the frame and the rays that see the measured body."""
    _, hit, distances, facets = model.fan.hits(position[None], rotation)
    predicted, cosine = np.full(ranges.size, np.inf), np.ones(ranges.size)
    predicted[hit] = distances
    cosine[hit] = np.abs(
        np.einsum("ki,ki->k", model.normals[facets], model.directions[hit] @ rotation.T)
    )
    predicted[predicted > model.geometry.max_range] = np.inf
    tolerance = 6.0 * model.noise_std + 6.0 * model.map_error.std
    tolerance += 0.01 * model.shape.extents.max()
    with np.errstate(invalid="ignore"):
        off = np.abs(ranges[rays] - predicted[rays])
        off[np.isnan(off)] = np.inf
    disagree = np.count_nonzero(~(off < tolerance))
    greatest = GATE * np.hypot(model.noise_std, model.map_error.std)
    squares = np.minimum(cosine[rays] * off / greatest, 1.0) ** 2
    # A return may be lost, but hardly three rays beside one another.
    geometry = model.geometry
    frame = ranges.reshape(geometry.planes, geometry.rays)
    lost = np.isinf(frame) & np.isinf(np.roll(frame, 1, axis=1)) & np.isinf(np.roll(frame, -1, 1))
    expected = predicted < np.inf
    blank = np.count_nonzero(expected & lost.ravel())
    seen = rays.size + blank
    cost = float(squares.sum() + blank) / seen
    if np.count_nonzero(expected & (ranges < np.inf)) < _RETURNING * np.count_nonzero(expected):
        return Acquired(position, rotation, 1.0, cost)
    return Acquired(position, rotation, (disagree + blank) / seen, cost)
