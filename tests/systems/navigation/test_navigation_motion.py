"""Prediction of the estimate, against integration of the equations of motion by scipy.

Eq. 2 to 8 of docs/method/equations.md.
"""

import itertools
import math

import numpy as np
import pytest
import trimesh
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation
from short_flights import kleopatra

from proxops.systems.gravity import GravityField
from proxops.systems.navigation import Estimate, ExpectedErrors
from proxops.systems.navigation.estimate import (
    ATTITUDE,
    BASE,
    CENTRE_OF_MASS,
    CONSTANT_ACCELERATION,
    GRAVITY,
    POSITION,
    PROPELLANT,
    SIZE,
    SPIN,
    THRUST,
    THRUST_DIRECTION,
    TRACKER,
    VARYING_ACCELERATION,
    VELOCITY,
    first_estimate,
    first_sigmas,
)
from proxops.systems.navigation.motion import Motion, Push
from proxops.systems.shapes import Polyhedron
from proxops.systems.vehicle import SpinKnowledge, believed_axes

MASS, RATE, TAU = 1000.0, 3.24e-4, 600.0
FORCE = np.array([5.0, -3.0, 6.0])
PUSH = Push(FORCE, 23.0)  # More than that, of thrusters that are not along the axes.
NOTHING = Push(np.zeros(3), 0.0)
START = 1500.0
TURN = Rotation.from_rotvec([0.01, -0.02, 0.015])
MODES = 2


def motion(**expected: float) -> Motion:
    body = kleopatra()
    errors = ExpectedErrors(**{"acceleration_correlation_s": TAU} | expected)
    return Motion(body.gravity_field, body.shape.extents, RATE, MASS, errors)


def estimate() -> Estimate:
    """All parameters are wrong at once."""
    mean = np.zeros(BASE + MODES)
    mean[POSITION], mean[VELOCITY] = [120e3, 60e3, -50e3], [-20.0, 15.0, 8.0]
    mean[CONSTANT_ACCELERATION], mean[VARYING_ACCELERATION] = [1e-4, -2e-4, 3e-4], [5e-5, 4e-5, 0]
    mean[GRAVITY], mean[PROPELLANT], mean[SIZE] = 0.07, 4e-4, 0.04
    mean[SPIN] = RATE * np.array([0.004, -0.006, 1e-3])
    mean[CENTRE_OF_MASS] = [900.0, -500.0, 300.0]
    mean[THRUST], mean[THRUST_DIRECTION] = [0.05, -0.03, 0.02], [0.01, 0.02, -0.015]
    n = mean.size
    return Estimate(mean, TURN.as_matrix(), np.zeros((n, n)), spent=20.0)


def cross(v: np.ndarray) -> np.ndarray:
    return np.cross(v, np.eye(3)).T


def integrated(given: Estimate, duration: float) -> tuple[np.ndarray, np.ndarray]:
    """State (6,) and rotation (3, 3) by the equations in continuous time."""
    mean, body = given.mean, kleopatra()
    # A body of another size has the believed mass.
    shape = Polyhedron((1.0 + mean[SIZE]) * body.shape.vertices, body.shape.facets)
    field = GravityField(shape, mass=body.gravity_field.mass)
    spin = np.array([0.0, 0.0, RATE]) + mean[SPIN]
    thrust = (np.eye(3) + cross(mean[THRUST_DIRECTION])) @ np.diag(1.0 + mean[THRUST])

    def rates(time: float, y: np.ndarray) -> np.ndarray:
        r, v, attitude = y[:3], y[3:6], y[6:].reshape(3, 3)
        arm = r - mean[CENTRE_OF_MASS]
        spent = given.spent + PUSH.thrust / MASS * time
        mass = MASS * (1.0 - mean[PROPELLANT] * spent)
        acceleration = (
            (1.0 + mean[GRAVITY]) * field.evaluate(arm[None]).acceleration[0]
            - 2.0 * np.cross(spin, v)
            - np.cross(spin, np.cross(spin, arm))
            + attitude @ thrust @ FORCE / mass
            + mean[CONSTANT_ACCELERATION]
            + np.exp(-time / TAU) * mean[VARYING_ACCELERATION]
        )
        # The spacecraft follows a pole that stays where it is in inertial space.
        back = Rotation.from_euler("z", -RATE * (START + time))
        turned = cross(-back.apply(mean[SPIN])) @ attitude
        return np.concatenate([v, acceleration, turned.ravel()])

    start = np.concatenate([mean[:6], given.rotation.ravel()])
    flown = solve_ivp(rates, (0.0, duration), start, rtol=1e-11, atol=1e-9)
    return flown.y[:6, -1], flown.y[6:, -1].reshape(3, 3)


def stepped(given: Estimate, steps: int, predicts: Motion, push: Push = PUSH) -> Estimate:
    for k in range(steps):
        given = predicts.predicted(given, push, START + 10.0 * k, 10.0)
    return given


def test_the_mean_against_scipy() -> None:
    found = stepped(estimate(), 10, motion())
    state, rotation = integrated(estimate(), 100.0)
    assert np.linalg.norm(found.state[:3] - state[:3]) < 0.01
    assert np.linalg.norm(found.state[3:] - state[3:]) < 2e-4
    assert np.linalg.norm(found.rotation - rotation) < 1e-9
    assert found.spent == pytest.approx(20.0 + PUSH.thrust * 100.0 / MASS)


def test_constants_stay_and_what_varies_decays() -> None:
    given = estimate()
    given.mean[BASE:] = [0.3, -0.7]
    found = stepped(given, 10, motion()).mean
    decayed = np.exp(-100.0 / TAU) * given.mean[VARYING_ACCELERATION]
    np.testing.assert_allclose(found[VARYING_ACCELERATION], decayed, rtol=1e-12)
    same = np.r_[CONSTANT_ACCELERATION, GRAVITY : BASE + MODES]
    np.testing.assert_array_equal(found[same], given.mean[same])


def test_a_long_step_is_divided() -> None:
    """300 s at once: the body turns by 6 degrees."""
    found = motion().predicted(estimate(), PUSH, START, 300.0)
    state, rotation = integrated(estimate(), 300.0)
    assert np.linalg.norm(found.state[:3] - state[:3]) < 5.0
    assert np.linalg.norm(found.rotation - rotation) < 1e-7


def test_over_an_edge() -> None:
    """Close to the edge of a cube, where gravity changes least evenly."""
    corners = 1e3 * np.array(list(itertools.product([-1.0, 1.0], repeat=3)))
    cube = trimesh.convex.convex_hull(corners)
    shape = Polyhedron(np.asarray(cube.vertices), np.asarray(cube.faces))
    field = GravityField(shape, density=2000.0)
    mean = np.zeros(BASE)
    mean[:6] = [1030.0, 0.0, 1040.0, -1.0, 0.3, 0.2]
    given = Estimate(mean, np.eye(3), np.zeros((BASE, BASE)), spent=0.0)
    predicts = Motion(field, shape.extents, 0.0, MASS, ExpectedErrors())
    found = predicts.predicted(given, NOTHING, 0.0, 20.0).state[3:]

    def rates(_: float, y: np.ndarray) -> np.ndarray:
        return np.concatenate([y[3:], field.evaluate(y[None, :3]).acceleration[0]])

    right = solve_ivp(rates, (0.0, 20.0), mean[:6], rtol=1e-12, atol=1e-12).y[3:, -1]
    # With gravity in the middle of each step: 2e-5.
    assert np.linalg.norm(found - right) < 1e-6 * np.linalg.norm(right - mean[3:6])


# --- covariance -----------------------------------------------------------------------------------

# Of each quantity: a step over which the motion is close to linear.
SCALES = np.empty(BASE)
for where, scale in (
    (POSITION, 10.0), (VELOCITY, 0.1), (ATTITUDE, 1e-4), (CONSTANT_ACCELERATION, 1e-5),
    (VARYING_ACCELERATION, 1e-5), (GRAVITY, 1e-3), (SPIN, 1e-3 * RATE), (CENTRE_OF_MASS, 10.0),
    (THRUST, 1e-3), (THRUST_DIRECTION, 1e-3), (PROPELLANT, 1e-5), (slice(29, BASE), 1e-3),
):  # fmt: skip
    SCALES[where] = scale


def changed(given: Estimate, index: int, by: float) -> Estimate:
    if 6 <= index < 9:
        turn = Rotation.from_rotvec(by * np.eye(3)[index - 6])
        return given._replace(rotation=turn.as_matrix() @ given.rotation)
    mean = given.mean.copy()
    mean[index] += by
    return given._replace(mean=mean)


def transition(given: Estimate, steps: int) -> np.ndarray:
    """Derivatives (n, BASE) of the predicted mean, by central differences."""
    columns = []
    for index, scale in enumerate(SCALES):
        after, before = (
            stepped(changed(given, index, by), steps, motion()) for by in (scale, -scale)
        )
        column = after.mean - before.mean
        turn = Rotation.from_matrix(after.rotation @ before.rotation.T)
        column[ATTITUDE] = turn.as_rotvec()
        columns.append(column / (2.0 * scale))
    return np.stack(columns, axis=1)


@pytest.mark.parametrize("steps", [1, 10])
def test_each_column_of_the_transition_against_differences(steps: int) -> None:
    """A covariance of one quantity alone becomes the outer product of its column."""
    expected = transition(estimate(), steps)
    sizes = np.array([1.0] * 3 + [0.1] * 3 + [1e-3] * 3)  # For what is next to 0.
    for index in range(BASE):
        given = estimate()
        given.covariance[index, index] = SCALES[index] ** 2
        found = stepped(given, steps, motion()).covariance
        column = expected[:, index] * SCALES[index]
        np.testing.assert_allclose(np.diag(found)[9:], column[9:] ** 2, rtol=1e-6, atol=1e-18)
        sigma = np.abs(column[:9])
        tolerance = 5e-3 * sigma.reshape(3, 3).max(axis=1).repeat(3) + 1e-6 * sizes
        error = np.abs(np.sqrt(np.diag(found)[:9]) - sigma)
        assert (error < tolerance).all(), (index, error, tolerance)


def test_a_full_covariance_against_differences() -> None:
    rng = np.random.default_rng(1)
    given = estimate()
    n = given.mean.size
    scales = np.concatenate([SCALES, np.ones(MODES)])
    root = scales[:, None] * rng.normal(size=(n, n))
    f = np.eye(n)
    f[:, :BASE] = transition(given, 5)
    found = stepped(given._replace(covariance=root @ root.T), 5, motion()).covariance
    expected = f @ root @ root.T @ f.T
    sigma = np.sqrt(np.diag(expected))
    np.testing.assert_allclose(found / np.outer(sigma, sigma), expected / np.outer(sigma, sigma),
                               atol=3e-3)  # fmt: skip
    np.testing.assert_array_equal(found, found.T)


def test_what_varies_reaches_its_variance() -> None:
    """The first-order Gauss-Markov process is stationary, whatever the step is."""
    predicts = motion(
        acceleration_varying_m_s2=2e-4,
        attitude_varying_deg=math.degrees(1e-4),
        attitude_correlation_s=900.0,
    )
    given = estimate()
    for where in (12, 13, 14):
        given.covariance[where, where] = (2e-4) ** 2
    found = stepped(given, 20, predicts).covariance
    np.testing.assert_allclose(np.sqrt(np.diag(found)[VARYING_ACCELERATION]), 2e-4, rtol=1e-9)
    # A random walk of the attitude, which moves as fast as the process over short times.
    walked = np.sqrt(2.0 * (1e-4) ** 2 * 200.0 / 900.0)
    np.testing.assert_allclose(np.sqrt(np.diag(found)[ATTITUDE]), walked, rtol=1e-9)
    # What is not disturbed stays known.
    assert not np.diag(found)[GRAVITY:].any()


def test_the_noise_of_the_star_tracker_does_not_add_up() -> None:
    """An attitude that is known but for it stays as uncertain, and forgets how it was off."""
    predicts = motion(attitude_noise_deg=math.degrees(1e-4), attitude_noise_correlation_s=30.0)
    given = first_estimate(np.array([200e3, 0.0, 0.0]), np.eye(3), first_sigmas(
        ExpectedErrors(attitude_deg=0.0, attitude_noise_deg=math.degrees(1e-4)),
        np.zeros(3), MODES, 0.0, 0.0,
    ))  # fmt: skip
    given.mean[TRACKER] = [2e-4, -1e-4, 3e-4]
    found = stepped(given, 9, predicts)
    for part in (ATTITUDE, TRACKER):
        np.testing.assert_allclose(np.sqrt(np.diag(found.covariance)[part]), 1e-4, rtol=1e-9)
    np.testing.assert_allclose(found.mean[TRACKER], math.exp(-3.0) * given.mean[TRACKER])
    turned = Rotation.from_matrix(found.rotation).as_rotvec()
    np.testing.assert_allclose(turned, (math.exp(-3.0) - 1.0) * given.mean[TRACKER], rtol=1e-3)


def test_when_in_a_period_the_force_acted() -> None:
    """Two halves with forces of their own, beside their mean and how early it acted."""
    halves = FORCE + np.array([[4.0, 2.0, -1.0], [-4.0, -2.0, 1.0]])
    predicts, right = motion(), estimate()
    for k, force in enumerate(halves):
        push = PUSH._replace(force=force)
        right = predicts.predicted(right, push, START + 10.0 * k, 10.0)
    lead = 10.0**2 * 0.5 * (halves[0] - halves[1])
    mean = predicts.predicted(estimate(), PUSH, START, 20.0)
    found = predicts.predicted(estimate(), PUSH._replace(lead=lead), START, 20.0)
    for part, share in ((POSITION, 0.1), (VELOCITY, 0.2)):
        before = np.linalg.norm(mean.mean[part] - right.mean[part])
        assert np.linalg.norm(found.mean[part] - right.mean[part]) < share * before


def test_a_white_push_moves_as_known() -> None:
    """By hand, without a body's turn: a process of short memory is a random walk of velocity."""
    far = estimate()
    far.mean[:] = 0.0
    far.mean[POSITION] = [5e8, 0.0, 0.0]
    errors = ExpectedErrors(acceleration_varying_m_s2=1e-3, acceleration_correlation_s=2.0)
    predicts = Motion(kleopatra().gravity_field, kleopatra().shape.extents, 0.0, MASS, errors)
    time = 0.0
    for _ in range(1000):
        far = predicts.predicted(far, NOTHING, time, 0.5)
        time += 0.5
    grown = np.sqrt(2.0 * 2.0 * 500.0) * 1e-3
    assert np.sqrt(far.covariance[4, 4]) == pytest.approx(grown, rel=0.02)
    assert np.sqrt(far.covariance[1, 1]) == pytest.approx(grown * 500.0 / np.sqrt(3.0), rel=0.02)


# --- attitude -------------------------------------------------------------------------------------


@pytest.mark.parametrize("phase", [0.0, 0.03])
def test_attitude_drifts_as_the_vehicle_s(phase: float) -> None:
    """With an error of pole and rate, for an hour: second order in them is left."""
    wrong = RATE * np.array([8e-4, -5e-4, 2e-4])
    true = np.array([0.0, 0.0, RATE]) + wrong

    def truth(time: float) -> Rotation:
        axes = believed_axes(time, SpinKnowledge(tuple(true), RATE, phase))
        return Rotation.from_quat(axes, scalar_first=True)

    mean = np.zeros(BASE)
    mean[POSITION], mean[SPIN] = [400e3, 0.0, 0.0], wrong
    found = Estimate(mean, truth(0.0).as_matrix(), np.zeros((BASE, BASE)))
    for k in range(360):
        found = motion().predicted(found, NOTHING, 10.0 * k, 10.0)
    drifted = (truth(3600.0) * truth(0.0).inv()).magnitude()
    off = (Rotation.from_matrix(found.rotation) * truth(3600.0).inv()).magnitude()
    assert drifted > 1e-3
    assert off < 1e-3 * drifted


def test_what_varies_in_the_thrust_is_noise_while_it_pushes() -> None:
    found = stepped(estimate(), 5, motion(thrust_varying=0.01)).covariance
    size = 0.01 * float(np.linalg.norm(FORCE)) / MASS
    as_much = stepped(estimate(), 5, motion(acceleration_varying_m_s2=size)).covariance
    np.testing.assert_allclose(found, as_much, rtol=1e-12)
    assert found[3, 3] > 0.0


def test_each_thrusters_own_errors_are_noise_as_they_share_the_force() -> None:
    """Against forces of thrusters with errors that are drawn."""
    rng = np.random.default_rng(3)
    thrusters = rng.normal(size=(5, 3))  # Forces in N.
    sizes = np.linalg.norm(thrusters, axis=1)
    total, apart = thrusters.sum(axis=0), np.sqrt((thrusters**2).sum(axis=0))
    push = Push(total, float(sizes.sum()), apart)
    errors = {"thruster": 0.02, "thruster_direction_deg": 0.5}
    predicts = motion(acceleration_correlation_s=1e-2, **errors)  # All of it is there at once.
    known = estimate()._replace(covariance=np.zeros_like(estimate().covariance))
    found = predicts.predicted(known, push, START, 1.0).covariance
    draws = 40_000
    scale = 1.0 + 0.02 * rng.normal(size=(draws, 5, 1))
    turned = np.radians(0.5) * rng.normal(size=(draws, 5, 3))
    given = (scale * thrusters + np.cross(turned, thrusters)).sum(axis=1)
    of_force = np.diag(found)[VARYING_ACCELERATION] * MASS**2
    np.testing.assert_allclose(of_force, given.var(axis=0), rtol=0.05)


def test_uneven_density_is_in_the_covariance() -> None:
    """Halves of different density move the centre of mass; the rest of their gravity is noise."""
    body, contrast = kleopatra(), 0.05
    uneven = GravityField(body.shape, mass=body.gravity_field.mass, contrast=contrast)
    shift = float(np.linalg.norm(uneven.centre_of_mass))
    directions = np.random.default_rng(1).normal(size=(300, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    for scale in (1.0, 1.5, 2.5):
        points = scale * directions * body.keep_out_semi_axes
        left = uneven.evaluate(points).acceleration
        left -= body.gravity_field.evaluate(points - uneven.centre_of_mass).acceleration
        predicted = []
        for point in points[:30]:
            known = estimate()
            known.mean[:] = 0.0
            known.mean[POSITION] = point
            known.covariance[:] = 0.0
            # Over a time much longer than the correlation all of it is there.
            moved = motion(centre_of_mass_m=shift)
            noise = moved.predicted(known, NOTHING, START, 1.0).covariance
            predicted.append(noise[12, 12] / (1.0 - np.exp(-2.0 / TAU)))
        ratio = np.sqrt(np.mean(left**2) / np.mean(predicted))
        assert 0.4 < ratio < 1.3, (scale, ratio)
