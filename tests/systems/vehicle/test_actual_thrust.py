"""Thrusters with errors, against figures worked out by hand."""

from typing import Any

import numpy as np
import pytest
from numpy.typing import ArrayLike
from one_system import context_of, evaluated
from scipy.spatial.transform import Rotation

from proxops.systems import ActualThrust, ThrusterErrors
from proxops.systems.vehicle import thrust_given

PERIOD = 10.0
IDENTITY = (1.0, 0.0, 0.0, 0.0)
HALF = np.sqrt(0.5)


def outputs(
    command: ArrayLike,
    errors: ThrusterErrors,
    attitude: ArrayLike | None = None,
    specific_impulse: float | None = None,
) -> dict[str, np.ndarray]:
    system = ActualThrust(errors, PERIOD, specific_impulse)
    turned: dict[str, Any] = {} if attitude is None else {"attitude": attitude}
    context = context_of(system, force=command, **turned)
    names = ("force", "thrust", "mass_flow")
    return {name: system.GetOutputPort(name).Eval(context).copy() for name in names}


def test_no_errors_change_no_bit() -> None:
    command = np.random.default_rng(1).uniform(-7.0, 7.0, 3)
    for attitude in (None, IDENTITY):
        out = outputs(command, ThrusterErrors(), attitude)
        assert np.array_equal(out["force"], command)
        assert np.array_equal(out["thrust"], command)
        assert out["mass_flow"] == 0.0


def test_thrust_in_s_turned_into_k_by_hand() -> None:
    # S is turned by +90 degrees about K's z: S's x is K's y, S's y is K's -x.
    out = outputs([1.0, 2.0, 3.0], ThrusterErrors(), (HALF, 0.0, 0.0, HALF))
    assert out["force"] == pytest.approx([-2.0, 1.0, 3.0], abs=1e-14)
    # The thrusters are turned by +90 degrees about S's x: what they call y is S's z.
    mounted = ThrusterErrors(scale=(1.0, 1.1, 1.0), direction=(np.pi / 2.0, 0.0, 0.0))
    out = outputs([0.0, 2.0, 0.0], mounted)
    assert out["thrust"] == pytest.approx([0.0, 2.2, 0.0], abs=1e-14)
    assert out["force"] == pytest.approx([0.0, 0.0, 2.2], abs=1e-14)
    # Both: the thrusters' y is S's z is K's z; their z is S's -y is K's x.
    out = outputs([0.0, 2.0, 1.0], mounted, (HALF, 0.0, 0.0, HALF))
    assert out["force"] == pytest.approx([1.0, 0.0, 2.2], abs=1e-14)


def test_turned_as_scipy_turns() -> None:
    draws = np.random.default_rng(2)
    for _ in range(20):
        attitude, direction = Rotation.random(rng=draws), draws.normal(size=3)
        command = draws.uniform(-7.0, 7.0, 3)
        out = outputs(
            command, ThrusterErrors(direction=direction), attitude.as_quat(scalar_first=True)
        )
        expected = attitude.apply(Rotation.from_rotvec(direction).apply(command))
        assert out["force"] == pytest.approx(expected, abs=1e-13)
        assert np.array_equal(out["thrust"], command)


def test_least_impulse_and_quantum_per_axis() -> None:
    errors = ThrusterErrors(scale=(2.0, 1.0, 0.5), least_impulse=0.5, quantum=0.2)
    # Impulses over 10 s: 0.4 N s is too small, 0.6 is not; 0.06 N is nearest to 0 quanta.
    assert thrust_given((0.04, -0.06, 0.11), errors, PERIOD, 0.0) == pytest.approx((0, 0, 0.1))
    assert thrust_given((0.3001, -6.95, 0.0), errors, PERIOD, 0.0) == pytest.approx((0.8, -7, 0))
    only_least = ThrusterErrors(least_impulse=0.5)
    assert thrust_given((0.0499, 0.05, -0.051), only_least, PERIOD, 0.0) == (0.0, 0.05, -0.051)


def test_an_axis_fails_when_it_does() -> None:
    errors = ThrusterErrors(failed_axis=1, failure_time=100.0)
    system = ActualThrust(errors, PERIOD)
    for time, y in ((0.0, 2.0), (99.9, 2.0), (100.0, 0.0), (5000.0, 0.0), (50.0, 2.0)):
        for name in ("thrust", "force"):
            found = evaluated(system, name, time, force=[1.0, 2.0, 3.0])
            assert found.tolist() == [1.0, y, 3.0]


def test_mass_flow_by_hand() -> None:
    errors = ThrusterErrors(scale=(1.0, 0.5, 1.0), direction=(0.0, 0.3, 0.0))
    out = outputs([3.0, -4.0, 1.0], errors, specific_impulse=220.0)
    assert out["mass_flow"][0] == pytest.approx(6.0 / (220.0 * 9.80665), rel=1e-14)
