"""Relief that the map has not: noise of the ranges that is alike from frame to frame.

Boulders and the curvature of facets are too fine to be estimated. As noise that is new in each
frame they would be averaged away, although a spacecraft that hovers sees the same stones for hours.
What they do to the pose is estimated: docs/method/navigation.md, Relief.
"""

from __future__ import annotations

import math

import numpy as np

from proxops.systems.common import Vectors3
from proxops.systems.navigation.estimate import POSITION, Estimate

# Rays by which the relief's likeness from ray to ray is computed, at most.
_ENOUGH = 200
# Over so many correlation lengths of way, half of what matters of the relief stays alike: the rays
# meet other stones then. The other half changes sooner, with the facets that the rays meet: some
# frames in a row meet the same ones, so each of them counts as one of so many.
_LENGTHS, _SEEN_AGAIN = 3.0, 4.0
PATTERNS = 6
"""Number of the coefficients: relief looks like an error of position and attitude.

It looks like one of the lidar and of the map, too. But where that had coefficients of its own,
navigation on maps of surveys was overconfident."""


def relief_rows(
    rows: np.ndarray, points: Vectors3, std: float, correlation: float
) -> tuple[np.ndarray, float]:
    """What coefficients of the relief, independent and of variance 1, do to residuals.

    The relief is a random field along the normals with the covariance s^2 exp(-d^2 / (2 l^2)). Of
    its heights at the points that the rays meet, those parts matter that look like an error of the
    pose.

    Args:
      rows: (K, P) derivatives of the residuals by position and attitude.
      points: (K, 3) in m, where the rays meet the map.
      std, correlation: s and l in m.

    Returns:
      (K, P), with columns of 0 if there are fewer rays; and the variance in m^2 by which each
      residual is off anew in each frame: of what matters, as much as the coefficients have, and
      several times over, because it is not new in each.
    """
    basis, triangle = np.linalg.qr(rows / np.maximum(np.linalg.norm(rows, axis=0), 1e-300))
    # Without a sign of their own, patterns would not be alike from frame to frame.
    basis *= np.where(np.diag(triangle) < 0.0, -1.0, 1.0)
    some = slice(None, None, -(-len(points) // _ENOUGH))
    near, few = points[some], basis[some]
    squares = (near**2).sum(1)
    squares = squares[:, None] + squares - 2.0 * near @ near.T
    alike = np.exp(-np.maximum(squares, 0.0) / (2.0 * correlation**2))
    np.fill_diagonal(alike, 0.0)
    share = (len(points) / len(near)) ** 2
    spread = basis.T @ basis + share * few.T @ alike @ few
    values, vectors = np.linalg.eigh(spread)
    root = (vectors * np.sqrt(np.maximum(values, 0.0))) @ vectors.T
    found = np.zeros_like(rows)
    found[:, : basis.shape[1]] = std * basis @ root
    return found, _SEEN_AGAIN * std**2 * max(0.0, float(values.mean()))


def forgotten(estimate: Estimate, before: Estimate, first: int, correlation: float) -> Estimate:
    """An estimate whose coefficients of the relief, from index `first` on, are those of now.

    As the spacecraft moves, its rays meet other stones: the coefficients are a first-order
    Gauss-Markov process over the way since the estimate `before`, with the correlation length in m.
    """
    way = np.linalg.norm(estimate.mean[POSITION] - before.mean[POSITION])
    decay = math.exp(-way / (_LENGTHS * correlation))
    mean, covariance = estimate.mean.copy(), estimate.covariance.copy()
    some = slice(first, None)
    mean[some] *= decay
    covariance[some] *= decay
    covariance[:, some] *= decay
    covariance[some, some] += (1.0 - decay**2) * np.eye(len(mean) - first)
    return estimate._replace(mean=mean, covariance=covariance)
