"""The attitude of S against K, against scipy's rotations and kinematics in the inertial frame."""

import math

import numpy as np
import pytest
from numpy.typing import ArrayLike
from one_system import evaluated
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from proxops.systems import AttitudeError
from proxops.systems.vehicle import (
    SpinKnowledge,
    TrueAttitudeConfig,
    believed_axes,
    gauss_markov_at,
)

SPIN = 3.24093e-4
TRUE = SPIN * 1.01 * np.array([0.03, -0.05, 1.0])
PHASE = 0.02
TIMES = (0.0, 10.0, 1234.5, 7200.0, 40_000.0)


def rotation(quaternion: ArrayLike) -> Rotation:
    assert np.linalg.norm(quaternion) == pytest.approx(1.0, abs=1e-14)
    return Rotation.from_quat(quaternion, scalar_first=True)


def same(first: Rotation, second: Rotation, tolerance: float = 1e-12) -> bool:
    return float((first.inv() * second).magnitude()) < tolerance


@pytest.mark.parametrize("time", TIMES)
def test_no_errors_are_exactly_none(time: float) -> None:
    system = AttitudeError(SpinKnowledge((0.0, 0.0, SPIN), SPIN))
    assert evaluated(system, "attitude", time).tolist() == [1.0, 0.0, 0.0, 0.0]


@pytest.mark.parametrize("time", TIMES)
@pytest.mark.parametrize("true", [TRUE, [0.0, 0.0, -0.9 * SPIN], [0.0, 0.0, 0.0]])
def test_composition_of_rotations(time: float, true: ArrayLike) -> None:
    constant = np.array([0.6, -1.2, 0.3])
    errors = TrueAttitudeConfig(constant.tolist(), math.degrees(1e-3), 600.0)
    system = AttitudeError(SpinKnowledge(np.array(true), SPIN, PHASE), errors, seed=3)
    varying = gauss_markov_at(time, std=1e-3, correlation_time=600.0, period=10.0, seed=8)
    truly = Rotation.from_rotvec(time * np.array(true))
    believed = Rotation.from_euler("z", SPIN * time + PHASE)
    expected = truly.inv() * believed * Rotation.from_rotvec(np.radians(constant) + varying)
    assert same(rotation(evaluated(system, "attitude", time, seed=8)), expected)


def test_against_integrated_kinematics() -> None:
    """Both frames are turned in the inertial frame by R' = R [w]x, step by step."""
    end = 5000.0

    def rates(_time: float, rows: np.ndarray) -> np.ndarray:
        body, craft = rows.reshape(2, 3, 3)
        believed = np.array([0.0, 0.0, SPIN])
        # A row r of R changes by r [w]x = r x w.
        return np.ravel([np.cross(body, TRUE), np.cross(craft, believed)])

    start = np.stack([np.eye(3), Rotation.from_euler("z", PHASE).as_matrix()]).ravel()
    flown = solve_ivp(rates, (0.0, end), start, method="DOP853", rtol=1e-12, atol=1e-13)
    R_NK, R_NS = flown.y[:, -1].reshape(2, 3, 3)
    found = believed_axes(end, SpinKnowledge(tuple(TRUE), SPIN, PHASE))
    assert rotation(found).as_matrix() == pytest.approx(R_NK.T @ R_NS, abs=1e-10)


def test_continuous_in_time() -> None:
    """The quaternion itself, with its sign, so that a log of it can be interpolated."""
    system = AttitudeError(
        SpinKnowledge(TRUE, SPIN, PHASE), TrueAttitudeConfig(varying_std_deg=math.degrees(1e-3))
    )
    path = np.array([evaluated(system, "attitude", time) for time in np.arange(0.0, 3e4, 20.0)])
    assert np.linalg.norm(np.diff(path, axis=0), axis=1).max() < 1e-3
