"""Burns in a survey: kinks of its path, and the errors of small surveys beside their sigma."""

import dataclasses as dc
from collections.abc import Sequence

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from proxops.systems.gravity import GRAVITATIONAL_CONSTANT, MoonConfig, moon_position, tide_of
from proxops.systems.mapping.mass_points import MassPoints
from proxops.systems.mapping.path import Path
from proxops.systems.mapping.returns import Returns
from proxops.systems.mapping.spheres import sphere
from proxops.systems.mapping.survey_fit import (
    GRAVITY,
    RATE,
    ROTATION,
    TAIL,
    TAIL_OF_TUMBLING,
    Expected,
    Survey,
    Tumbling,
    Weighting,
    improved,
)
from proxops.systems.rotation import SpinModel, SteadySpin, TorqueFreeSpin
from proxops.systems.shapes import Polyhedron, ray_caster

AXES = np.array([100.0, 70.0, 55.0])
GM, RADIUS, SPIN, END, PERIOD, SPACING = 2.0, 260.0, 3e-4, 36_000.0, 200.0, 600.0
STILL, STEADY = SteadySpin(np.zeros(3)), SteadySpin([0.0, 0.0, SPIN])
# Of a uniform ellipsoid, up to a factor.
TUMBLING = TorqueFreeSpin(
    np.diag((AXES**2).sum() - AXES**2), SPIN * np.array([0.8, 0.3, np.sqrt(0.27)])
)
BURN, KICK = 90, np.array([0.004, -0.006, 0.005])
EXPECTED = Expected(
    noise=0.05, bias=0.0, scale=0.0, mounting=1e-3, turning=1e-9, turning_time=1e5, pole=0.01,
    rate=1e-4, acceleration=1e-8, varying=3e-9, varying_time=SPACING, thrust=0.03,
)  # fmt: skip
# By how much an angular velocity is off at first.
OFF = 1.0001 * Rotation.from_rotvec([0.005, -0.005, 0.005]).as_matrix()


def test_a_path_follows_kinks_and_is_smooth_elsewhere() -> None:
    kinks = np.array([333.0, 700.0])
    path, times = Path.between(0.0, 1000.0, 100.0, kinks), np.linspace(0.0, 1000.0, 501)
    wanted = np.maximum(times - 333.0, 0.0) - 3.0 * np.maximum(times - 700.0, 0.0)
    coefficients = np.linalg.lstsq(path.matrix(times), wanted, rcond=None)[0]
    np.testing.assert_allclose(path.matrix(times) @ coefficients, wanted, atol=1e-9)
    np.testing.assert_allclose(path.jumps @ coefficients, [1.0, -3.0], atol=1e-9)
    assert path.steps.sum() == pytest.approx(1000.0)
    basis = path.basis(times)
    own = coefficients[basis.first[:, None] + np.arange(6)]
    np.testing.assert_allclose((basis.values * own).sum(axis=1), wanted, atol=1e-9)
    assert Path.between(0.0, 1000.0, 100.0).jumps.shape == (0, 15)


def test_burns_are_cut_where_they_last() -> None:
    times, thrusts = np.arange(0.0, 200.0, 10.0), np.zeros((20, 3))
    thrusts[[2, 3, 10, 11, 12, 13], 1] = [0.1, 0.3, 0.2, 0.2, 0.2, 0.2]
    no = np.zeros(0)
    returns = Returns(times, np.tile(np.eye(3), (20, 1, 1)), thrusts, no, thrusts[:0], no)
    burns = returns.burns(25.0)
    np.testing.assert_allclose(burns.times, [32.5, 115.0, 135.0])
    np.testing.assert_allclose(burns.kicks, [4.0, 6.0, 2.0])
    np.testing.assert_allclose(burns.within(40.0, 120.0).times, [115.0])


def flown(moving, start: float, end: float, state: np.ndarray, times: np.ndarray) -> np.ndarray:
    """States (T + 1, 6) at times (T,) in s, and at the end."""
    wanted = np.r_[times, end]
    found = solve_ivp(
        moving, (start, end), state, "DOP853", dense_output=True, rtol=1e-9, atol=1e-6
    )
    return found.sol(wanted).T


def small_survey(
    seed: int, moons: Sequence[MoonConfig] = (), spin: SpinModel = STEADY
) -> tuple[Returns, np.ndarray]:
    """Returns of an ellipsoid with flat facets, from an orbit with a burn that is 3 % off (1 σ)."""
    random, ball = np.random.default_rng(seed), sphere(3)
    shape = Polyhedron(ball.vertices * AXES, ball.facets, "ellipsoid")
    masses = MassPoints.of(shape.vertices, shape.facets)

    def moving(time: float, state: np.ndarray) -> np.ndarray:
        turn = Rotation.from_quat(spin.attitude(time), scalar_first=True)
        pull = masses.pull(turn.inv().apply(state[:3])[None])[0][0]
        acceleration = GM * turn.apply(pull)
        for moon in moons:
            acceleration += tide_of(moon.mass_kg, moon_position(moon, time, STILL), state[:3])
        return np.r_[state[3:], acceleration]

    times = np.arange(0.0, END + 1.0, PERIOD)
    speed = np.sqrt(GM / RADIUS)
    state = np.array([RADIUS, 0.0, 0.0, 0.0, 0.3 * speed, 0.95 * speed])
    middle = times[BURN] + 0.5 * PERIOD
    before = flown(moving, 0.0, middle, state, times[: BURN + 1])
    before[-1, 3:] += KICK * (1.0 + 0.03 * random.standard_normal(3))
    after = flown(moving, middle, END, before[-1], times[BURN + 1 :])
    places = np.vstack([before[:-1, :3], after[:-1, :3]])
    directions, ranges, owners = [], [], []
    turned = [spin.attitude(time) for time in times.tolist()]
    attitudes = Rotation.from_quat(turned, scalar_first=True)
    for k, place in enumerate(places):
        start = attitudes[k].inv().apply(place)
        ray = random.uniform(-1.0, 1.0, (40, 3)) * AXES - start
        ray /= np.linalg.norm(ray, axis=1, keepdims=True)
        hits = ray_caster(shape).first_hits(start, ray)
        met = hits.facets >= 0
        directions.append(ray[met])
        ranges.append(hits.distances[met] + 0.05 * random.standard_normal(met.sum()))
        owners.append(np.full(met.sum(), k))
    thrusts = np.zeros((len(times), 3))
    thrusts[BURN] = KICK / PERIOD
    returns = Returns(
        times, attitudes.as_matrix(), thrusts, np.concatenate(owners), np.concatenate(directions),
        np.concatenate(ranges),
    )  # fmt: skip
    return returns, places


def errors_of(
    seed: int, moons: Sequence[MoonConfig] = (), believed: Sequence[MoonConfig] = (),
    spin: SpinModel = STEADY,
) -> np.ndarray:  # fmt: skip
    """Errors (3,) of pole and rate, or angular velocity, over their standard deviations."""
    returns, places = small_survey(seed, moons, spin)
    burns = returns.burns(0.25 * SPACING).within(0.0, END)
    path, ball = Path.between(0.0, END, SPACING, burns.times), sphere(3)
    tail = np.zeros(TAIL if spin is STEADY else TAIL_OF_TUMBLING)
    tail[RATE], tail[GRAVITY] = SPIN, GM
    tumbling, begun = None, tail.copy()
    if isinstance(spin, TorqueFreeSpin):
        tail[ROTATION], tumbling = spin.rate, Tumbling(np.eye(3), spin.inertia)
        begun[ROTATION] = OFF @ spin.rate
    survey = Survey(
        path, np.zeros((path.size, 3)), (returns.times, returns.driven), np.zeros((2, 3)),
        np.array([0.0, END]), begun, 0.0, 0.0, ball.vertices * AXES, ball.facets, burns.kicks,
        believed, tumbling,
    )  # fmt: skip
    value, free = path.matrix(returns.times), places - survey.moved(returns.times)
    start = np.linalg.lstsq(np.vstack([value, 1e-3 * np.eye(path.size)]),
                            np.vstack([free, np.zeros((path.size, 3))]), rcond=None)[0]  # fmt: skip
    survey = prior = dc.replace(survey, coefficients=start)
    weighting = Weighting(surface=0.01, roughness=0.3, free=True, slide=1.0)
    survey, solution = improved(survey, returns, prior, EXPECTED, weighting)
    for _ in range(2 if tumbling is None else 5):
        survey, solution = improved(survey, returns, prior, EXPECTED, weighting)
    deviations = np.sqrt(np.diag(solution.covariance)[-len(tail) :])
    return ((survey.tail - tail) / deviations)[ROTATION]


def test_a_burn_that_is_off_moves_no_pole() -> None:
    """Over surveys, errors are as large as their standard deviations say."""
    errors = np.array([errors_of(seed) for seed in range(2)])
    assert np.sqrt(np.mean(errors**2, axis=0)).max() < 2.0


def test_a_moon_that_is_believed_moves_no_pole() -> None:
    """One of a hundredth of the body's mass, at twice the distance of the orbit."""
    moon = [MoonConfig(0.01 * GM / GRAVITATIONAL_CONSTANT, 10.0, 520.0, 53_000.0)]
    assert np.abs(errors_of(3, moon, moon)).max() < 3.0
    assert np.abs(errors_of(3, moon)).max() > 5.0


def test_the_rotation_of_a_body_that_tumbles_is_found() -> None:
    """In 1.7 turns, from one that is off by half a degree and a ten-thousandth."""
    errors = np.array([errors_of(seed, spin=TUMBLING) for seed in range(2)])
    assert np.sqrt(np.mean(errors**2, axis=0)).max() < 2.0
