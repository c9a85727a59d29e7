"""Guidance, control and wheels: closed forms, and what must hold for any torque."""

import itertools
import math
import typing

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

from proxops.diagrams.scenario import load_spacecraft
from proxops.systems.attitude import (
    AttitudeControl,
    AttitudeGuidance,
    AttitudeGuidanceConfig,
    GivenForce,
    ReactionWheels,
    WheelArray,
    WheelFriction,
    attitude_error,
    control_torque,
    pointing_error,
)
from proxops.systems.vehicle import FreshHold, Reckoning

WHEELS = typing.cast(WheelArray, load_spacecraft("smallsat").wheels)
VECTOR = st.lists(st.floats(-0.5, 0.5), min_size=3, max_size=3).map(np.array)


def quaternion(turn):
    return turn.as_quat(canonical=True, scalar_first=True)


def test_the_error_is_the_rotation_vector_of_small_angles_the_short_way_round():
    reference = Rotation.from_rotvec([0.5, -2.0, 1.0])
    small = np.array([0.002, -0.001, 0.003])
    turned = quaternion(reference * Rotation.from_rotvec(small))
    for sign in (1.0, -1.0):
        error = attitude_error(sign * turned, quaternion(reference))
        np.testing.assert_allclose(error, small, atol=1e-7)
    assert pointing_error(turned, quaternion(reference)) == pytest.approx(np.linalg.norm(small))


def test_small_errors_die_as_a_damped_oscillator_does():
    """J e'' = control_torque: e'' + 2 z w0 e' + w0^2 e = 0, whatever the inertia."""
    inertia = np.array([[38.0, 1.0, -2.0], [1.0, 31.0, 0.5], [-2.0, 0.5, 24.0]])
    frequency, damping = 0.15, 0.9
    error, rate = np.array([0.01, -0.02, 0.03]), np.zeros(3)
    matrix = np.array([[0.0, 1.0], [-(frequency**2), -2 * damping * frequency]])
    exact = expm(matrix * 20.0)[0, 0] * error
    for _ in range(20_000):
        change = np.linalg.solve(inertia, control_torque(error, rate, inertia, frequency, damping))
        rate = rate + 1e-3 * change
        error = error + 1e-3 * rate
    np.testing.assert_allclose(error, exact, atol=2e-5)


def test_the_torque_holds_a_turning_spacecraft_with_spinning_wheels_to_its_turn():
    """At the reference it is what Euler's equation asks for: w x (J w + h), less the known part."""
    inertia = np.diag([38.0, 31.0, 24.0])
    control = AttitudeControl(inertia, WHEELS.axes)
    context = control.CreateDefaultContext()
    attitude = quaternion(Rotation.from_rotvec([0.3, 0.1, 2.0]))
    rate, wheels = np.array([0.001, -0.002, 0.003]), np.array([1.0, -2.0, 0.5, 0.3])
    disturbance = np.array([1e-3, 0.0, -2e-3])
    for name, value in (
        ("attitude", attitude), ("reference", attitude), ("angular_velocity", rate),
        ("reference_rate", rate), ("wheel_momentum", wheels), ("disturbance", disturbance),
    ):  # fmt: skip
        control.GetInputPort(name).FixValue(context, value)
    expected = np.cross(rate, inertia @ rate + wheels @ WHEELS.axes) - disturbance
    np.testing.assert_allclose(control.get_output_port().Eval(context), expected, atol=1e-15)


@settings(max_examples=60, deadline=None)
@given(torque=VECTOR, load=st.lists(st.floats(-4.0, 4.0), min_size=4, max_size=4).map(np.array))
def test_wheels_and_thrusters_together_give_the_torque(torque, load):
    system = ReactionWheels(WHEELS)
    context = system.CreateDefaultContext()
    system.GetInputPort("torque").FixValue(context, torque)
    system.GetInputPort("wheel_momentum").FixValue(context, load)
    asked = system.GetOutputPort("thruster_torque").Eval(context)
    system.GetInputPort("given_torque").FixValue(context, asked)
    motors = system.GetOutputPort("wheel_torque").Eval(context)
    assert (np.abs(motors) <= WHEELS.torque * (1 + 1e-12)).all()
    full = np.abs(load) > 0.95 * WHEELS.momentum
    assert (motors[full] * load[full] <= 0.0).all()
    light = (np.abs(load) < 0.1 * WHEELS.momentum).all()
    if light and np.linalg.norm(torque) < WHEELS.torque:
        np.testing.assert_allclose(asked, 0.0, atol=1e-12)
    if not full.any() and np.linalg.norm(torque - asked) < WHEELS.torque:
        np.testing.assert_allclose(asked - motors @ WHEELS.axes, torque, atol=1e-12)


def test_thrusters_unload_wheels_and_wheels_turn_against_them():
    momentum = np.zeros(4)
    momentum[0] = 3.0
    system = ReactionWheels(WHEELS)
    context = system.CreateDefaultContext()
    for _ in range(200):
        system.GetInputPort("torque").FixValue(context, np.zeros(3))
        system.GetInputPort("wheel_momentum").FixValue(context, momentum)
        asked = system.GetOutputPort("thruster_torque").Eval(context)
        system.GetInputPort("given_torque").FixValue(context, asked)
        momentum = momentum + system.GetOutputPort("wheel_torque").Eval(context)
    assert np.linalg.norm(momentum @ WHEELS.axes) < 0.2 * WHEELS.momentum


def test_friction_slows_wheels_and_full_speed_stops_their_motors():
    wheels = WheelArray(np.eye(3), 0.1, 4.0, 0.01)
    system = WheelFriction(wheels, 1e-3)
    context = system.CreateDefaultContext()
    system.GetInputPort("wheel_torque").FixValue(context, [0.1, 0.1, -0.1])
    system.GetInputPort("wheel_momentum").FixValue(context, [1.0, 4.0, 4.0])
    found = system.get_output_port().Eval(context)
    np.testing.assert_allclose(found, [0.1 - 1e-3, -4e-3, -0.1 - 4e-3])


def slewed(settings_, positions, spin=3e-4, **told):
    """References and rates of a guidance that is told positions, a second apart."""
    guidance = AttitudeGuidance(settings_, spin, 1.0)
    context = guidance.CreateDefaultContext()
    for k, position in enumerate(positions):
        context.SetTime(float(k))
        guidance.GetInputPort("position").FixValue(context, position)
        # It begins as it is turned.
        guidance.GetInputPort("body_attitude").FixValue(context, [1.0, 0.0, 0.0, 0.0])
        for name, value in told.items():
            guidance.GetInputPort(name).FixValue(context, value)
        yield (
            guidance.GetOutputPort("reference").Eval(context),
            guidance.GetOutputPort("reference_rate").Eval(context),
        )
        context.SetDiscreteState(guidance.EvalUniquePeriodicDiscreteUpdate(context))


def test_holding_keeps_to_the_body_as_it_is_believed_to_turn():
    for k, (reference, rate) in enumerate(slewed(AttitudeGuidanceConfig(), [np.zeros(3)] * 5)):
        expected = quaternion(Rotation.from_rotvec([0.0, 0.0, 3e-4 * k]))
        np.testing.assert_allclose(reference, expected, atol=1e-15)
        np.testing.assert_allclose(rate, [0.0, 0.0, 3e-4])


@pytest.mark.parametrize("place", [[1e5, 2e4, -3e4], [0.0, 0.0, -1e5], [0.0, 0.0, 1e5]])
def test_pointing_slews_to_the_body_within_limits_and_follows_it(place):
    limits = AttitudeGuidanceConfig(
        mode="body", boresight=[0, 0, 1], slew_deg_s=0.5, slew_time_s=10
    )
    path = np.array(place) + np.outer(np.arange(600.0), [2.0, -1.0, 3.0])
    found = list(slewed(limits, path))
    spin = Rotation.from_rotvec([0, 0, 3e-4])
    attitudes = [
        spin.inv() ** k * Rotation.from_quat(reference, scalar_first=True)
        for k, (reference, _) in enumerate(found)
    ]
    steps = [(b * a.inv()).as_rotvec() for a, b in itertools.pairwise(attitudes)]
    rates = np.degrees(np.linalg.norm(steps, axis=1))
    assert rates.max() <= 0.5 * (1 + 1e-9)
    changes = np.degrees(np.linalg.norm(np.diff(steps, axis=0), axis=1))
    assert changes.max() <= 0.05 * (1 + 1e-6)
    for k in range(450, 600):
        axis = attitudes[k].apply([0.0, 0.0, 1.0])
        down = -path[k] / np.linalg.norm(path[k])
        assert math.degrees(math.acos(min(1.0, axis @ down))) < 0.01
    # The rate that is given is the one at which the reference turns against N, in its own axes.
    for k in range(1, 599):
        a, b = (Rotation.from_quat(found[j][0], scalar_first=True) for j in (k - 1, k))
        np.testing.assert_allclose((a.inv() * b).as_rotvec(), found[k][1], atol=2e-5)


@pytest.mark.parametrize(
    ("mode", "told", "axis", "along"),
    [
        ("thrust", {"force": [1.0, 2.0, -2.0]}, [0.0, 0.0, 1.0], [1.0, 2.0, -2.0]),
        ("thrust", {"force": [0.05, 0.05, 0.0]}, [0.0, 0.0, 1.0], [0.0, 0.0, 1.0]),
        # Whatever the mode, what cannot be pushed is turned away from where pushing is wanted.
        ("hold", {"force": [1.0, 2.0, -2.0], "lost": [1.0, 0.0, 0.0]}, [-1, 0, 0], [1, 2, -2]),
        ("hold", {"force": [1.0, 2.0, -2.0], "lost": [0.0, 0.0, 0.0]}, [0, 0, 1], [0, 0, 1]),
        ("body", {}, [0.0, 0.0, 1.0], [-1e5, 0.0, 2e4]),
    ],
)
def test_a_direction_of_the_spacecraft_comes_to_lie_along_what_is_wanted(mode, told, axis, along):
    limits = AttitudeGuidanceConfig(mode=mode, place_m=[0.0, 0.0, 2e4], slew_deg_s=0.5)
    *_, (reference, _) = slewed(limits, [np.array([1e5, 0.0, 0.0])] * 600, spin=0.0, **told)
    found = Rotation.from_quat(reference, scalar_first=True).apply(axis)
    np.testing.assert_allclose(found, np.array(along) / np.linalg.norm(along), atol=1e-6)


def test_pointing_stays_where_the_position_is_not_known():
    unknown = [np.full(3, np.nan)] * 20
    *_, (reference, _) = slewed(AttitudeGuidanceConfig(mode="body"), unknown)
    np.testing.assert_allclose(reference, quaternion(Rotation.from_rotvec([0, 0, 3e-4 * 19])))


def test_a_fresh_hold_gives_a_sample_in_the_instant_in_which_it_is_taken():
    hold = FreshHold(10.0, 1)
    context = hold.CreateDefaultContext()
    hold.get_input_port().FixValue(context, [5.0])
    assert hold.get_output_port().Eval(context) == 5.0
    context.SetDiscreteState(hold.EvalUniquePeriodicDiscreteUpdate(context))
    hold.get_input_port().FixValue(context, [7.0])
    for time, value in ((1.0, 5.0), (9.999, 5.0), (10.0, 7.0), (30.000000001, 7.0)):
        context.SetTime(time)
        assert hold.get_output_port().Eval(context) == value


def test_reckoning_moves_on_with_the_velocity_of_the_sample():
    reckoning = Reckoning(10.0)
    context = reckoning.CreateDefaultContext()
    reckoning.get_input_port().FixValue(context, [1e5, 0.0, -5.0, 2.0, -1.0, 0.0])
    for time, since in ((0.0, 0.0), (3.0, 3.0), (10.0, 0.0), (29.999, 9.999), (30.000000001, 0.0)):
        context.SetTime(time)
        wanted = [1e5 + 2.0 * since, -since, -5.0]
        found = reckoning.get_output_port().Eval(context)
        np.testing.assert_allclose(found, wanted, rtol=0.0, atol=1e-7)


def test_the_given_force_is_the_mean_of_a_control_period_and_how_early_it_was():
    given_force = GivenForce(2.0, 5)
    context = given_force.CreateDefaultContext()
    forces = np.random.default_rng(1).normal(size=(11, 3))
    for k, force in enumerate(forces):
        context.SetTime(2.0 * k)
        if k in (5, 10):
            found = given_force.GetOutputPort("mean_force").Eval(context)
            np.testing.assert_allclose(found, forces[k - 5 : k].mean(axis=0))
            found = given_force.GetOutputPort("mean_thrust").Eval(context)
            np.testing.assert_allclose(found, k - 3.0)
            found = given_force.GetOutputPort("mean_apart").Eval(context)
            np.testing.assert_allclose(found, abs(forces[k - 5 : k]).mean(axis=0))
            # Of periods of 2 s, the middles of all five are so long before that of the whole.
            lead = 2.0 * np.array([4.0, 2.0, 0.0, -2.0, -4.0]) @ forces[k - 5 : k]
            np.testing.assert_allclose(given_force.GetOutputPort("force_lead").Eval(context), lead)
        given_force.GetInputPort("force").FixValue(context, force)
        given_force.GetInputPort("thrust").FixValue(context, [float(k)])
        given_force.GetInputPort("apart").FixValue(context, abs(force))
        context.SetDiscreteState(given_force.EvalUniquePeriodicDiscreteUpdate(context))
