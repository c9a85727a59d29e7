"""Corrects an estimate by a measured frame: an iterated extended Kalman update.

Eq. 15 to 19 of docs/method/equations.md.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import scipy  # Its parts are imported when they are used.

from proxops.systems.navigation import _update_kernel as kernel
from proxops.systems.navigation._motion_kernel import turned
from proxops.systems.navigation.estimate import (
    ATTITUDE,
    LIDAR_BIAS,
    LIDAR_SCALE,
    MEASURED,
    POSITION,
    Estimate,
)
from proxops.systems.navigation.frame_model import FrameModel

# A residual beyond this many of its standard deviations is rejected.
GATE = 5.0
# The frame is linearised anew until the predicted ranges change by less than this share of the
# noise (root mean square). More returns than the second number give a closer estimate,
# so the changes have to be smaller then.
_CLOSE, _USUAL, _MOST_ITERATIONS = 0.3, 160, 8
# Where the map's error is estimated, or a place is sought, more returns than this take longer and
# say little more.
ENOUGH = 240
_POSE = np.r_[POSITION, ATTITUDE]
# What relief looks like, and a frame hardly tells from a place farther out: it is not estimated
# then, but counts as uncertain (Schmidt's consider filter).
_CONSIDERED = np.r_[LIDAR_BIAS, LIDAR_SCALE]


class Correction(NamedTuple):
    """The result of using one frame."""

    estimate: Estimate
    rms: float
    """Root mean square in m of the residuals of the returns used; NaN if there are none."""
    used_rays: np.ndarray
    """Indices of the rays whose returns are used."""
    rejected_rays: np.ndarray
    """Those of returns whose prediction meets the body but disagrees with them."""
    nis: float
    """Normalised innovation squared, over the number of returns used: about 1."""
    shift: float
    """The square of how far the frame moved position and attitude, in standard deviations before
    it: a chi square of six degrees of freedom."""

    @property
    def used(self) -> int:
        """Number of returns used."""
        return self.used_rays.size

    @property
    def rejected(self) -> int:
        """Number of returns rejected."""
        return self.rejected_rays.size


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
    columns, covariance = model.columns, prior.covariance
    gate = kernel.Gate(GATE, ENOUGH, 0 if start is None else MEASURED.size)
    moved = np.zeros(prior.mean.size) if start is None else start
    supposed = prior if start is None else _moved(prior, moved)
    held = _CONSIDERED if model.map_error.relief else _CONSIDERED[:0]
    iteration = 0
    while True:
        frame = model.compared(supposed, ranges)
        good, bad, rows, cross_covariance, innovations, variances = kernel.gated(
            covariance, columns, frame, moved, gate
        )
        used = variances.size
        if not used:
            return Correction(prior, np.nan, frame.rays[good], frame.rays[bad], np.nan, np.nan)
        if cross_covariance.size:
            update = _by_returns(
                covariance, columns, rows, cross_covariance, innovations, variances
            )
        else:
            update = kernel.update(covariance, columns, rows, innovations, variances)
        update.moved[held] = 0.0
        change, left = kernel.fit(columns, rows, innovations, moved, update.moved)
        moved = update.moved
        supposed = _moved(prior, moved)
        iteration += 1
        change *= max(1.0, used / _USUAL)
        if change < (_CLOSE * model.noise_std) ** 2 or iteration == _MOST_ITERATIONS:
            break
    update.covariance[np.ix_(held, held)] = covariance[np.ix_(held, held)]
    return Correction(
        Estimate(supposed.mean, supposed.rotation, update.covariance, prior.spent),
        math.sqrt(left),
        frame.rays[good],
        frame.rays[bad],
        update.nis / used,
        kernel.squared_deviation(covariance, _POSE, moved),
    )


def _by_returns(
    covariance: np.ndarray,
    columns: np.ndarray,
    rows: np.ndarray,
    cross_covariance: np.ndarray,
    innovations: np.ndarray,
    variances: np.ndarray,
) -> kernel.Update:
    """The update in the form that is fast for few residuals: see `update` of the kernel.

    Args:
      covariance: P (n, n). columns: (C,) where the measured quantities are in it.
      rows: H (K, C) derivatives. cross_covariance: H P (K, n). innovations: (K,).
      variances: (K,) of the noise.
    """
    # The triangular solvers of LAPACK and BLAS: scipy's checks take as long as these matrices.
    total = cross_covariance[:, columns] @ rows.T
    total.flat[:: len(total) + 1] += variances  # On the diagonal.
    factor, failed = scipy.linalg.lapack.dpotrf(total.T, lower=1, clean=0, overwrite_a=1)
    if failed:
        raise np.linalg.LinAlgError("the covariance of the residuals is not positive definite")
    both = np.column_stack([cross_covariance, innovations])
    white = scipy.linalg.blas.dtrsm(1.0, factor, both.T, side=1, lower=1, trans_a=1, overwrite_b=1)
    learned, innovations = white[:-1], white[-1]
    after = covariance - learned @ learned.T
    return kernel.Update(learned @ innovations, after, float(innovations @ innovations))


def _moved(prior: Estimate, moved: np.ndarray) -> Estimate:
    """The prior with another mean."""
    mean = prior.mean + moved
    mean[ATTITUDE] = 0.0
    rotation = turned(prior.rotation, moved[ATTITUDE])
    return Estimate(mean, rotation, prior.covariance, prior.spent)
