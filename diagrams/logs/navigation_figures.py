"""Figures of merit of the navigation in one flight: its errors, and whether it knew them."""

from __future__ import annotations

import numpy as np
import xarray as xr
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

from proxops.diagrams.logs.lengths import length_text
from proxops.diagrams.scenario import Scenario
from proxops.systems.common import LARGEST, Vectors3
from proxops.systems.navigation import NavigationPhase

# The figures of the errors leave out the beginning (s), in which the navigation settles.
_SETTLED = 200.0
# An error is consistent if it is within this many standard deviations of the covariance.
_DEVIATIONS = 3.0
_PARTS = {"position_error_m": 0, "velocity_error_m_s": 3, "attitude_error_deg": 6}


def navigation_figures(data: xr.Dataset) -> dict[str, float]:
    """Computes the figures of a log's navigation; {} if the flight had none.

    Returns:
      `navigation_following`: the share of the control steps at which the navigation followed. Of
      the steps after the first 200 s with a state: medians and 95th percentiles of the errors, and
      `navigation_consistent`, the least share, over the nine components, of steps at which the
      component's error is within three standard deviations.
    """
    if "navigation_state" not in data or data.sizes["time"] < 2:
        return {}
    # The flight may end between two control steps.
    phase = data["navigation_phase"].values[:-1]
    figures = {"navigation_following": float(np.mean(phase == NavigationPhase.FOLLOWING))}
    errors, deviations = navigation_errors(data)
    used = np.isfinite(errors).all(axis=1) & (data["time"].values >= _SETTLED)
    errors, deviations = errors[used], deviations[used]
    if not len(errors):
        return figures
    for name, first in _PARTS.items():
        sizes = np.linalg.norm(errors[:, first : first + 3], axis=1)
        sizes = np.degrees(sizes) if name.endswith("_deg") else sizes
        figures[f"navigation_{name}_median"] = float(np.median(sizes))
        figures[f"navigation_{name}_p95"] = float(np.percentile(sizes, 95))
    inside = np.abs(errors) <= _DEVIATIONS * deviations
    figures["navigation_consistent"] = float(inside.mean(axis=0).min())
    return figures


def why_never_known(
    data: xr.Dataset, scenario: Scenario, surface: Vectors3
) -> list[tuple[str, str]]:
    """Says, in rows of a table, why the navigation of a flight never knew where it is.

    Args:
      data: the log's dataset.
      scenario: the log's.
      surface: vertices (N, 3) in m in K of the true body.

    Returns:
      Labels and texts; none if the flight had no navigation, or it knew at some step.
    """
    if "navigation_state" not in data or np.isfinite(data["navigation_state"].values).any():
        return []
    positions = data["state"].values[:, :3]
    nearest = float(KDTree(surface).query(positions)[0].min())
    reach = f"{length_text(scenario.lidar.max_range_m)}, {length_text(nearest)}"
    reaches = ("range of the lidar, least distance of the surface", reach)
    if "ranges" not in data:
        return [("why it never did", "unknown: log_ranges is false"), reaches]
    returns = np.isfinite(data["ranges"].values).sum(axis=(1, 2))
    if not returns.any():
        return [("why it never did", "no frame of the lidar had a return"), reaches]
    seen = f"{np.count_nonzero(returns)} of {len(returns)}, {returns.max()}"
    return [
        ("why it never did", "no frame showed for certain where it is"),
        ("frames with returns, and most returns of one", seen),
    ]


def navigation_errors(data: xr.Dataset) -> tuple[np.ndarray, np.ndarray]:
    """Gives the errors of a log's navigation, and their standard deviations as it knows them.

    Returns:
      Two arrays (N, 9): position in m, velocity in m/s, and the rotation vector in rad in K that
      turns the believed S into the true S. NaN in rows without a state.
    """
    state, believed = data["navigation_state"].values, data["navigation_attitude"].values
    variances = np.einsum("nii->ni", data["navigation_covariance"].values)
    known = (np.abs(state) < LARGEST).all(axis=1)
    known &= ((variances >= 0.0) & (variances < LARGEST)).all(axis=1)
    true = np.tile([1.0, 0.0, 0.0, 0.0], (len(state), 1))
    if "attitude" in data:
        true = data["attitude"].values
    known &= _is_rotation(believed) & _is_rotation(true)
    errors = np.full((len(state), 9), np.nan)
    errors[known, :6] = data["state"].values[known] - state[known]
    errors[known, 6:] = _rotation_vectors(true[known], believed[known])
    deviations = np.full((len(state), 9), np.nan)
    deviations[known] = np.sqrt(variances[known])
    return errors, deviations


def _is_rotation(quaternions: np.ndarray) -> np.ndarray:
    """Tells (N,) which of quaternions (N, 4) have unit length; damaged logs have others."""
    near = np.asarray((np.abs(quaternions) < 2.0).all(axis=1))
    lengths = np.linalg.norm(np.where(near[:, None], quaternions, 0.0), axis=1)
    return near & (np.abs(lengths - 1.0) < 1e-3)


def _rotation_vectors(true: np.ndarray, believed: np.ndarray) -> np.ndarray:
    """The rotation vectors (N, 3) in rad of R_true R_believed^T, from quaternions (N, 4)."""
    turn = Rotation.from_quat(true, scalar_first=True)
    return (turn * Rotation.from_quat(believed, scalar_first=True).inv()).as_rotvec()
