"""The parts of the batch estimator beside closed forms."""

import math

import numpy as np
import pytest

from proxops.systems.common import InputError
from proxops.systems.gravity import GravityField
from proxops.systems.mapping.first_orbit import densest, middle_of, unseen
from proxops.systems.mapping.free_surface import free_surface, oriented
from proxops.systems.mapping.mass_points import MassPoints
from proxops.systems.mapping.path import Path
from proxops.systems.mapping.returns import Returns
from proxops.systems.mapping.spheres import sphere
from proxops.systems.mapping.survey_controller import _ends, orbit_normal, wanted_velocity
from proxops.systems.mapping.survey_filter import (
    CONSTANT,
    GM,
    PLACE,
    STATES,
    VELOCITY,
    Around,
    corrected,
    first_seen,
    predicted,
)
from proxops.systems.shapes import Polyhedron, find_defects


def test_mass_points_pull_as_the_polyhedron_does() -> None:
    ball = sphere(2)
    shape = Polyhedron(ball.vertices * [1000.0, 400.0, 400.0], ball.facets)
    random = np.random.default_rng(1)
    points = random.standard_normal((20, 3))
    points *= 2500.0 / np.linalg.norm(points, axis=1, keepdims=True)
    pull, gradient = MassPoints.of(shape.vertices, shape.facets).pull(points)
    mass = 2000.0 * shape.volume
    field = GravityField(shape, mass=mass).evaluate(points)
    exact = field.acceleration / (mass * 6.6743e-11)
    np.testing.assert_allclose(pull, exact, atol=2e-3 * np.abs(exact).max())
    for axis in range(3):
        step = np.zeros(3)
        step[axis] = 1.0
        masses = MassPoints.of(shape.vertices, shape.facets)
        slope = (masses.pull(points + step)[0] - masses.pull(points - step)[0]) / 2.0
        scale = np.abs(slope).max()
        np.testing.assert_allclose(gradient[:, :, axis], slope, atol=1e-4 * scale)


def test_the_centre_of_mass_is_the_origin_of_a_shifted_mesh() -> None:
    ball = sphere(3)
    masses = MassPoints.of(ball.vertices + [0.1, 0.05, -0.02], ball.facets)
    np.testing.assert_allclose(masses.shares @ masses.places, 0.0, atol=1e-12)
    assert masses.shares.sum() == pytest.approx(1.0)


def test_a_path_is_exact_for_polynomials_of_its_degree() -> None:
    path, times = Path.between(10.0, 500.0, 60.0), np.linspace(10.0, 500.0, 200)
    wanted = 1e-6 * (times - 200.0) ** 4
    fit = np.linalg.lstsq(path.matrix(times), wanted, rcond=None)[0]
    np.testing.assert_allclose(path.matrix(times) @ fit, wanted, rtol=1e-7, atol=1e-7)
    second = path.matrix(times, 2) @ fit
    np.testing.assert_allclose(second, 12e-6 * (times - 200.0) ** 2, rtol=1e-5, atol=1e-8)
    basis = path.basis(times)
    dense = path.matrix(times)
    for k in (0, 77, 199):
        assert dense[k, basis.first[k] : basis.first[k] + 6] == pytest.approx(basis.values[k])


def dumbbell(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Points on two balls that overlap, and their normals: seen from one, the other is hidden."""
    random = np.random.default_rng(3)
    normals = random.standard_normal((count, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    side = np.where(random.random(count) < 0.5, 1.0, -1.0)
    points = normals + side[:, None] * [0.9, 0.0, 0.0]
    outside = np.linalg.norm(points + side[:, None] * [0.9, 0.0, 0.0], axis=1) > 1.0
    return points[outside], normals[outside]


def test_a_free_surface_closes_about_two_balls() -> None:
    points, normals = dumbbell(30_000)
    surface = oriented(points, -normals)
    assert np.mean(np.einsum("ki,ki->k", surface.normals, normals) > 0.9) > 0.97
    mesh = free_surface(surface, float(surface.areas.sum()), 4000)
    assert not find_defects(mesh.vertices, mesh.facets)
    shape = Polyhedron(mesh.vertices, mesh.facets)
    # Two balls less their lens, of the height 0.1 on each side.
    cap = np.pi * 0.1**2 * (3.0 - 0.1) / 3.0
    assert shape.volume == pytest.approx(2.0 * (4.0 / 3.0 * np.pi - cap), rel=0.02)


def test_half_of_a_ball_shows_no_closed_surface() -> None:
    points, normals = dumbbell(4000)
    half = points[:, 1] > 0.6
    surface = oriented(points[half], normals[half])  # As if seen from within.
    with pytest.raises(InputError, match="no closed surface"):
        free_surface(surface, 10.0, 500)


def test_what_thrust_moves() -> None:
    times = np.arange(0.0, 100.0, 10.0)
    thrusts = np.zeros((10, 3))
    thrusts[2, 0] = 0.5  # m/s^2 from 20 to 30 s.
    no = np.zeros(0)
    returns = Returns(times, np.tile(np.eye(3), (10, 1, 1)), thrusts, no, thrusts[:0], no)
    wanted = np.where(times <= 20.0, 0.0, 25.0 + 5.0 * (times - 30.0))
    np.testing.assert_allclose(returns.driven[:, 0], wanted)


def test_false_returns_are_not_of_the_body() -> None:
    random = np.random.default_rng(4)
    body = random.standard_normal((30, 3)) * 20.0 + [1000.0, 0.0, 0.0]
    false = random.uniform(-2000.0, 2000.0, (15, 3))
    chosen = densest(np.vstack([body, false]), 60.0)
    assert chosen[:30].all()
    assert not chosen[30:].any()
    # Where no ray meets the body, some false returns are always nearest to each other.
    assert not densest(false, 60.0).any()
    assert not densest(np.vstack([false, body[:4]]), 60.0).any()


@pytest.mark.parametrize("far", [4.0, 40.0])
def test_the_middle_of_an_ellipsoid(far: float) -> None:
    random, axes = np.random.default_rng(5), np.array([1.0, 0.5, 0.4])
    place = far * np.array([0.6, -0.64, 0.48])
    aim = random.uniform(-1.0, 1.0, (4000, 3))
    ray = (aim - place) / np.linalg.norm(aim - place, axis=1, keepdims=True)
    a, b = ((ray / axes) ** 2).sum(axis=1), (ray * place / axes**2).sum(axis=1)
    root = b**2 - a * (((place / axes) ** 2).sum() - 1.0)
    met = root > 0.0
    rays = ((-b[met] - np.sqrt(root[met])) / a[met])[:, None] * ray[met]
    found = middle_of(rays, axes, np.eye(3))
    # Nearness, by which more of the near side is seen, is taken out for a part.
    np.testing.assert_allclose(found, place, atol=0.02 + 0.25 / far)


ALL_SEEN = np.zeros((3, 3))
AROUND = Around(np.ones(3), 1.0, 0.1, 0.5, 2.6, 1.1, 1e-3, 1e-4, 5.0)


def test_a_prediction_is_an_integration_and_its_covariance_its_derivatives() -> None:
    flown = first_seen(AROUND, np.array([3.0, 1.0, 0.5]), ALL_SEEN)
    mean = flown.mean.copy()
    mean[VELOCITY], mean[CONSTANT] = [0.1, 0.4, -0.2], [1e-3, 2e-3, -1e-3]
    flown, period = flown._replace(mean=mean), 0.02
    after = predicted(flown, AROUND, 1.0, np.zeros(3), period)
    state, fine = np.r_[mean[PLACE], mean[VELOCITY]], period / 100
    for k in range(100):
        push = AROUND.turn(1.0 + k * fine) @ mean[CONSTANT]
        middle = state[:3] + 0.5 * fine * state[3:]
        pull = -middle / np.linalg.norm(middle) ** 3 + push
        state = np.r_[state[:3] + fine * state[3:], state[3:] + fine * pull]
    np.testing.assert_allclose(after.mean[:6], state, atol=1e-5)
    # The covariance moves as differences of means do, but for what is noise.
    for some in (PLACE, VELOCITY, GM, CONSTANT):
        for i in range(some.start, some.stop):
            step = np.zeros(STATES)
            step[i] = 1e-4
            either = [
                predicted(flown._replace(mean=mean + s * step), AROUND, 1.0, np.zeros(3), period)
                for s in (1.0, -1.0)
            ]
            column = (either[0].mean - either[1].mean) / 2e-4
            one = flown._replace(covariance=np.outer(step, step) * 1e8)
            many = predicted(one, AROUND, 1.0, np.zeros(3), period).covariance
            none = predicted(
                flown._replace(covariance=np.zeros((STATES, STATES))), AROUND, 1.0, np.zeros(3),
                period,
            ).covariance  # fmt: skip
            np.testing.assert_allclose(many - none, np.outer(column, column), atol=2e-3)


def test_the_filter_finds_the_velocity_and_is_sure_of_no_more() -> None:
    random, period = np.random.default_rng(6), 0.05
    place, velocity = np.array([6.0, 0.0, 1.0]), np.array([-0.2, 0.3, 0.1])
    flown = first_seen(AROUND, place, ALL_SEEN)
    for k in range(200):
        middle = place + 0.1 * random.standard_normal(3)
        flown = corrected(flown, AROUND, middle, 30, ALL_SEEN)
        flown = predicted(flown, AROUND, k * period, np.zeros(3), period)
        for _ in range(10):
            place = place + 0.1 * period * velocity
            velocity = velocity - 0.1 * period * place / np.linalg.norm(place) ** 3
    assert np.linalg.norm(flown.mean[VELOCITY] - velocity) < 3.0 * flown.unsure < 0.3


def test_what_rays_show_of_a_middle() -> None:
    """A single plane says nothing across it, a dense bundle all; nothing is said of the distance,
    which is not in question."""
    angles = np.radians(np.arange(-180.0, 180.0, 0.5))
    plane = np.stack([np.cos(angles), np.sin(angles), np.zeros_like(angles)], axis=1)
    place = np.array([-10.0, 0.0, 0.0])
    np.testing.assert_allclose(unseen(plane, place, 1.0), np.diag([0.0, 0.0, 1.0 / 3.0]), atol=1e-9)
    across = np.array([[1.0, y, z] for y in np.arange(-0.2, 0.2, 0.01)
                       for z in np.arange(-0.2, 0.2, 0.01)])  # fmt: skip
    bundle = across / np.linalg.norm(across, axis=1, keepdims=True)
    np.testing.assert_allclose(unseen(bundle, place, 1.0), 0.0, atol=0.02)


@pytest.mark.parametrize("told", [False, True])
def test_planes_that_turn_are_no_velocity(told: bool) -> None:
    """The middle always seems to lie in a plane of rays that turns with S, until the next one."""
    place, period, spacing = np.array([10.0, 0.0, 0.3]), 0.5, math.radians(15.0)
    flown = None
    for k in range(300):
        turned = (AROUND.rate * k * period + 0.5 * spacing) % spacing - 0.5 * spacing
        middle = place + np.linalg.norm(place) * np.array([0.0, math.sin(turned), 0.0])
        gap = np.diag([0.0, 1.0 / 3.0, 0.0]) if told else ALL_SEEN
        if flown is None:
            flown = first_seen(AROUND, middle, gap)
        alike = AROUND.crossing(10.0) / period
        flown = corrected(flown, AROUND, middle, 30, alike * gap)
        flown = predicted(flown, AROUND, k * period, place / np.linalg.norm(place) ** 3, period)
    assert flown is not None
    off = np.linalg.norm(flown.mean[VELOCITY]) / flown.unsure
    assert (off < 3.0) == told


def state_of(place: np.ndarray, velocity: np.ndarray) -> np.ndarray:
    return np.r_[place, velocity, 1.0, np.zeros(STATES - 7)]


def test_far_away_it_aims_at_the_lowest_point() -> None:
    radius, place = 2.0, np.array([10.0, 3.0, 1.0])
    wanted = wanted_velocity(state_of(place, np.array([-0.1, 0.05, 0.02])), radius)
    energy = 0.5 * wanted @ wanted - 1.0 / np.linalg.norm(place)
    momentum = np.linalg.norm(np.cross(place, wanted))
    eccentricity = np.sqrt(1.0 + 2.0 * energy * momentum**2)
    assert momentum**2 / (1.0 + eccentricity) == pytest.approx(radius)
    assert wanted @ place < 0.0
    # What leads there already costs nothing.
    again = wanted_velocity(state_of(place, wanted), radius)
    np.testing.assert_allclose(again, wanted)


def test_near_it_changes_an_orbit_where_that_costs_the_least() -> None:
    place = np.array([2.0, 0.0, 0.0])
    # It passes the lowest point too fast to stay: it slows down, but not to a round orbit.
    fast = np.array([0.01, 0.1, 0.95])
    wanted = wanted_velocity(state_of(place, fast), 2.0)
    low, high = _ends(place, wanted, 1.0)
    assert 1.7 < low < high < 3.2
    assert np.sqrt(0.5) < np.linalg.norm(wanted) < np.linalg.norm(fast)
    # Still falling, it waits for the lowest point.
    falling = np.array([-0.3, 0.1, 0.95])
    assert (wanted_velocity(state_of(place, falling), 1.9) == falling).all()
    # Falling too low, it is led past at once.
    steep = np.array([-0.3, 0.02, 0.2])
    low, _ = _ends(place, wanted_velocity(state_of(place, steep), 2.0), 1.0)
    assert low > 1.7


def test_ends_of_an_ellipse() -> None:
    speed = np.sqrt(2.0 / 1.0 - 1.0 / 2.0)  # At the lowest point of the semi-axis 2.
    ends = _ends(np.array([1.0, 0.0, 0.0]), np.array([0.0, speed, 0.0]), 1.0)
    assert ends == pytest.approx((1.0, 3.0))
    assert _ends(np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.5, 0.0]), 1.0)[1] == np.inf


def test_the_orbit_is_steep_and_no_steeper_than_it_must() -> None:
    random = np.random.default_rng(6)
    for _ in range(20):
        up = random.standard_normal(3)
        up /= np.linalg.norm(up)
        momentum = np.cross(up, random.standard_normal(3))
        normal = orbit_normal(up, momentum)
        assert normal @ up == pytest.approx(0.0, abs=1e-12)
        assert abs(normal[2]) < 0.5 + 1e-9
        assert normal @ momentum > 0.0
        if abs(momentum[2]) < 0.5 * np.linalg.norm(momentum):
            np.testing.assert_allclose(normal, momentum / np.linalg.norm(momentum))
