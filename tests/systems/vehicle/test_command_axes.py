"""A command turned from K into S, against turns worked out by hand."""

import numpy as np
import pytest
from numpy.typing import ArrayLike
from one_system import evaluated
from scipy.spatial.transform import Rotation

from proxops.systems import ActualThrust, CommandAxes, ThrusterErrors

HALF = np.sqrt(0.5)


def turned(force: ArrayLike, attitude: ArrayLike) -> np.ndarray:
    return evaluated(CommandAxes(7.0), "force", force=force, attitude=attitude)


def test_by_hand() -> None:
    # S is turned by +90 degrees about K's z: K's x is S's -y, and K's y is S's x.
    about_z = (HALF, 0.0, 0.0, HALF)
    assert turned([1.0, 2.0, 3.0], about_z) == pytest.approx([2.0, -1.0, 3.0], abs=1e-14)
    # By +30 degrees about x: K's y is cos 30 along S's y and -sin 30 along S's z.
    about_x = (np.cos(np.pi / 12.0), np.sin(np.pi / 12.0), 0.0, 0.0)
    expected = [0.0, 2.0 * np.cos(np.pi / 6.0), -1.0]
    assert turned([0.0, 2.0, 0.0], about_x) == pytest.approx(expected, abs=1e-14)


def test_each_axis_of_s_has_the_limit() -> None:
    # The diagonal of K's x and y is S's x.
    eighth = (np.cos(np.pi / 8.0), 0.0, 0.0, np.sin(np.pi / 8.0))
    assert turned([7.0, 7.0, -7.0], eighth) == pytest.approx([7.0, 0.0, -7.0], abs=1e-14)


def test_true_thrust_undoes_it_where_the_attitude_is_right() -> None:
    draws = np.random.default_rng(2)
    for _ in range(20):
        attitude = Rotation.random(rng=draws).as_quat(scalar_first=True)
        force = draws.uniform(-3.0, 3.0, 3)
        told = {"force": turned(force, attitude), "attitude": attitude}
        found = evaluated(ActualThrust(ThrusterErrors(), 10.0), "force", **told)
        assert found == pytest.approx(force, abs=1e-12)
