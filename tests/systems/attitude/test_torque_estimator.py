"""The estimate of thrusters' torques and the search for one that has failed."""

import typing

import numpy as np
import pytest

from proxops.diagrams.scenario import load_spacecraft
from proxops.systems import ThrusterErrors
from proxops.systems.attitude import TorqueEstimator, TrueRigidBodyConfig, WheelArray, true_layout
from proxops.systems.attitude.torque_estimator import CENTRE, TORQUE

MODEL = load_spacecraft("smallsat_16")
NOMINAL, WHEELS = MODEL.thrusters, typing.cast(WheelArray, MODEL.wheels)
GYRO = 1e-5


def estimated(steps, seed, lost=None, at=0, truth=None):
    """Runs the system on rates that follow from Euler's equations; yields it and its Context.

    Args:
      steps: number of attitude steps of 1 s. seed: of thrusters, pulses and noise.
      lost: a thruster that gives nothing from step `at` on. truth: of the spacecraft.
    """
    rng = np.random.default_rng(seed)
    truth = truth or TrueRigidBodyConfig(
        centre_of_mass_m=rng.uniform(-0.02, 0.02, 3).tolist(),
        thruster_scale_std=0.02,
        thruster_direction_std_deg=0.3,
        thruster_place_std_m=0.003,
    )
    wrenches = true_layout(NOMINAL, truth, ThrusterErrors(), seed).wrenches()
    disturbance = np.array([1e-4, -2e-4, 5e-5])
    inertia, axes = MODEL.inertia, WHEELS.axes
    system = TorqueEstimator(NOMINAL, inertia, 1.0, GYRO, axes)
    context = system.CreateDefaultContext()
    rate, on, motors = np.array([1e-4, -2e-4, 3e-4]), np.zeros(16), np.zeros(4)
    for step in range(steps):
        for name, value in (
            ("angular_velocity", rate + GYRO * rng.standard_normal(3)),
            ("on_times", on),
            ("wheel_torque", motors),
            ("wheel_momentum", 0.5 * motors),  # None in the middle of the period.
        ):
            system.GetInputPort(name).FixValue(context, value)
        context.SetTime(float(step))
        context.SetDiscreteState(system.EvalUniquePeriodicDiscreteUpdate(context))
        yield system, context, wrenches
        # The next period: some thrusters fire, and wheels leave just a small turn of that.
        on = np.where(rng.random(16) < 0.3, rng.uniform(0.02, 1.0, 16), 0.0)
        working = on * (np.arange(16) != lost) if step >= at else on
        torque = wrenches[3:] @ working + disturbance
        before, rate = rate, rng.uniform(-1e-3, 1e-3, 3)
        mean = 0.5 * (rate + before)
        turning = inertia @ (rate - before) + np.cross(mean, inertia @ mean)
        motors = axes @ np.linalg.solve(axes.T @ axes, torque - turning)


def last(*args, **options):
    *_, end = estimated(*args, **options)
    return end


def test_it_learns_the_torque_of_each_thruster():
    system, context, wrenches = last(600, 1)
    torques = system.GetOutputPort("thruster_torques").Eval(context).reshape(3, 16)
    before = np.abs(NOMINAL.wrenches()[3:] - wrenches[3:]).max()
    assert before > 0.1
    assert np.abs(torques - wrenches[3:]).max() < 0.05 * before
    disturbing = system.GetOutputPort("torque").Eval(context)
    np.testing.assert_allclose(disturbing, [1e-4, -2e-4, 5e-5], atol=2e-4)


def test_it_finds_the_centre_of_mass_if_thrusters_are_as_on_their_data_sheet():
    centre = [0.012, -0.008, 0.015]
    system, context, _ = last(300, 2, truth=TrueRigidBodyConfig(centre_of_mass_m=centre))
    estimate = system.estimate(context)
    np.testing.assert_allclose(
        system.GetOutputPort("centre_of_mass").Eval(context), centre, atol=5e-3
    )
    for part in (CENTRE, TORQUE):
        sigma = np.sqrt(np.diag(estimate.covariance)[part])
        true = centre if part == CENTRE else [1e-4, -2e-4, 5e-5]
        assert (np.abs(estimate.mean[part] - true) < 4 * sigma).all()


@pytest.mark.parametrize("lost", [0, 5, 11, 15])
def test_a_thruster_that_fails_is_found_soon_after_it_should_have_fired(lost):
    found = [
        system.GetOutputPort("failed").Eval(context)
        for system, context, _ in estimated(430, 3 + lost, lost=lost, at=400)
    ]
    assert not np.any(found[:400])
    assert np.flatnonzero(found[-1]).tolist() == [lost]
    # It fires in three of ten periods.
    assert np.argmax(np.array(found)[:, lost]) < 420


def test_no_thruster_that_works_is_taken_for_one_that_has_failed():
    for seed in range(20, 24):
        system, context, _ = last(400, seed)
        assert not system.GetOutputPort("failed").Eval(context).any()
