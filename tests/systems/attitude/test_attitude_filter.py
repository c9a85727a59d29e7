"""Star tracker, gyro and the filter of both, against the truth that they measure."""

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from proxops.systems import AttitudeError
from proxops.systems.attitude import (
    AttitudeFilter,
    AttitudeNoise,
    Gyro,
    GyroConfig,
    InertialAttitude,
    StarTracker,
    StarTrackerConfig,
)
from proxops.systems.attitude.attitude_filter import (
    corrected_attitude,
    first_attitude,
    propagated,
    settled_noise,
)
from proxops.systems.vehicle import SpinKnowledge, TrueAttitudeConfig

TRACKER, GYRO = StarTrackerConfig(noise_deg=0.01), GyroConfig(noise_rad_s=1e-5, bias_rad_s=3e-5)
NOISE = AttitudeNoise.of(TRACKER, GYRO)


def rotation(quaternion):
    return Rotation.from_quat(quaternion, scalar_first=True)


def quaternion(turn):
    return turn.as_quat(canonical=True, scalar_first=True)


def evaluated(system, time, output=0, **inputs):
    context = system.CreateDefaultContext()
    context.SetTime(time)
    for name, value in inputs.items():
        system.GetInputPort(name).FixValue(context, value)
    return system.get_output_port(output).Eval(context)


def test_a_spacecraft_that_holds_to_its_star_tracker_is_turned_as_a_point_mass_is():
    """The point's `AttitudeError` says how S is turned against K by spin, pole, phase and mounting.

    A rigid spacecraft, turned so, must measure just the attitude that it wants: K as believed.
    """
    spin, believed, phase = (2e-6, -3e-6, 3.2e-4), 3.25e-4, 0.02
    spins, seed = SpinKnowledge(spin, believed, phase), 5
    mounting = TrueAttitudeConfig([0.2, -0.15, 0.1], 0.5, 900.0)
    error = AttitudeError(spins, mounting, period=1.0, seed=seed)
    tracker = StarTracker(StarTrackerConfig(noise_deg=0.0), 1.0, seed, mounting)
    for time in (0.0, 500.0, 4000.0):
        attitude = evaluated(error, time)
        inertial = evaluated(InertialAttitude(spins), time, attitude=attitude)
        measured = evaluated(tracker, time, attitude=inertial)
        wanted = Rotation.from_rotvec([0.0, 0.0, believed * time])
        assert (wanted.inv() * rotation(measured)).magnitude() < 1e-12


def test_sensors_have_the_noise_of_their_data_sheets():
    tracker, gyro = StarTracker(TRACKER, 1.0, 3), Gyro(GYRO, 1.0, 4)
    true = quaternion(Rotation.from_rotvec([0.3, 0.2, -0.5]))
    turns = [
        (rotation(true).inv() * rotation(evaluated(tracker, float(k), attitude=true))).as_rotvec()
        for k in range(1500)
    ]
    assert np.std(turns) == pytest.approx(math.radians(0.01), rel=0.05)
    rate = np.array([0.01, -0.02, 0.03])
    rates = np.array([evaluated(gyro, float(k), angular_velocity=rate) - rate for k in range(1500)])
    assert np.std(np.diff(rates, axis=0)) == pytest.approx(math.sqrt(2) * 1e-5, rel=0.05)
    assert 1e-6 < np.abs(rates.mean()) < 1e-4  # The bias.


@pytest.mark.parametrize("what", ["body", "Sun"])
def test_body_and_sun_blind_a_star_tracker_that_looks_at_them(what):
    """Which of them is at x, seen at an angle; the other is at y, and the tracker does not mind."""
    limit = {"blinded_within_deg" if what == "body" else "sun_within_deg": 20.0}
    tracker = StarTracker(StarTrackerConfig(boresight=[1.0, 0.0, 0.0], **limit), 1.0, 0)
    x, y = np.eye(3)[:2]
    place, sun = (-2e5 * x, y) if what == "body" else (-2e5 * y, x)
    for angle, blind in ((19.0, True), (21.0, False), (90.0, False), (180.0, False)):
        turn = Rotation.from_euler("z", -angle, degrees=True)
        found = evaluated(
            tracker, 0.0, attitude=np.array([1.0, 0, 0, 0]), body_attitude=quaternion(turn),
            position=place, sun_direction=sun,
        )  # fmt: skip
        assert np.isnan(found).all() == blind


def _run(seed, steps, blinded=()):
    """Flies a truth that turns, with sensors of these noises; errors and covariances by step."""
    rng = np.random.default_rng(seed)
    kept = math.exp(-1.0 / 3600.0)
    bias = NOISE.bias * rng.standard_normal(3)
    true = Rotation.from_rotvec(rng.normal(size=3))
    estimate = first_attitude(np.zeros(4), NOISE)
    last = before = np.zeros(3)
    errors = []
    for k in range(steps):
        rate = 0.003 * np.array([math.sin(0.02 * k), math.cos(0.03 * k), 0.5])
        measured = rate + bias + NOISE.gyro * rng.standard_normal(3)
        if k:
            # The truth turns by the mean of the rates at both ends, as the filter takes it.
            true = true * Rotation.from_rotvec(0.5 * (rate + before))
            estimate = propagated(estimate, 0.5 * (measured + last), 1.0, NOISE)
        seen = quaternion(true * Rotation.from_rotvec(NOISE.tracker * rng.standard_normal(3)))
        if not k:
            estimate = first_attitude(seen, NOISE)
        elif k not in blinded:
            estimate = corrected_attitude(estimate, seen, NOISE)
        wrong = (rotation(estimate.attitude).inv() * true).as_rotvec()
        errors.append((np.append(wrong, bias - estimate.bias), estimate.covariance))
        last, before = measured, rate
        bias = kept * bias + NOISE.bias * math.sqrt(1 - kept**2) * rng.standard_normal(3)
    return errors


def test_the_filter_knows_how_wrong_it_is():
    """NEES over 100 flights: attitude and bias, at a settled step, within the 99.9 % interval."""
    last = [_run(seed, 60)[-1] for seed in range(100)]
    nees = [error @ np.linalg.solve(covariance, error) for error, covariance in last]
    low, high = chi2.ppf([0.0005, 0.9995], 6 * 100) / 100
    assert low < np.mean(nees) < high


@pytest.mark.slow
def test_errors_that_are_alike_count_as_more_noise():
    """The mean of the errors at each tenth step, beside that of such a Gauss-Markov process."""
    means = []
    for seed in range(40):
        errors = np.array([error[:3] for error, _ in _run(1000 + seed, 400)[100::10]])
        means.append(math.sqrt(len(errors)) * errors.mean(axis=0))
    std, alike = settled_noise(NOISE, 1.0, 10)
    decay = math.exp(-10.0 / alike)
    white = std * math.sqrt((1.0 + decay) / (1.0 - decay))
    assert np.std(means) == pytest.approx(white, rel=0.2)


def test_it_goes_on_by_the_gyro_while_the_tracker_is_blinded():
    errors = _run(1, 400, blinded=range(200, 400))
    error, covariance = errors[-1]
    assert error[:3] @ np.linalg.solve(covariance[:3, :3], error[:3]) < chi2.ppf(0.9999, 3)
    assert np.trace(covariance[:3, :3]) > 4 * np.trace(errors[199][1][:3, :3])


def test_the_system_filters_as_the_functions_do():
    system = AttitudeFilter(NOISE, 3.0e-4, 1.0)
    context = system.CreateDefaultContext()
    tracker, gyro = StarTracker(TRACKER, 1.0, 7), Gyro(GYRO, 1.0, 8)
    still, rate = np.array([1.0, 0, 0, 0]), np.zeros(3)
    expected, last = None, None
    for k in range(5):
        time = float(k)
        seen = evaluated(tracker, time, attitude=still)
        measured = evaluated(gyro, time, angular_velocity=rate)
        system.GetInputPort("star_tracker").FixValue(context, seen)
        system.GetInputPort("gyro").FixValue(context, measured)
        context.SetTime(time)
        if expected is None:
            expected = first_attitude(seen, NOISE)
        else:
            expected = propagated(expected, 0.5 * (measured + last), 1.0, NOISE)
            expected = corrected_attitude(expected, seen, NOISE)
        last = measured
        np.testing.assert_array_equal(
            system.GetOutputPort("attitude").Eval(context), expected.attitude
        )
        np.testing.assert_array_equal(
            system.GetOutputPort("angular_velocity").Eval(context), measured - expected.bias
        )
        turned = rotation(system.GetOutputPort("body_attitude").Eval(context))
        wanted = Rotation.from_rotvec([0, 0, -3.0e-4 * time]) * rotation(expected.attitude)
        assert (turned.inv() * wanted).magnitude() < 1e-12
        context.SetDiscreteState(system.EvalUniquePeriodicDiscreteUpdate(context))
