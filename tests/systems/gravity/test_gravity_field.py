"""Polyhedral gravity against closed forms, a plain implementation, and the laws it must obey.

Eq. 29, 30 and 32 of docs/method/equations.md.
"""

import platform
import re
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from types import SimpleNamespace

import numba
import numpy as np
import pytest
import trimesh
from gauss_law import outward_flux
from hypothesis import given, settings
from hypothesis import strategies as st
from plain_polyhedral_gravity import G, PlainPolyhedralGravity, box, star_shaped

from proxops.diagrams.scenario.body import load_body
from proxops.systems.common.errors import InputError
from proxops.systems.gravity import GravityField, gravity_field
from proxops.systems.gravity import _polyhedral_kernel as kernel
from proxops.systems.gravity._far_field import fit_masses
from proxops.systems.shapes.polyhedron import Polyhedron

DENSITY = 2000.0
G_RHO = G * DENSITY
seeds = st.integers(0, 2**32 - 1)
few = settings(max_examples=8)


def field_of(mesh: trimesh.Trimesh) -> GravityField:
    return GravityField(Polyhedron.from_trimesh(mesh, "m"), density=DENSITY)


def relative(value: np.ndarray, reference: np.ndarray) -> float:
    """Greatest relative difference over rows, each row's norm its scale."""
    value, reference = (np.asarray(a).reshape(len(reference), -1) for a in (value, reference))
    error = np.linalg.norm((value - reference).astype(float), axis=1)
    return float((error / np.linalg.norm(reference.astype(float), axis=1)).max())


def surface_points(
    mesh: trimesh.Trimesh, count: int, seed: int = 1
) -> tuple[np.ndarray, np.ndarray]:
    """Points (N, 3) on the surface, at least a little off the edges, and their facets (N,)."""
    rng = np.random.default_rng(seed)
    facet = rng.integers(0, len(mesh.faces), count)
    weight = 0.05 + 0.85 * rng.dirichlet([1.0, 1.0, 1.0], count)
    weight /= weight.sum(axis=1, keepdims=True)
    return np.einsum("nc,nci->ni", weight, np.asarray(mesh.triangles)[facet]), facet


@pytest.fixture(scope="module")
def kleopatra():
    return load_body("kleopatra")


@pytest.fixture(scope="module")
def kleopatra_mesh(kleopatra) -> trimesh.Trimesh:
    return kleopatra.shape.to_trimesh()


@pytest.fixture(scope="module")
def kleopatra_extended(kleopatra) -> PlainPolyhedralGravity:
    shape = kleopatra.shape
    return PlainPolyhedralGravity(
        shape.vertices, shape.facets, kleopatra.gravity_field.density, np.longdouble
    )


# --- closed forms ---------------------------------------------------------------------------------

BOX_LOW, BOX_HIGH = np.array([-1.0, -0.7, -0.4]), np.array([1.2, 0.5, 0.9])


def box_field(points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Field of the box over G rho: MacMillan, The Theory of the Potential (1930), sec. 43.

    log(z + r) is written asinh(z / hypot(x, y)): the rest cancels between the two ends in z. On
    faces the gradient is the mean of both sides; on edges it is infinite and here without meaning.
    """
    potential = np.zeros(len(points))
    acceleration, gradient = np.zeros((len(points), 3)), np.zeros((len(points), 3, 3))
    for corner in np.ndindex(2, 2, 2):
        sign = (-1.0) ** (3 - sum(corner))
        c = np.where(corner, BOX_HIGH, BOX_LOW) - points
        r = np.linalg.norm(c, axis=1)
        for k in range(3):
            i, j = (k + 1) % 3, (k + 2) % 3
            across = np.hypot(c[:, i], c[:, j])
            log = np.arcsinh(c[:, k] / np.maximum(across, 1e-150))
            angle = np.sign(c[:, k]) * np.arctan2(c[:, i] * c[:, j], np.abs(c[:, k]) * r)
            potential += sign * (c[:, i] * c[:, j] * log - 0.5 * c[:, k] ** 2 * angle)
            acceleration[:, i] -= sign * c[:, j] * log
            acceleration[:, j] -= sign * c[:, i] * log
            acceleration[:, k] += sign * c[:, k] * angle
            gradient[:, k, k] -= sign * angle
            gradient[:, i, j] += sign * log
            gradient[:, j, i] += sign * log
    return potential, acceleration, gradient


@pytest.fixture(scope="module")
def box_gravity() -> GravityField:
    return GravityField(Polyhedron(*box(BOX_LOW, BOX_HIGH)), density=DENSITY)


def test_box_in_space(box_gravity: GravityField) -> None:
    points = np.random.default_rng(0).uniform(-3.0, 3.0, (500, 3))
    field = box_gravity.evaluate(points)
    for value, reference in zip(field[:3], box_field(points), strict=True):
        assert relative(value, G_RHO * reference) < 2e-13
    np.testing.assert_array_equal(
        field.inside, ((points > BOX_LOW) & (points < BOX_HIGH)).all(axis=1)
    )


def test_box_at_vertices_edges_and_faces(box_gravity: GravityField) -> None:
    """All 26 places on the surface where a coordinate is at a limit, and off-centre ones."""
    at = np.array([place for place in np.ndindex(3, 3, 3) if place != (1, 1, 1)]) / 2.0
    shifted = np.where(at == 0.5, 0.37, at)
    at = np.concatenate([at, shifted])
    points = BOX_LOW * (1 - at) + BOX_HIGH * at
    field = box_gravity.evaluate(points)
    potential, acceleration, gradient = box_field(points)
    assert relative(field.potential, G_RHO * potential) < 1e-13
    assert relative(field.acceleration, G_RHO * acceleration) < 1e-13
    assert np.isfinite(field.gradient).all()
    face = np.isin(at, [0.0, 1.0]).sum(axis=1) == 1
    assert relative(field.gradient[face], G_RHO * gradient[face]) < 1e-13
    np.testing.assert_allclose(
        np.trace(field.gradient[face], axis1=1, axis2=2), -2 * np.pi * G_RHO, rtol=1e-13
    )


def test_cube_at_centre_and_corner() -> None:
    """Waldvogel (1976): 3 log((sqrt 3 + 1)/(sqrt 3 - 1)) - pi/2 at the centre, half at a corner."""
    field = GravityField(Polyhedron(*box(np.zeros(3), np.ones(3))), density=DENSITY)
    result = field.evaluate(np.array([[0.5, 0.5, 0.5], [0.0, 0.0, 0.0], [1.0, 0.0, 1.0]]))
    root = np.sqrt(3.0)
    centre = G_RHO * (3 * np.log((root + 1) / (root - 1)) - np.pi / 2)
    np.testing.assert_allclose(result.potential, [centre, centre / 2, centre / 2], rtol=4e-14)
    np.testing.assert_allclose(result.acceleration[0], 0.0, atol=1e-15 * G_RHO)


def test_icospheres_converge_to_the_sphere() -> None:
    """The error falls by four with each subdivision, inside and outside."""
    points = np.array([[0.3, -0.2, 0.1], [0.0, 0.0, 0.5], [1.4, 0.2, -0.3], [3.0, -4.0, 1.0]])
    r = np.linalg.norm(points, axis=1)
    inside = r < 1.0
    mean = 4 / 3 * np.pi * G_RHO
    potential = np.where(inside, mean * (1.5 - r**2 / 2), mean / r)
    acceleration = -mean * points * np.where(inside, 1.0, r**-3)[:, None]
    errors = []
    for subdivisions in (1, 2, 3, 4):
        field = field_of(trimesh.creation.icosphere(subdivisions)).evaluate(points)
        np.testing.assert_array_equal(field.inside, inside)
        errors.append(
            (relative(field.potential, potential), relative(field.acceleration, acceleration))
        )
    ratios = np.array(errors[:-1]) / np.array(errors[1:])
    assert ((ratios > 3.5) & (ratios < 4.6)).all(), ratios
    assert max(errors[-1]) < 4e-3


# --- far away -------------------------------------------------------------------------------------


def test_far_field_of_a_box(box_gravity: GravityField) -> None:
    """MacCullagh's formula; the next term of a box is of the fourth degree."""
    centre, half = (BOX_LOW + BOX_HIGH) / 2, (BOX_HIGH - BOX_LOW) / 2
    gm = G_RHO * np.prod(2 * half)
    rng = np.random.default_rng(2)
    direction = rng.normal(size=(60, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    r = 10.0 ** rng.uniform(4, 9, 60)
    moment = np.diag(half**2 / 3)
    level = np.einsum("ni,ij,nj->n", direction, moment, direction)
    excess = (3 * level - np.trace(moment)) / (2 * r**2)
    slope = 3 * direction @ moment - 1.5 * direction * (5 * level - np.trace(moment))[:, None]
    field = box_gravity.evaluate(centre + r[:, None] * direction)
    # The position itself is rounded to 1e-16 of r; no more is lost.
    assert relative(field.potential, gm / r * (1 + excess)) < 2e-13
    expected = gm / r[:, None] ** 2 * (-direction + slope / r[:, None] ** 2)
    assert relative(field.acceleration, expected) < 2e-13
    monopole = (
        gm / r[:, None, None] ** 3 * (3 * direction[:, :, None] * direction[:, None] - np.eye(3))
    )
    assert relative(field.gradient, monopole) < 1e-6
    assert not field.inside.any()


def random_directions(count: int) -> np.ndarray:
    direction = np.random.default_rng(3).normal(size=(count, 3))
    return direction / np.linalg.norm(direction, axis=1, keepdims=True)


@pytest.mark.parametrize("share", [10.001, 20.0])
def test_point_masses_have_the_field_of_a_body(share: float) -> None:
    """The method alone: masses fitted to potentials of extended precision, for a long box."""
    vertices, facets = box(np.array([-2.0, -0.5, -0.4]), np.array([2.0, 0.5, 0.4]))
    extended = PlainPolyhedralGravity(vertices, facets, DENSITY, np.longdouble)
    radius = float(np.linalg.norm(vertices, axis=1).max())
    masses, _ = fit_masses(
        lambda points: np.array([float(extended.at(point).potential) for point in points]), radius
    )
    points = share * radius * random_directions(40)
    away = masses[:3].T - points[:, None]
    distance = np.linalg.norm(away, axis=2)
    dyads = 3.0 * away[..., :, None] * away[..., None, :] / distance[..., None, None] ** 2
    found = (
        (masses[3] / distance).sum(axis=1),
        ((masses[3] / distance**3)[..., None] * away).sum(axis=1),
        ((masses[3] / distance**3)[..., None, None] * (dyads - np.eye(3))).sum(axis=1),
    )
    truth = [extended.at(point) for point in points]
    for index, bound in enumerate((2e-14, 2e-13, 1e-12)):
        assert relative(found[index], np.array([t[index] for t in truth])) < bound


def test_far_field_joins_without_a_step(kleopatra, kleopatra_extended) -> None:
    """On both sides of the switch only rounding is left, so there is no step.

    Its size depends on the processor, because the sums are vectorised. Inside the switch it is less
    than half of the rounding error of the plain formula in the same precision. Beyond the switch it
    comes from the rounding of the 400 potentials that the masses were fitted to. The fit keeps
    harmonics up to degree 13, and rounding has an equal share in each of the 2 l + 1 of degree l.
    Relative to a point mass, an error of degree l grows by sqrt((l + 1)(2 l + 1)) from potential to
    acceleration, and by sqrt((l + 1)(2 l + 1)(l + 2)(2 l + 3) / 6) from potential to gradient.
    """
    field, shape = kleopatra.gravity_field, kleopatra.shape
    radius = np.linalg.norm(shape.vertices, axis=1).max()
    inside, beyond, far = (radius * share * random_directions(40) for share in (9.999, 10.001, 20))
    plain = PlainPolyhedralGravity(shape.vertices, shape.facets, field.density)
    truth = [kleopatra_extended.at(point) for point in inside]
    result, printed = field.evaluate(inside), [plain.at(point) for point in inside]
    for index in range(3):
        exact = np.array([t[index] for t in truth])
        rounding = relative(np.array([p[index] for p in printed]), exact)
        assert relative(result[index], exact) < 0.5 * rounding
    exact = np.array([float(t.potential) for t in truth])
    noise = np.sqrt(np.mean((result.potential / exact - 1.0) ** 2))
    assert noise < 1e-13

    degree = np.arange(14)
    first = (degree + 1) * (2 * degree + 1)
    gains = np.stack([np.ones(14), first, first * (degree + 2) * (2 * degree + 3) / 6])
    expected = noise * np.sqrt(gains @ (2 * degree + 1) / 400)
    # The greatest of 40 errors is within four standard deviations; farther out they are less.
    for points in (beyond, far):
        result, truth = field.evaluate(points), [kleopatra_extended.at(point) for point in points]
        for index in range(3):
            exact = np.array([t[index] for t in truth])
            assert relative(result[index], exact) < 4.0 * expected[index]


# --- against the plain implementation -------------------------------------------------------------


def test_kleopatra_against_extended_precision(
    kleopatra, kleopatra_mesh, kleopatra_extended: PlainPolyhedralGravity
) -> None:
    surface, _ = surface_points(kleopatra_mesh, 100, seed=5)
    share = np.exp(np.random.default_rng(5).uniform(np.log(1.0001), np.log(10.0), 100))
    points = np.concatenate([surface * share[:, None], 0.9 * surface])
    result = kleopatra.gravity_field.evaluate(points)
    truth = [kleopatra_extended.at(point) for point in points]
    for index, bound in enumerate((1e-13, 3e-13, 1e-11)):
        assert relative(result[index], np.array([t[index] for t in truth])) < bound
    angle = np.array([t.solid_angle for t in truth], dtype=float)
    np.testing.assert_array_equal(result.inside, angle > 2 * np.pi)


@few
@given(seeds)
def test_random_bodies_against_the_plain_formula(seed: int) -> None:
    mesh = star_shaped(seed, size=1000.0)
    plain = PlainPolyhedralGravity(mesh.vertices, mesh.faces, DENSITY)
    surface, facet = surface_points(mesh, 12, seed)
    normal = np.asarray(mesh.face_normals)[facet]
    rng = np.random.default_rng(seed)
    height = 10.0 ** rng.uniform(-1, 3.7, 12)
    outside = surface + height[:, None] * normal
    points = np.concatenate([outside, rng.uniform(0.1, 0.9, (12, 1)) * surface])
    result = field_of(mesh).evaluate(points)
    reference = [plain.at(point) for point in points]
    for index in range(3):
        assert relative(result[index], np.array([r[index] for r in reference])) < 1e-11
    angle = np.array([r.solid_angle for r in reference])
    np.testing.assert_array_equal(result.inside, angle > 2 * np.pi)


@pytest.mark.parametrize("distance", [10.0, 0.1, 1e-5])
def test_beside_edges(kleopatra, kleopatra_extended, distance: float) -> None:
    """Metres to micrometres from edges kilometres long acceleration keeps its digits."""
    vertices, (edges, _) = kleopatra.shape.vertices, kleopatra.shape.edges
    rng = np.random.default_rng(6)
    ends = vertices[edges[rng.integers(0, len(edges), 40)]]
    share = rng.uniform(0.1, 0.9, (40, 1))
    away = rng.normal(size=(40, 3))
    away *= distance / np.linalg.norm(away, axis=1, keepdims=True)
    points = ends[:, 0] * share + ends[:, 1] * (1 - share) + away
    result = kleopatra.gravity_field.evaluate(points)
    truth = [kleopatra_extended.at(point) for point in points]
    assert relative(result.potential, np.array([t.potential for t in truth])) < 1e-13
    assert relative(result.acceleration, np.array([t.acceleration for t in truth])) < 1e-12
    assert np.isfinite(result.gradient).all()
    if distance >= 0.1:  # Nearer, the reference itself has lost the gradient.
        assert relative(result.gradient, np.array([t.gradient for t in truth])) < 1e-8


# --- laws -----------------------------------------------------------------------------------------


@settings(max_examples=5)
@given(seeds)
def test_gauss_law(seed: int) -> None:
    mesh = star_shaped(seed, subdivisions=1)
    field = field_of(mesh)
    radius = np.linalg.norm(mesh.vertices, axis=1).max()
    total = 4 * np.pi * G * field.mass
    assert outward_flux(field, np.zeros(3), 2.5 * radius) == pytest.approx(-total, rel=1e-11)
    assert outward_flux(field, np.array([0.0, 4.0 * radius, 0.0]), 2.0 * radius) == pytest.approx(
        0.0, abs=1e-11 * total
    )


@few
@given(seeds)
def test_derivatives(seed: int) -> None:
    """Acceleration is the slope of the potential, gradient that of acceleration; Poisson holds."""
    mesh = star_shaped(seed)
    field = field_of(mesh)
    rng = np.random.default_rng(seed)
    points = surface_points(mesh, 8, seed)[0] * rng.choice([0.3, 0.5, 1.3, 2.0, 8.0, 15.0], (8, 1))
    result = field.evaluate(points)
    step = 1e-3 * np.linalg.norm(points, axis=1)
    for axis in range(3):
        moves = step[:, None] * np.eye(3)[axis]
        # Richardson's central difference, of the fourth order.
        near = [field.evaluate(points + k * moves) for k in (-2, -1, 1, 2)]
        slope, rise = (
            (n[0] - 8 * n[1] + 8 * n[2] - n[3]) / (12 * step)
            for n in ([f.potential for f in near], [f.acceleration.T for f in near])
        )
        scale = np.linalg.norm(result.acceleration, axis=1)
        assert (np.abs(slope - result.acceleration[:, axis]) < 1e-6 * scale).all()
        scale = np.linalg.norm(result.gradient, axis=(1, 2))
        assert (np.abs(rise - result.gradient[:, axis].T) < 1e-5 * scale).all()
    np.testing.assert_array_equal(result.gradient, result.gradient.transpose(0, 2, 1))
    trace = np.trace(result.gradient, axis1=1, axis2=2)
    np.testing.assert_allclose(trace, -4 * np.pi * G_RHO * result.inside, atol=1e-12 * G_RHO)
    assert (result.potential > 0).all()
    assert (np.einsum("ni,ni->n", result.acceleration, points)[~result.inside] < 0).all()


@few
@given(seeds, st.floats(-3, 9))
def test_scale_and_rotation(seed: int, magnitude: float) -> None:
    """A body 10^m times as large has 10^2m the potential; a turned one turns its field."""
    mesh = star_shaped(seed, subdivisions=1)
    points = surface_points(mesh, 20, seed)[0] * np.geomspace(0.2, 50.0, 20)[:, None]
    base = field_of(mesh).evaluate(points)
    size = 10.0**magnitude
    turn = trimesh.transformations.random_rotation_matrix(
        np.random.default_rng(seed).uniform(size=3)
    )[:3, :3]
    vertices = size * mesh.vertices @ turn.T
    result = field_of(trimesh.Trimesh(vertices, mesh.faces, process=False)).evaluate(
        size * points @ turn.T
    )
    assert relative(result.potential, size**2 * base.potential) < 2e-12
    assert relative(result.acceleration, size * base.acceleration @ turn.T) < 2e-12
    assert relative(result.gradient, turn @ base.gradient @ turn.T) < 1e-11
    np.testing.assert_array_equal(result.inside, base.inside)


# --- on the surface -------------------------------------------------------------------------------


def test_inside_is_right_within_1e_9_of_the_surface(kleopatra) -> None:
    """On all facets (at random points), edges (in the middle) and vertices, to both sides."""
    field = kleopatra.gravity_field
    shape = field.shape
    step = 1e-9 * shape.extents.max()
    weights = np.random.default_rng(0).dirichlet(np.ones(3), len(shape.facets))
    on_facets = np.einsum("fk,fki->fi", weights, shape.vertices[shape.facets])
    ends, sides = shape.edges
    at_vertices = np.zeros_like(shape.vertices)
    np.add.at(at_vertices, shape.facets.ravel(), np.repeat(shape.normals, 3, axis=0))
    for points, out in (
        (on_facets, shape.normals),
        (shape.vertices[ends].mean(axis=1), shape.normals[sides].sum(axis=1)),
        (shape.vertices, at_vertices),
    ):
        unit = out / np.linalg.norm(out, axis=1, keepdims=True)
        assert not field.evaluate(points + step * unit).inside.any()
        assert field.evaluate(points - step * unit).inside.all()


def test_facets_from_both_sides(kleopatra, kleopatra_mesh) -> None:
    """Potential and acceleration are continuous; the gradient jumps by 4 pi G rho n n^T."""
    field = kleopatra.gravity_field
    points, facet = surface_points(kleopatra_mesh, 100, seed=7)
    normal = np.asarray(kleopatra_mesh.face_normals)[facet]
    step = 1e-4  # m, on a body of 200 km
    at = field.evaluate(points)
    above, below = field.evaluate(points + step * normal), field.evaluate(points - step * normal)
    assert not above.inside.any()
    assert below.inside.all()
    strength = G * field.density
    for side in (above, below):
        slack = 2 * step * np.linalg.norm(at.acceleration, axis=1).max()
        np.testing.assert_allclose(side.potential, at.potential, rtol=1e-13, atol=slack)
        np.testing.assert_allclose(side.acceleration, at.acceleration, atol=50 * step * strength)
    np.testing.assert_allclose(
        above.gradient - below.gradient,
        4 * np.pi * strength * normal[:, :, None] * normal[:, None],
        atol=1e-6 * strength,
    )
    np.testing.assert_allclose(
        at.gradient, (above.gradient + below.gradient) / 2, atol=1e-6 * strength
    )
    np.testing.assert_allclose(
        np.trace(at.gradient, axis1=1, axis2=2), -2 * np.pi * strength, rtol=1e-11
    )


def test_vertices_and_edges_of_kleopatra(kleopatra) -> None:
    """Finite and the limit of what is around, at every vertex and on every edge."""
    field, shape = kleopatra.gravity_field, kleopatra.shape
    edges, _ = shape.edges
    midpoints = shape.vertices[edges].mean(axis=1)
    thirds = (shape.vertices[edges[:, 0]] + 2 * shape.vertices[edges[:, 1]]) / 3
    points = np.concatenate([shape.vertices, midpoints, thirds])
    at = field.evaluate(points)
    for part in at[:3]:
        assert np.isfinite(part).all()
    strength = G * field.density
    assert np.abs(at.gradient).max() < 200 * strength
    step = 1e-3
    slack = 2 * step * np.linalg.norm(at.acceleration, axis=1).max()
    # Of six directions, each third point goes in two.
    for row, direction in enumerate(np.concatenate([np.eye(3), -np.eye(3)])):
        some = slice(row % 3, None, 3)
        near = field.evaluate(points[some] + step * direction)
        np.testing.assert_allclose(near.potential, at.potential[some], rtol=1e-13, atol=slack)
        np.testing.assert_allclose(
            near.acceleration, at.acceleration[some], atol=100 * step * strength
        )


def test_plane_and_edge_lines_produced(box_gravity: GravityField) -> None:
    """Outside, in the planes of facets and on the lines of edges, nothing is singular."""
    rng = np.random.default_rng(8)
    limits = np.stack([BOX_LOW, BOX_HIGH])
    points = rng.uniform(1.5, 4.0, (60, 3)) * rng.choice([-1, 1], (60, 3))
    for row, point in enumerate(points):
        for axis in rng.permutation(3)[: 1 + row % 2]:
            point[axis] = limits[rng.integers(2), axis]
    result = box_gravity.evaluate(points)
    for value, reference in zip(result[:3], box_field(points), strict=True):
        assert relative(value, G_RHO * reference) < 1e-12
    np.testing.assert_allclose(np.trace(result.gradient, axis1=1, axis2=2), 0.0, atol=1e-13 * G_RHO)


# --- batches and bad input ------------------------------------------------------------------------


def test_nan_stays_in_its_row(box_gravity: GravityField) -> None:
    points = np.array([[2.0, 0.0, 0.0], [np.nan, 0.0, 0.0], [0.0, 0.0, np.nan], [50.0, 0.0, 0.0]])
    result = box_gravity.evaluate(points)
    for part in result[:3]:
        finite = np.isfinite(part.reshape(4, -1))
        assert finite[[0, 3]].all()
        assert np.isnan(part[1:3]).all()
    assert not result.inside[1:3].any()


def test_parallel_equals_serial(kleopatra) -> None:
    points = np.random.default_rng(9).uniform(-2e6, 2e6, (600, 3))
    points[:200] *= 0.05
    together = kleopatra.gravity_field.evaluate(points)
    apart = [kleopatra.gravity_field.evaluate(chunk) for chunk in np.array_split(points, 6)]
    for index in range(3):
        chunks = np.concatenate([part[index] for part in apart])
        assert relative(together[index], chunks) < 1e-14
    np.testing.assert_array_equal(together.inside, np.concatenate([part.inside for part in apart]))


@pytest.mark.skipif(platform.machine() != "x86_64", reason="looks for instructions of x86-64")
def test_several_units_are_summed_at_a_time() -> None:
    """Some versions of Python make bytecode of the same sums from which LLVM makes no vectors.

    A unit has five divisions. What is loaded from numba's cache cannot be inspected, so the sums
    are compiled again, without it.
    """
    as_there = numba.njit(fastmath=kernel._FAST, error_model="numpy")
    sum_units = as_there(kernel._sum_units.py_func)
    units, seen, near, sums = np.ones((46, 8)), np.ones((6, 8)), np.empty(8), np.zeros(10)
    sum_units((9.0, 9.0, 9.0), units, 8, seen, near, sums)
    (assembly,) = sum_units.inspect_asm().values()
    assert len(re.findall("v?divpd", assembly)) >= 5


def test_many_points_from_many_threads() -> None:
    """Each call has threads of its own."""
    shape = Polyhedron(*box(np.full(3, -1.0), np.full(3, 2.0)))
    field = GravityField(shape, density=DENSITY)
    points = np.random.default_rng(7).normal(size=(2000, 3)) * 3.0
    alone = field.evaluate(points).acceleration
    with ThreadPoolExecutor(4) as pool:
        for found in pool.map(field.evaluate, [points] * 16):
            np.testing.assert_array_equal(found.acceleration, alone)


def test_many_points_after_a_fork() -> None:
    """Threads do not survive a fork. A process of its own, because fork is for few threads."""
    code = """
import os, numpy as np
from proxops.diagrams.scenario import load_body
field, points = load_body("kleopatra").gravity_field, np.full((2000, 3), 2e5)
alone = field.evaluate(points).acceleration
child = os.fork()
if child == 0:
    os._exit(0 if np.array_equal(field.evaluate(points).acceleration, alone) else 1)
raise SystemExit(os.waitpid(child, 0)[1])
"""
    assert subprocess.run([sys.executable, "-c", code], timeout=60).returncode == 0


@pytest.mark.parametrize(
    ("kept", "says"),
    [(None, "set XDG_CACHE_HOME"), ("elsewhere", "once"), ("here", "")],
)
def test_it_says_that_it_compiles(tmp_path, monkeypatch, caplog, kept, says) -> None:
    (tmp_path / "here").mkdir()
    (tmp_path / "here" / "kernel.evaluate_points-340.py311.nbi").write_text("")
    stats = SimpleNamespace(cache_hits={}, cache_path=kept and str(tmp_path / kept))
    monkeypatch.setattr(kernel, "evaluate_points", SimpleNamespace(stats=stats))
    gravity_field._announce_compilation.__wrapped__()
    assert says in caplog.text if says else caplog.text == ""


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        ({}, "exactly one of mass"),
        ({"mass": 24000.0, "density": 1000.0}, "exactly one of mass"),
        ({"mass": np.nan}, "mass must be positive"),
        ({"density": np.inf}, "density must be positive"),
        ({"density": 1e5}, "which no body has"),
        ({"mass": 1e-6}, "in the unit that was said"),
    ],
)
def test_refusals(box_gravity: GravityField, arguments: dict, complaint: str) -> None:
    with pytest.raises(InputError, match=complaint):
        GravityField(box_gravity.shape, **arguments)
