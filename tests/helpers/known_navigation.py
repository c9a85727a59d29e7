"""The log of a flight whose navigation has errors and covariances that a test knows."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation
from synthetic_log import synthetic_log

from proxops.diagrams.logs import FlightLog
from proxops.systems.navigation import NavigationPhase

ACQUIRING, LOST = slice(0, 3), slice(60, 70)
"""Rows without a state, and rows in which it is lost."""
ERROR = np.array([30.0, -40.0, 120.0, 0.01, 0.02, -0.03])
"""True less believed position and velocity, in m and m/s."""
TURN = np.array([1e-3, 0.0, -2e-3])
"""Rotation vector in K from the believed to the true S, in rad."""
AXES = Rotation.from_rotvec([0.3, -0.2, 0.9]).as_matrix()
"""Principal axes of the covariance of the position, as columns."""
DEVIATIONS = np.array([20.0, 50.0, 100.0])
"""Standard deviations along them, in m, in every row."""


def navigated_log() -> FlightLog:
    """A synthetic log with a navigation; the spacecraft's axes are truly those of K."""
    plain = synthetic_log(100, ranges=False)
    data = plain.dataset
    count = data.sizes["time"]
    state = data["state"].values - ERROR
    state[ACQUIRING] = np.nan
    covariance = np.diag(np.r_[np.zeros(3), np.full(3, 0.02**2), np.full(3, 1e-3**2)])
    covariance[:3, :3] = AXES @ np.diag(DEVIATIONS**2) @ AXES.T
    covariances = np.tile(covariance, (count, 1, 1))
    covariances[ACQUIRING] = np.nan
    phase = np.full(count, float(NavigationPhase.FOLLOWING))
    phase[ACQUIRING], phase[LOST] = NavigationPhase.ACQUIRING, NavigationPhase.LOST
    believed = Rotation.from_rotvec(-TURN).as_quat(scalar_first=True)
    columns = {
        "navigation_state": (("time", "component"), state),
        "navigation_attitude": (("time", "quaternion"), np.tile(believed, (count, 1))),
        "navigation_covariance": (("time", "known", "known_with"), covariances),
        "navigation_residual": ("time", np.full(count, 45.0)),
        "navigation_returns": ("time", np.arange(count, dtype=float)),
        "navigation_rejected": ("time", np.arange(count) % 3.0),
        "navigation_innovation": ("time", np.ones(count)),
        "navigation_phase": ("time", phase),
    }
    return FlightLog(data.assign(columns), plain.body)
