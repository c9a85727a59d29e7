"""The start of the batch estimator: one orbit, fitted to where the body's middle is seen."""

from __future__ import annotations

import dataclasses as dc
import itertools

import numpy as np
import scipy.linalg
from scipy.spatial.distance import cdist

from proxops.systems.common import InputError, Matrix3, Values, Vector3, Vectors3, one_thread
from proxops.systems.mapping.path import Path
from proxops.systems.mapping.returns import Returns
from proxops.systems.mapping.survey_fit import GRAVITY, Expected, Survey, add_motion

# Returns that are farther from the densest place than this, over the longest semi-axis, are false.
_REACH = 2.2
FEWEST = 5
"""The least number of returns that show where the middle is."""
# Behind the mean of a ball's returns lies its centre, by this share of the radius.
_BEHIND = 2.0 / 3.0
# A body is off its ellipsoid by this share of the longest semi-axis. The mean of its returns shows
# the middle to the second share. All returns of a frame say as much as so many independent ones.
_RELIEF, _ROUGH, _ALIKE = 0.15, 0.1, 10.0
_FITS = 4
# Standard deviation of a middle, over the longest semi-axis.
_SPREAD = 0.2
_ITERATIONS = 6
# How much smoothness counts at the start, over what one middle counts.
_STIFF = 100.0


def densest(rays: Vectors3, longest: float) -> Values:
    """Which places (K,), bool, are of one body: those about the one with the most neighbours.

    A survey is never nearer to the surface than the longest semi-axis: what seems so is false.

    Args:
      rays: (K, 3) in m from the spacecraft. longest: semi-axis of the body in m.
    """
    near = np.linalg.norm(rays, axis=1) < longest
    if near.any():
        kept = np.zeros(len(rays), dtype=bool)
        if not near.all():
            kept[~near] = densest(rays[~near], longest)
        return kept
    gaps = cdist(rays, rays)
    neighbours = (gaps < 0.5 * longest).sum(axis=1)
    best = int(neighbours.argmax())
    if neighbours[best] < FEWEST:
        return np.zeros(len(rays), dtype=bool)
    return gaps[best] < _REACH * longest


def of_body(returns: Returns, longest: float) -> Values:
    """Which returns (K,), bool, are of the body, not false: see `densest`."""
    rays, kept = returns.rays, np.zeros(len(returns.frames), dtype=bool)
    bounds = np.searchsorted(returns.frames, np.arange(len(returns.times) + 1))
    for start, end in itertools.pairwise(bounds):
        if end - start >= FEWEST:
            kept[start:end] = densest(rays[start:end], longest)
    return kept


def middle_of(rays: Vectors3, semi_axes: Vector3, attitude: Matrix3) -> Vector3:
    """The spacecraft's place (3,) in m from the middle of the body that a frame shows.

    The ellipsoid is laid upon the returns. Its start has their mean where that of an ellipsoid from
    afar is: an ellipsoid is a ball in another scale.

    Args:
      rays: (K, 3) in m in N, of the body. semi_axes: (3,) in m of the ellipsoid that is known.
      attitude: R_NB (3, 3) as it is believed.
    """
    mean, longest = rays.mean(axis=0), float(np.max(semi_axes))
    ahead = mean / np.linalg.norm(mean)
    start = -(mean + _BEHIND / np.linalg.norm((attitude.T @ ahead) / semi_axes) * ahead)
    place, relief, rough = start, _RELIEF * longest, (_ROUGH * longest) ** -2.0
    for _ in range(_FITS):
        inside = (place + rays) @ attitude / semi_axes
        levels = np.linalg.norm(inside, axis=1)
        slopes = inside / semi_axes / levels[:, None]
        steep = np.linalg.norm(slopes, axis=1)
        heights = (levels - 1.0) / steep
        normals = (slopes / steep[:, None]) @ attitude.T
        weights = _ALIKE / len(rays) / (relief**2 + heights**2)
        matrix = (normals * weights[:, None]).T @ normals + rough * np.eye(3)
        place = place - np.linalg.solve(
            matrix, normals.T @ (weights * heights) + rough * (place - start)
        )
    return place


def unseen(directions: Vectors3, middle: Vector3, longest: float) -> Matrix3:
    """How far a frame's middle may be off where no rays pass: a covariance (3, 3) in m^2.

    Rays that fill the disc of a body's radius R spread by R / 2 about its centre in any direction
    across the line of sight. Where they spread less, as those of a single plane do, the middle may
    be anywhere within R.

    Args:
      directions: (R, 3) unit vectors of all rays, whether they return or not.
      middle: (3,) in m, the spacecraft's place from the middle, along the same axes.
      longest: semi-axis of the body in m.
    """
    distance = float(np.linalg.norm(middle))
    ahead = -middle / distance
    along = directions @ ahead
    near = along > np.cos(min(longest / distance, 0.5 * np.pi))
    across = directions[near] * distance - (along[near] * distance)[:, None] * ahead
    spread = np.outer(ahead, ahead) + 4.0 / longest**2 * across.T @ across / max(len(across), 1)
    shares, axes = np.linalg.eigh(spread)
    return longest**2 / 3.0 * (axes * np.clip(1.0 - shares, 0.0, 1.0)) @ axes.T


def middles(returns: Returns, semi_axes: Vector3, attitudes: np.ndarray) -> tuple[Values, Vectors3]:
    """The frames (M,) that show the body, and the spacecraft's places (M, 3) in m from its middle.

    Args:
      returns: of the body. semi_axes: see `middle_of`. attitudes: R_NB (F, 3, 3), as believed.
    """
    rays = returns.rays
    bounds = np.searchsorted(returns.frames, np.arange(len(returns.times) + 1))
    seen = np.flatnonzero(np.diff(bounds) >= FEWEST)
    places = [middle_of(rays[bounds[k] : bounds[k + 1]], semi_axes, attitudes[k]) for k in seen]
    return seen, np.reshape(places, (-1, 3))


@one_thread()
def with_first_orbit(
    survey: Survey, returns: Returns, expected: Expected, semi_axes: Vector3
) -> Survey:
    """Gives the survey with a path and a GM that fit the middles of the frames.

    Args:
      survey: as believed; its path's coefficients may be any. returns: of the body.
      expected: how wrong the belief may be. semi_axes: (3,) in m of the ellipsoid that is known.

    Raises:
      InputError: too few frames show the body.
    """
    seen, places = middles(returns, semi_axes, survey.body_attitudes(returns.times))
    if len(seen) < 3 * survey.path.size // 2:
        raise InputError(
            f"the survey saw its body in {len(seen)} of {len(returns.times)} frames: the lidar "
            "does not reach it, or looks elsewhere; check lidar.max_range_m and its field of view"
        )
    value = survey.path.matrix(returns.times[seen])
    places = places - survey.moved(returns.times[seen])
    sigma, size = _SPREAD * float(np.max(semi_axes)), 3 * survey.path.size
    start = np.linalg.solve(value.T @ value + _smoothness(survey.path), value.T @ places)
    survey = dc.replace(survey, coefficients=start, tail=survey.tail.copy())
    believed = survey.tail[GRAVITY][0]
    count = size + survey.turns.size + len(survey.tail)
    gm = count + GRAVITY.start
    chosen = np.r_[np.arange(size), gm]
    for _ in range(_ITERATIONS):
        matrix, right = np.zeros((count, count)), np.zeros(count)
        add_motion(survey, expected, matrix, right)
        residuals = value @ survey.coefficients - places
        weights = 1.0 / (sigma**2 + (residuals**2).sum(axis=1) / 4.0)
        for i in range(3):
            axis = np.arange(i, size, 3)
            matrix[np.ix_(axis, axis)] += value.T @ (weights[:, None] * value)
            right[axis] += value.T @ (weights * residuals[:, i])
        deviation = expected.gravity * believed
        matrix[gm, gm] += deviation**-2.0
        right[gm] += (survey.tail[GRAVITY][0] - believed) / deviation**2
        # Units are many, and short parts of the path steep: Cholesky's factors do not mind either.
        factor = scipy.linalg.cho_factor(matrix[np.ix_(chosen, chosen)])
        step = -scipy.linalg.cho_solve(factor, right[chosen])
        survey.coefficients = survey.coefficients + step[:-1].reshape(-1, 3)
        survey.tail[GRAVITY] += step[-1]
    return survey


def _smoothness(path: Path) -> np.ndarray:
    """What makes the first path smooth: a matrix (J, J) of normal equations."""
    step = np.diff(np.unique(path.knots)).max()
    third = path.matrix(path.places, 3) * (step**2.5 * np.sqrt(path.steps))[:, None]
    rows = np.vstack([third, step * path.jumps])
    return _STIFF * rows.T @ rows
