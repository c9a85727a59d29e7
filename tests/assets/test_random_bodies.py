"""Generated bodies: repeatable, sound, of all kinds, and held together by their gravity."""

import numpy as np
import pytest
import trimesh

from proxops.assets.random_bodies import BREAK_UP_SHARE, KINDS, RandomBody, random_body
from proxops.systems.gravity import GravityField
from proxops.systems.shapes import Polyhedron, find_defects, self_intersections, smallest_angles

SEED = 5
COUNT = 40


@pytest.fixture(scope="module")
def bodies() -> list[RandomBody]:
    return [random_body(SEED, number) for number in range(COUNT)]


def test_is_a_function_of_seed_and_number(bodies: list[RandomBody]) -> None:
    again, other = random_body(SEED, 3), random_body(SEED + 1, 3)
    np.testing.assert_array_equal(again.vertices, bodies[3].vertices)
    np.testing.assert_array_equal(again.facets, bodies[3].facets)
    assert again.density_kg_m3 == bodies[3].density_kg_m3
    assert again.rotation_period_h == bodies[3].rotation_period_h
    assert again.name == f"random-{SEED}-3"
    lengths = {float(np.ptp(body.vertices)) for body in (*bodies, other)}
    assert len(lengths) == COUNT + 1


def test_all_are_sound_and_have_good_facets(bodies: list[RandomBody]) -> None:
    for body in bodies:
        assert find_defects(body.vertices, body.facets) == []
        assert len(self_intersections(body.vertices, body.facets)) == 0
        assert smallest_angles(body.vertices, body.facets).min() > 15.0
        assert 1000 <= len(body.facets) <= 2000
        mesh = trimesh.Trimesh(body.vertices, body.facets, process=False)
        assert mesh.is_volume
        assert mesh.euler_number == 2
        assert mesh.body_count == 1


def test_axes_are_principal_and_about_the_centre_of_mass(bodies: list[RandomBody]) -> None:
    for body in bodies:
        mesh = trimesh.Trimesh(body.vertices, body.facets, process=False)
        size = np.ptp(body.vertices, axis=0).max()
        np.testing.assert_allclose(mesh.center_mass, 0.0, atol=1e-9 * size)
        inertia = mesh.moment_inertia
        moments = np.diag(inertia)
        np.testing.assert_allclose(inertia, np.diag(moments), atol=1e-9 * moments[2])
        assert moments[0] <= moments[1] <= moments[2]


def test_all_kinds_occur_within_the_ranges(bodies: list[RandomBody]) -> None:
    assert {body.kind for body in bodies} == set(KINDS)
    lengths = [np.ptp(body.vertices, axis=0).max() for body in bodies]
    assert 200.0 * (1 - 1e-9) <= min(lengths) < 600.0
    assert 60e3 < max(lengths) <= 200e3 * (1 + 1e-9)
    for body in bodies:
        assert 1000.0 <= body.density_kg_m3 <= 4500.0
        assert 2.2 <= body.rotation_period_h <= 60.0


@pytest.mark.slow
def test_gravity_exceeds_the_centrifugal_acceleration_everywhere(bodies: list[RandomBody]) -> None:
    """By the polyhedron's exact gravity; the periods were chosen by a sum over facets."""
    shares = []
    for body in bodies:
        shape = Polyhedron(body.vertices, body.facets, body.name).recentred()
        field = GravityField(shape, mass=body.density_kg_m3 * shape.volume)
        # Just above the surface, where gravity is defined at vertices too.
        places = 1.000001 * np.concatenate([body.vertices, body.vertices[body.facets].mean(axis=1)])
        gravity = np.linalg.norm(field.evaluate(places).acceleration, axis=1)
        rate = 2.0 * np.pi / (3600.0 * body.rotation_period_h)
        shares.append((rate**2 * np.linalg.norm(places[:, :2], axis=1) / gravity).max())
    assert max(shares) <= 1.005 * BREAK_UP_SHARE
    # Some spin nearly as fast as they can, most do not.
    assert max(shares) > 0.5
    assert np.median(shares) < 0.3
