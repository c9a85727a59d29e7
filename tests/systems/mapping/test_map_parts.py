"""The parts of the batch estimator beside closed forms."""

import numpy as np
import pytest

from proxops.systems.common import InputError
from proxops.systems.gravity import GravityField
from proxops.systems.mapping.first_orbit import densest, middle_of
from proxops.systems.mapping.free_surface import free_surface, oriented
from proxops.systems.mapping.mass_points import MassPoints
from proxops.systems.mapping.path import Path
from proxops.systems.mapping.returns import Returns
from proxops.systems.mapping.spheres import sphere
from proxops.systems.mapping.survey_controller import orbit_normal, wanted_velocity
from proxops.systems.shapes import Polyhedron, find_defects


def test_mass_points_pull_as_the_polyhedron_does() -> None:
    ball = sphere(3)
    shape = Polyhedron(ball.vertices * [1000.0, 400.0, 400.0], ball.facets)
    random = np.random.default_rng(1)
    points = random.standard_normal((50, 3))
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


def test_the_middle_of_a_ball() -> None:
    random = np.random.default_rng(5)
    across = random.uniform(-1.0, 1.0, (5000, 2))
    across = across[(across**2).sum(axis=1) < 1.0]
    deep = -np.sqrt(1.0 - (across**2).sum(axis=1))
    rays = np.column_stack([across, deep]) + [0.0, 0.0, 50.0]
    found = middle_of(rays, np.ones(3), np.eye(3))
    np.testing.assert_allclose(found, [0.0, 0.0, -50.0], atol=0.03)


def test_far_away_it_aims_at_the_lowest_point() -> None:
    radius, gm = 2.0, 1.0
    place = np.array([10.0, 3.0, 1.0])
    wanted = wanted_velocity(np.r_[place, -0.1, 0.05, 0.02, gm], radius)
    energy = 0.5 * wanted @ wanted - gm / np.linalg.norm(place)
    momentum = np.linalg.norm(np.cross(place, wanted))
    eccentricity = np.sqrt(1.0 + 2.0 * energy * momentum**2 / gm**2)
    assert momentum**2 / gm / (1.0 + eccentricity) == pytest.approx(radius)
    assert wanted @ place < 0.0


def test_near_it_flies_round() -> None:
    place = np.array([2.0, 0.0, 0.0])
    wanted = wanted_velocity(np.r_[place, 0.0, 0.1, 0.5, 1.0], 2.0)
    assert wanted @ place == pytest.approx(0.0)
    assert np.linalg.norm(wanted) == pytest.approx(np.sqrt(0.5))
    # One that is nearly round already costs nothing.
    nearly = np.r_[place, 0.01, 0.1, 0.69, 1.0]
    assert (wanted_velocity(nearly, 2.0) == nearly[3:6]).all()


def test_the_orbit_is_steep() -> None:
    random = np.random.default_rng(6)
    for _ in range(20):
        up = random.standard_normal(3)
        up /= np.linalg.norm(up)
        normal = orbit_normal(up, random.standard_normal(3))
        assert normal @ up == pytest.approx(0.0, abs=1e-12)
        assert abs(normal[2]) < np.cos(np.radians(75.0)) + 1e-9
