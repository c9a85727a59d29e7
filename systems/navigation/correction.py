"""Corrects an estimate by a measured frame: an iterated Kalman update in information form."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from proxops.systems.navigation._motion_kernel import turned
from proxops.systems.navigation.estimate import ATTITUDE, POSITION, Estimate
from proxops.systems.navigation.frame_model import FrameModel

# A residual beyond this many of its standard deviations is rejected.
_GATE = 5.0
# The update is linearised anew until it moves by less than this share of its deviations.
_CLOSE, _MOST_ITERATIONS = 0.3, 8


class Correction(NamedTuple):
    """The result of using one frame."""

    estimate: Estimate
    rms: float
    """Root mean square in m of the residuals of the returns used; NaN if there are none."""
    used: int
    """Number of returns used."""
    rejected: int
    """Number of returns whose prediction meets the body but disagrees with them."""
    surprise: float
    """Normalised innovation squared, over the number of returns used: about 1."""
    shift: float
    """How far the frame moved position and attitude, in standard deviations before it: a chi
    square of six degrees of freedom."""


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
    among = covariance[np.ix_(columns, columns)]
    to_all = covariance[:, columns]
    moved = np.zeros(prior.mean.size) if start is None else start
    estimate = _moved(prior, moved)
    for _ in range(_MOST_ITERATIONS):
        compared = model.compared(estimate, ranges)
        rows, variances = compared.rows, compared.variances
        usable = np.flatnonzero(variances < np.inf)
        rows, variances, residuals = rows[usable], variances[usable], compared.residuals[usable]
        # Residuals as they would be at the prior's mean, if the model were linear.
        innovations = residuals + rows @ moved[columns]
        if first:
            known = rows[:, 10:]
            judged, spread = residuals, variances + (known**2).sum(axis=1)
        else:
            judged, spread = innovations, variances + np.einsum("ki,ki->k", rows @ among, rows)
        good = np.flatnonzero(judged**2 < _GATE**2 * spread)
        if not good.size:
            return Correction(prior, np.nan, 0, usable.size, np.nan, np.nan)
        rows, innovations, weights = rows[good], innovations[good], 1.0 / variances[good]
        weighted = rows * weights[:, None]
        information, pull = rows.T @ weighted, innovations @ weighted
        system = np.eye(columns.size) + information @ among
        solved = np.linalg.solve(system, np.column_stack([pull, information @ to_all.T]))
        before, moved = moved, to_all @ solved[:, 0]
        estimate = _moved(prior, moved)
        posterior = covariance - to_all @ solved[:, 1:]
        change = np.abs(moved - before)[:9] / np.sqrt(np.diag(posterior)[:9])
        if change.max() < _CLOSE:
            break
    left = innovations - rows @ moved[columns]
    pose = np.r_[POSITION, ATTITUDE]
    shift = moved[pose] @ np.linalg.solve(covariance[np.ix_(pose, pose)], moved[pose])
    surprise = float(innovations @ (weights * innovations) - pull @ moved[columns])
    return Correction(
        estimate._replace(covariance=0.5 * (posterior + posterior.T)),
        float(np.sqrt(np.mean(left**2))),
        good.size,
        usable.size - good.size,
        surprise / good.size,
        float(shift),
    )


def _moved(prior: Estimate, moved: np.ndarray) -> Estimate:
    """The prior with another mean."""
    mean = prior.mean + moved
    mean[ATTITUDE] = 0.0
    return prior._replace(mean=mean, rotation=turned(prior.rotation, moved[ATTITUDE]))
