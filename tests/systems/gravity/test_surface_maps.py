"""Fields over surfaces and on planes, and equilibria, against closed forms and the literature."""

import numpy as np
import pytest
import trimesh
from jacobi import jacobi_integral
from pydrake.autodiffutils import AutoDiffXd

from proxops.diagrams.scenario.body import load_body
from proxops.systems import GravityField, InputError, Polyhedron
from proxops.systems.gravity.equilibria import find_equilibria, linear_modes, synchronous_radius
from proxops.systems.gravity.surface_maps import effective_field, plane_cut, surface_map

RADIUS, DENSITY = 50e3, 2000.0
# Equilibria of (216) Kleopatra, km, E1 to E7: X. Wang, Y. Jiang, S. Gong, "Analysis of the
# potential field and equilibrium points of irregular-shaped minor celestial bodies", Astrophys.
# Space Sci. 353 (2014) 105, at 3,600 kg/m^3 and 5.385 h, to a metre as we know them. We had no
# copy at hand to compare digit by digit; but the radar model itself, turned to its principal axes
# of inertia, gives every coordinate to 2 m. Ours is that shape rebuilt, within 0.7 km of it.
PUBLISHED = np.array(
    [
        [142.852, 2.441, 1.181],
        [-1.164, 100.740, -0.545],
        [-144.684, 5.188, -0.272],
        [2.230, -102.102, 0.271],
        [63.444, 0.827, -0.695],
        [-59.542, -0.969, -0.192],
        [6.219, -0.199, -0.308],
    ]
)
# Their topological cases are 2, 5, 2, 5 outside and 1, 1, 2 inside.
PUBLISHED_GROWING = [1, 2, 1, 2, 0, 0, 1]
PUBLISHED_SPIN = 2.0 * np.pi / (5.385 * 3600.0)


def ball(subdivisions: int, axes=(1.0, 1.0, 1.0), scale: float = RADIUS) -> GravityField:
    mesh = trimesh.creation.icosphere(subdivisions=subdivisions)
    shape = Polyhedron(mesh.vertices * np.asarray(axes) * scale, mesh.faces, "ball")
    return GravityField(shape, density=DENSITY)


def in_principal_axes(shape: Polyhedron) -> Polyhedron:
    """The shape turned so that z is the axis of its greatest inertia, x that of its least."""
    axes = np.linalg.eigh(shape.to_trimesh().moment_inertia)[1]
    axes *= np.sign(np.diag(axes))
    assert np.linalg.det(axes) == pytest.approx(1.0)
    return Polyhedron(shape.vertices @ axes, shape.facets, shape.name)


@pytest.fixture(scope="module")
def kleopatra() -> GravityField:
    return GravityField(load_body("kleopatra").shape, density=3600.0)


@pytest.fixture(scope="module")
def sphere() -> GravityField:
    return ball(4)


# --- the effective field --------------------------------------------------------------------------


def test_acceleration_and_gradient_are_derivatives_of_the_potential(
    kleopatra: GravityField,
) -> None:
    random = np.random.default_rng(2)
    points = random.uniform(-130e3, 130e3, (40, 3))
    points = np.concatenate([points, random.uniform(-12e3, 12e3, (10, 3))])
    felt = effective_field(kleopatra, PUBLISHED_SPIN, points)
    assert 5 < felt.inside.sum() < 45
    step = 5.0
    for axis in range(3):
        shift = step * np.eye(3)[axis]
        ahead = effective_field(kleopatra, PUBLISHED_SPIN, points + shift)
        behind = effective_field(kleopatra, PUBLISHED_SPIN, points - shift)
        slope = (ahead.potential - behind.potential) / (2.0 * step)
        np.testing.assert_allclose(-slope, felt.acceleration[:, axis], atol=2e-9)
        change = (ahead.acceleration - behind.acceleration) / (2.0 * step)
        np.testing.assert_allclose(change, felt.gradient[:, axis], atol=2e-11)


def test_potential_is_jacobis_at_rest(kleopatra: GravityField) -> None:
    points = np.array([[150e3, 20e3, -10e3], [0.0, 0.0, 80e3], [30e3, 0.0, 0.0]])
    felt = effective_field(kleopatra, 3e-4, points)
    potential = kleopatra.evaluate(points).potential
    at_rest = jacobi_integral(points, np.zeros((3, 3)), potential, 3e-4)
    np.testing.assert_allclose(felt.potential, at_rest, rtol=1e-14)
    assert felt.inside.tolist() == [False, False, True]


def test_a_body_of_two_densities_turns_about_its_centre_of_mass(sphere: GravityField) -> None:
    """On the axis only gravity acts; beside it, what pulls outwards is w^2 times the arm."""
    field = GravityField(sphere.shape, mass=sphere.mass, contrast=0.3)
    centre, spin = field.centre_of_mass, 3e-4
    assert np.linalg.norm(centre) > 0.01 * sphere.shape.extents.max()
    points = centre + np.array([[0.0, 0.0, 2.0], [3.0, 0.0, 0.0], [0.0, -4.0, 1.0]])
    apparent = effective_field(field, spin, points)
    outwards = spin**2 * np.array([[0.0, 0.0, 0.0], [3.0, 0.0, 0.0], [0.0, -4.0, 0.0]])
    pull = field.evaluate(points).acceleration
    np.testing.assert_allclose(apparent.acceleration - pull, outwards, atol=1e-12)


# --- over the surface -----------------------------------------------------------------------------


@pytest.mark.parametrize("share", [0.0, 0.3, 0.8])
def test_slope_of_a_spinning_sphere(sphere: GravityField, share: float) -> None:
    """`share` is the centrifugal over the gravitational acceleration at the equator."""
    gravity = 4.0 / 3.0 * np.pi * 6.6743e-11 * DENSITY * RADIUS
    spin = np.sqrt(share * gravity / RADIUS)
    found = surface_map(sphere, spin)
    sine = np.abs(found.centroids[:, 2]) / np.linalg.norm(found.centroids, axis=1)
    cosine = np.sqrt(1.0 - sine**2)
    expected = np.arctan2(share * sine * cosine, 1.0 - share * cosine**2)
    # The facets' normals are off the radius by up to 0.31 degrees.
    assert np.degrees(np.abs(found.slope - expected).max()) < 0.35
    np.testing.assert_allclose(found.gravity, gravity, rtol=4e-3)
    level = -gravity * RADIUS * (1.0 + 0.5 * share * cosine**2)
    np.testing.assert_allclose(found.potential, level, rtol=4e-3)
    poles, equator = sine > 0.999, sine < 0.002
    assert np.degrees(found.slope[poles].max()) < 2.6
    assert np.degrees(found.slope[equator].max()) < 0.7
    # The same on both sides of the equator.
    north = np.sort(found.slope[found.centroids[:, 2] > 0.0])
    south = np.sort(found.slope[found.centroids[:, 2] < 0.0])
    np.testing.assert_allclose(north, south, atol=1e-9)


def test_slope_where_a_fast_spinner_sheds(sphere: GravityField) -> None:
    """Spinning faster than a satellite at its surface, the plumb line points up at the equator."""
    gravity = 4.0 / 3.0 * np.pi * 6.6743e-11 * DENSITY * RADIUS
    found = surface_map(sphere, np.sqrt(1.5 * gravity / RADIUS))
    latitude = np.degrees(np.arcsin(found.centroids[:, 2] / RADIUS))
    assert np.degrees(found.slope[np.abs(latitude) < 2.0].min()) > 170.0
    assert np.degrees(found.slope[np.abs(latitude) > 85.0].max()) < 12.0


# --- on a plane -----------------------------------------------------------------------------------


@pytest.mark.parametrize("plane", ["xy", "xz", "yz", "zx"])
def test_plane_cut_is_rows_by_columns(kleopatra: GravityField, plane: str) -> None:
    cut = plane_cut(kleopatra, PUBLISHED_SPIN, 120e3, plane, count=13, offset=2e3)
    assert cut.potential.shape == cut.inside.shape == (13, 13)
    assert cut.acceleration.shape == (13, 13, 3)
    assert cut.across[[0, -1]].tolist() == cut.up[[0, -1]].tolist() == [-120e3, 120e3]
    row, column = 2, 9
    point = np.full(3, 2e3)
    point["xyz".index(plane[0])] = cut.across[column]
    point["xyz".index(plane[1])] = cut.up[row]
    felt = effective_field(kleopatra, PUBLISHED_SPIN, point[None])
    assert cut.potential[row, column] == pytest.approx(felt.potential[0], rel=1e-13)
    np.testing.assert_allclose(cut.acceleration[row, column], felt.acceleration[0], rtol=1e-11)
    assert cut.inside[6, 6]
    assert not cut.inside[0, 0]


# --- equilibria -----------------------------------------------------------------------------------


def test_modes_at_the_synchronous_orbit_of_a_point() -> None:
    """Hill's equations: 0, 0, and twice the orbit's own frequency."""
    modes = linear_modes(1e-8 * np.diag([3.0, 0.0, -1.0]), 1e-4)
    assert np.abs(np.real(modes)).max() < 1e-11
    frequencies = np.sort(np.abs(np.imag(modes)))
    np.testing.assert_allclose(frequencies, [0.0, 0.0, 1e-4, 1e-4, 1e-4, 1e-4], atol=1e-11)


def test_modes_solve_the_characteristic_equation() -> None:
    random = np.random.default_rng(8)
    gradient = random.normal(size=(3, 3))
    gradient += gradient.T
    coriolis = 2.0 * 0.7 * np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
    for mode in linear_modes(gradient, 0.7):
        assert abs(np.linalg.det(mode**2 * np.eye(3) - mode * coriolis - gradient)) < 1e-10


def test_ring_of_a_sphere() -> None:
    """A mesh as good as round: all its equilibria outside are on the synchronous orbit."""
    field = ball(3)
    spin = 1e-4
    radius = synchronous_radius(field.mass, spin)
    assert radius == pytest.approx((6.6743e-11 * field.mass / 1e-8) ** (1 / 3), rel=1e-12)
    *outside, centre = find_equilibria(field, spin)
    assert len(outside) >= 4
    assert centre.inside
    assert np.abs(centre.position).max() < 1e-3
    for point in outside:
        assert not point.inside
        assert np.linalg.norm(point.position[:2]) == pytest.approx(radius, rel=1e-6)
        assert abs(point.position[2]) < 1e-3 * radius


def test_ellipsoid_has_five_in_its_planes_of_symmetry() -> None:
    field = ball(3, axes=(1.5, 1.0, 0.8))
    found = find_equilibria(field, 2e-4)
    assert [point.inside for point in found] == [False, False, False, False, True]
    directions = [point.position / np.linalg.norm(point.position) for point in found[:4]]
    np.testing.assert_allclose(
        directions, [[1, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0]], atol=1e-6
    )
    assert found[0].potential == pytest.approx(found[2].potential)
    assert found[0].growing == found[2].growing == 1  # Saddles over the long ends.
    assert found[4].growing == 0
    for point in found:
        felt = effective_field(field, 2e-4, point.position[None])
        assert np.linalg.norm(felt.acceleration) < 1e-10
        assert felt.potential[0] == point.potential


def test_body_that_does_not_spin_has_its_centre_only() -> None:
    [centre] = find_equilibria(ball(2, axes=(1.5, 1.0, 0.8)), 0.0)
    assert centre.inside
    assert synchronous_radius(1e15, 0.0) == np.inf


@pytest.mark.parametrize("scale", [2.5e-3, 40.0])
def test_equilibria_scale_with_the_body(scale: float) -> None:
    """At one density and spin, everything is proportional to the size."""
    axes = (1.5, 1.0, 0.8)
    here, there = ball(2, axes), ball(2, axes, scale * RADIUS)
    pairs = zip(find_equilibria(here, 2e-4), find_equilibria(there, 2e-4), strict=True)
    for one, other in pairs:
        np.testing.assert_allclose(other.position, scale * one.position, atol=1e-6 * scale * RADIUS)
        assert other.growing == one.growing


def test_seven_equilibria_of_kleopatra(kleopatra: GravityField) -> None:
    field = GravityField(in_principal_axes(kleopatra.shape), density=3600.0)
    found = find_equilibria(field, PUBLISHED_SPIN)
    assert [point.inside for point in found] == 4 * [False] + 3 * [True]
    assert [point.growing for point in found] == PUBLISHED_GROWING
    apart = np.linalg.norm([point.position for point in found] - 1e3 * PUBLISHED, axis=1)
    assert apart.max() < 120.0  # m; the mesh is known to be 700 m off at worst.
    for point in found:
        felt = effective_field(field, PUBLISHED_SPIN, point.position[None])
        assert np.linalg.norm(felt.acceleration) < 1e-10


def test_starts_may_be_given(kleopatra: GravityField) -> None:
    near = np.array([[140e3, 0.0, 0.0], [141e3, 1e3, 0.0]])
    [point] = find_equilibria(kleopatra, PUBLISHED_SPIN, near)
    assert point.position == pytest.approx(1e3 * PUBLISHED[0], abs=1e3)
    with pytest.raises(InputError, match="points must have shape"):
        find_equilibria(kleopatra, PUBLISHED_SPIN, np.zeros(3))
    with pytest.raises(InputError, match="for AutoDiffXd, use PolyhedralGravity_"):
        kleopatra.evaluate(np.array([[AutoDiffXd(2e5), 0.0, 0.0]]))
    with pytest.raises(InputError, match="spin must be finite"):
        find_equilibria(kleopatra, np.nan)
