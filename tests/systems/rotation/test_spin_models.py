"""Torque-free rotation against an integration, closed forms, invariants and finite differences."""

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy import special
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from proxops.systems.common import InputError, rotation_matrix
from proxops.systems.rotation import BodyRotation, SteadySpin, TorqueFreeSpin, spin_model
from proxops.systems.rotation._torque_free_kernel import amplitude, carlson_rj

TILTED = Rotation.from_rotvec([0.3, -0.5, 0.2]).as_matrix()


def inertia_of(moments, axes=TILTED):
    return axes @ np.diag(moments) @ axes.T


def attitude(spin, time):
    return rotation_matrix(spin.attitude(time))


def integrated(inertia, rate, end):
    """w and R_NK at the end, by DOP853."""

    def derivative(_, state):
        w, turn = state[:3], state[3:].reshape(3, 3)
        change = -np.linalg.solve(inertia, np.cross(w, inertia @ w))
        cross = np.array([[0.0, -w[2], w[1]], [w[2], 0.0, -w[0]], [-w[1], w[0], 0.0]])
        return np.concatenate([change, (turn @ cross).ravel()])

    start = np.concatenate([rate, np.eye(3).ravel()])
    path = solve_ivp(derivative, (0.0, end), start, "DOP853", rtol=1e-13, atol=1e-15)
    return path.y[:3, -1], path.y[3:, -1].reshape(3, 3)


@pytest.mark.parametrize(
    ("moments", "rate"),
    [
        ((0.4, 0.7, 0.9), (0.1, 0.2, 1.0)),  # About the greatest moment.
        ((0.4, 0.7, 0.9), (-1.0, 0.2, 0.1)),  # About the least, as Toutatis.
        ((0.4, 0.7, 0.9), (0.02, -1.0, 0.03)),  # Near the middle one: it tumbles over.
        ((0.4, 0.7, 0.9), (0.0, 1e-7, 1.0)),  # Next to steady.
        ((0.145, 0.992, 1.0), (-0.2, 0.1, -1.0)),
        ((0.5, 0.5, 0.8), (0.3, 0.1, 1.0)),
        ((0.5, 0.8, 0.8), (0.3, 0.1, 1.0)),
        ((0.7, 0.7, 0.7), (0.3, 0.1, 1.0)),
        ((0.4, 0.7, 0.9), (0.0, 0.0, 1.0)),
        ((0.4, 0.7, 0.9), (0.0, 1.0, 0.0)),
    ],
)
def test_a_torque_free_body_turns_as_integrated(moments, rate):
    inertia, rate = inertia_of(moments), TILTED @ np.array(rate)
    spin = TorqueFreeSpin(inertia, rate)
    w, turn = integrated(inertia, rate, 20.0)
    np.testing.assert_allclose(spin.angular_velocity(20.0), w, atol=1e-11)
    np.testing.assert_allclose(attitude(spin, 20.0), turn, atol=1e-11)


@settings(max_examples=50)
@given(
    ratios=st.tuples(st.floats(0.1, 1.0), st.floats(0.0, 0.99)),
    turned=st.tuples(*[st.floats(-3.0, 3.0)] * 3),
    rate=st.tuples(*[st.floats(-1e-3, 1e-3)] * 3).filter(lambda w: np.linalg.norm(w) > 1e-6),
    time=st.floats(0.0, 1e6),
)
def test_energy_and_momentum_stay(ratios, turned, rate, time):
    least, share = ratios
    inertia = inertia_of(
        (least, 1.0, 1.0 + least * share), Rotation.from_rotvec(turned).as_matrix()
    )
    spin, rate = TorqueFreeSpin(inertia, np.array(rate)), np.array(rate)
    assume(spin._motion is None or spin._motion.parameter < 1.0 - 1e-9)  # About the middle axis.
    w = spin.angular_velocity(time)
    assert w @ inertia @ w == pytest.approx(rate @ inertia @ rate, rel=1e-12)
    momentum, before = attitude(spin, time) @ inertia @ w, inertia @ rate
    assert np.abs(momentum - before).max() < 1e-12 * np.linalg.norm(before)


def test_a_symmetric_top_precesses_by_the_closed_form():
    moments, rate = np.array([0.5, 0.5, 0.8]), np.array([0.3, 0.0, 1.0])
    spin, time = TorqueFreeSpin(np.diag(moments), rate), 7.0
    momentum = moments * rate
    # R_NK = Rot(L, |L| t / I1) Rot(z, (1 - I3 / I1) w3 t).
    precession = Rotation.from_rotvec(momentum / 0.5 * time)
    own = Rotation.from_rotvec([0.0, 0.0, (1.0 - 0.8 / 0.5) * time])
    np.testing.assert_allclose(attitude(spin, time), (precession * own).as_matrix(), atol=1e-13)


def test_the_angular_acceleration_is_the_derivative_in_k():
    spin = TorqueFreeSpin(inertia_of((0.4, 0.7, 0.9)), np.array([0.3, 0.1, 1.0]))
    ahead, behind = spin.angular_velocity(np.array([2.0 + 1e-5, 2.0 - 1e-5]))
    np.testing.assert_allclose(spin.angular_acceleration(2.0), (ahead - behind) / 2e-5, atol=1e-9)
    assert spin.angular_velocity(np.zeros((4, 2))).shape == (4, 2, 3)


@pytest.mark.parametrize("rate", [(0.3, 0.1, 1.0), (0.0, 0.0, 1.0)])
@pytest.mark.parametrize("time", [0.5, 40.0])
def test_errors_are_those_of_spins_that_begin_otherwise(rate, time):
    inertia, rate, step = inertia_of((0.4, 0.7, 0.9), np.eye(3)), np.array(rate), 0.1
    errors = TorqueFreeSpin(inertia, rate).errors(time, step)
    for axis in range(3):
        change = 1e-5 * np.eye(3)[axis]
        more, less = (TorqueFreeSpin(inertia, rate + sign * change) for sign in (1.0, -1.0))
        found = (more.angular_velocity(time) - less.angular_velocity(time)) / 2e-5
        np.testing.assert_allclose(errors.rate[:, axis], found, atol=1e-5)

        def turned(at, more=more, less=less):
            turn = attitude(less, at).T @ attitude(more, at)
            return Rotation.from_matrix(turn).as_rotvec() / 2e-5

        found = (more.angular_acceleration(time) - less.angular_acceleration(time)) / 2e-5
        np.testing.assert_allclose(errors.acceleration[:, axis], found, atol=1e-5)
        found = (turned(time + 0.5 * step) - turned(time - 0.5 * step)) / step
        np.testing.assert_allclose(errors.turn[:, axis], found, atol=1e-4)


@pytest.mark.parametrize("rate", [(0.0, 0.0, 1.0), (0.6, 0.0, -0.8)])
def test_the_errors_of_a_steady_spin_leave_the_true_axis_in_the_body(rate):
    # The middle of a step stands for all of it.
    errors = SteadySpin(rate).errors(3.0, 1e-2)
    np.testing.assert_array_equal(errors.rate, np.eye(3))
    change = np.array([1e-5, -2e-5, 1e-5])

    def turned(at):
        more = attitude(SteadySpin(rate + change), at)
        return Rotation.from_matrix(attitude(SteadySpin(rate), at).T @ more).as_rotvec()

    found = (turned(3.005) - turned(2.995)) / 1e-2
    np.testing.assert_allclose(errors.turn @ change, found, rtol=1e-3, atol=1e-8)


def test_body_rotation_puts_its_spin_out():
    spin = TorqueFreeSpin(inertia_of((0.4, 0.7, 0.9)), np.array([0.3, 0.1, 1.0]))
    system = BodyRotation(spin)
    context = system.CreateDefaultContext()
    context.SetTime(3.0)
    for name in ("attitude", "angular_velocity", "angular_acceleration"):
        value = system.GetOutputPort(name).Eval(context)
        np.testing.assert_array_equal(value, getattr(spin, name)(3.0))


@pytest.mark.parametrize("rate", [[0.2, 1.0, 0.4], [0.0, 0.0, 1.0]])
def test_attitudes_at_many_times(rate):
    """Before time 0, too; a quaternion and its negative are one."""
    spin, times = TorqueFreeSpin(np.diag([1.0, 1.6, 2.0]), rate), np.array([-7.0, 0.0, 0.3, 25.0])
    found = spin.attitudes(times)
    for time, each in zip(times, found, strict=True):
        assert abs(each @ spin.attitude(float(time))) == pytest.approx(1.0, abs=1e-14)
    turned = Rotation.from_quat(found, scalar_first=True)
    momentum = spin.angular_velocity(times) @ spin.inertia
    np.testing.assert_allclose(turned.apply(momentum), np.tile(momentum[1], (4, 1)), atol=1e-12)


def test_what_is_no_rotation_is_refused():
    with pytest.raises(InputError, match="exceeds the sum"):
        TorqueFreeSpin(np.diag([1.0, 1.0, 3.0]), np.ones(3))
    with pytest.raises(InputError, match="one or three finite numbers"):
        spin_model((1.0, 2.0))


@given(
    u=st.floats(-50.0, 50.0),
    m=st.one_of(st.floats(0.0, 1.0 - 2e-10), st.floats(-9.5, 0.0).map(lambda x: 1.0 - 10.0**x)),
)
def test_the_amplitude_is_that_of_scipy(u, m):
    assert amplitude(u, m) == pytest.approx(special.ellipj(u, m)[3], abs=2e-14)


@given(
    x=st.floats(0.0, 1.0),
    rest=st.tuples(*[st.floats(-9.0, 0.0).map(lambda x: 10.0**x)] * 2),
    p=st.floats(-4.0, 4.0).map(lambda x: 10.0**x),
)
def test_carlsons_integral_is_that_of_scipy(x, rest, p):
    assert carlson_rj(x, *rest, p) == pytest.approx(special.elliprj(x, *rest, p), rel=1e-14)
