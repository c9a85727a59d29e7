"""Corrects an estimate by a measured frame: an iterated extended Kalman update."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.linalg import solve_triangular

from proxops.systems.navigation import _update_kernel as kernel
from proxops.systems.navigation._motion_kernel import turned
from proxops.systems.navigation.estimate import ATTITUDE, MEASURED, POSITION, Estimate
from proxops.systems.navigation.frame_model import FrameModel

# A residual beyond this many of its standard deviations is rejected.
_GATE = 5.0
# The frame is linearised anew until the predicted ranges change by less than this share of the
# noise (root mean square).
_CLOSE, _MOST_ITERATIONS = 0.3, 8
# Where the map's error is estimated, more returns than this take longer and say little more.
_ENOUGH = 160
_POSE = np.r_[POSITION, ATTITUDE]


class Correction(NamedTuple):
    """The result of using one frame."""

    estimate: Estimate
    rms: float
    """Root mean square in m of the residuals of the returns used; NaN if there are none."""
    used_rays: np.ndarray
    """Indices of the rays whose returns are used."""
    rejected_rays: np.ndarray
    """Those of returns whose prediction meets the body but disagrees with them."""
    surprise: float
    """Normalised innovation squared, over the number of returns used: about 1."""
    shift: float
    """How far the frame moved position and attitude, in standard deviations before it: a chi
    square of six degrees of freedom."""

    @property
    def used(self) -> int:
        """Number of returns used."""
        return self.used_rays.size

    @property
    def rejected(self) -> int:
        """Number of returns rejected."""
        return self.rejected_rays.size


class _Update(NamedTuple):
    """A linear update of the prior by K residuals."""

    moved: np.ndarray
    """(n,) what the mean moves by."""
    surprise: float
    """Normalised innovation squared."""
    covariance: np.ndarray
    """(n, n) after it."""


def corrected(
    model: FrameModel, prior: Estimate, ranges: np.ndarray, start: np.ndarray | None = None
) -> Correction:
    """Corrects an estimate by a frame.

    Args:
      model: predicts the frame.
      prior: the estimate before.
      ranges: (planes * rays,) in m; +inf: no return.
      start: (n,) what the prior's mean is moved by before the frame is linearised, if the prior
        knows next to nothing of the pose. A return is then judged by its residual alone. None: the
        prior knows the pose.
    """
    first = start is not None
    columns, covariance = model.columns, prior.covariance
    moved = np.zeros(prior.mean.size) if start is None else start
    iteration = 0
    while True:
        frame = _linearised(model, prior, moved, ranges, first)
        used = frame.innovations.size
        if not used:
            return Correction(prior, np.nan, frame.rays, frame.rejected, np.nan, np.nan)
        by = _by_returns if used < columns.size else _by_quantities
        update = by(covariance, columns, frame.rows, frame.innovations, frame.variances)
        change, moved = frame.rows @ (update.moved - moved)[columns], update.moved
        iteration += 1
        close = change @ change < used * (_CLOSE * model.noise_std) ** 2
        if close or iteration == _MOST_ITERATIONS:
            break
    left = frame.innovations - frame.rows @ moved[columns]
    shift = moved[_POSE] @ np.linalg.solve(covariance[np.ix_(_POSE, _POSE)], moved[_POSE])
    return Correction(
        _moved(prior, moved)._replace(covariance=update.covariance),
        float(np.sqrt(np.mean(left**2))),
        frame.rays,
        frame.rejected,
        update.surprise / used,
        float(shift),
    )


class _Linearised(NamedTuple):
    """The K returns of a frame that are used."""

    rays: np.ndarray
    """(K,) their indices in the frame."""
    rows: np.ndarray
    """(K, C) derivatives."""
    innovations: np.ndarray
    """(K,) the residuals as they would be at the prior's mean, if the model were linear."""
    variances: np.ndarray
    """(K,) of the noise."""
    rejected: np.ndarray
    """Indices of the rays whose returns were rejected."""


def _linearised(
    model: FrameModel, prior: Estimate, moved: np.ndarray, ranges: np.ndarray, first: bool
) -> _Linearised:
    """A frame, linearised where the prior's mean is `moved` (n,) to; see `corrected`."""
    columns = model.columns
    compared = model.compared(_moved(prior, moved), ranges)
    usable = np.flatnonzero(compared.variances < np.inf)
    if columns.size > usable.size // 2:  # As many unknowns as returns.
        usable = usable[:: max(1, -(-usable.size // _ENOUGH))]
    rows, variances = compared.rows[usable], compared.variances[usable]
    residuals = compared.residuals[usable]
    innovations = residuals + rows @ moved[columns]
    if first:  # Only the map's error says how large a residual may be.
        judged, spread = residuals, variances + (rows[:, MEASURED.size :] ** 2).sum(axis=1)
    else:
        known = rows @ prior.covariance[np.ix_(columns, columns)]
        judged, spread = innovations, variances + np.einsum("ki,ki->k", known, rows)
    agrees, rays = judged**2 < _GATE**2 * spread, compared.rays[usable]
    good = np.flatnonzero(agrees)
    return _Linearised(rays[good], rows[good], innovations[good], variances[good], rays[~agrees])


def _by_returns(
    covariance: np.ndarray,
    columns: np.ndarray,
    rows: np.ndarray,
    innovations: np.ndarray,
    variances: np.ndarray,
) -> _Update:
    """The update in the form that is fast for few residuals.

    Args:
      covariance: (n, n). columns: (C,) where the measured quantities are.
      rows: (K, C) derivatives. innovations: (K,). variances: (K,) of the noise.
    """
    crossed = covariance[:, columns] @ rows.T
    total = rows @ crossed[columns]
    total[np.diag_indices_from(total)] += variances
    factor = np.linalg.cholesky(total)
    learned = solve_triangular(factor, crossed.T, lower=True, check_finite=False).T
    white = solve_triangular(factor, innovations, lower=True, check_finite=False)
    return _Update(learned @ white, float(white @ white), covariance - learned @ learned.T)


def _by_quantities(
    covariance: np.ndarray,
    columns: np.ndarray,
    rows: np.ndarray,
    innovations: np.ndarray,
    variances: np.ndarray,
) -> _Update:
    """The same update in the form that is fast for many residuals of few quantities."""
    to_all = covariance[:, columns]
    moved, after, squares = kernel.update(
        covariance, to_all, to_all[columns], rows, innovations, variances
    )
    pull = (innovations / variances) @ rows
    return _Update(moved, float(squares - pull @ moved[columns]), after)


def _moved(prior: Estimate, moved: np.ndarray) -> Estimate:
    """The prior with another mean."""
    mean = prior.mean + moved
    mean[ATTITUDE] = 0.0
    return prior._replace(mean=mean, rotation=turned(prior.rotation, moved[ATTITUDE]))
