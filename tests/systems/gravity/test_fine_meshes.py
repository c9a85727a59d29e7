"""Gravity of meshes with many facets: by quadrature, from a coarser table, and to scale."""

import functools

import numpy as np
import pytest
import trimesh
from short_flights import kleopatra

from proxops.diagrams.scenario.scenario_config import TruthConfig
from proxops.diagrams.scenario.true_body import make_true_body
from proxops.systems.gravity import (
    FINE_MESH,
    GravityField,
    ScaledField,
    TabulatedField,
    tabulated_field,
)
from proxops.systems.shapes import Polyhedron

FORM = np.array([1000.0, 600.0, 500.0])
AXES = 2.0 * FORM


@functools.cache
def egg(subdivisions: int) -> GravityField:
    """An ellipsoid with the narrow end along x."""
    ball = trimesh.creation.icosphere(subdivisions=subdivisions)
    points = ball.vertices * FORM * (1.0 + 0.1 * ball.vertices[:, :1])
    return GravityField(Polyhedron(points, ball.faces, "an egg"), density=2000.0, contrast=0.2)


def directions(count: int) -> np.ndarray:
    points = np.random.default_rng(3).normal(size=(count, 3))
    return points / np.linalg.norm(points, axis=1)[:, None]


def test_quadrature_gives_what_the_closed_sums_give() -> None:
    """From half a facet over the surface to far beyond."""
    field, ways = egg(4), directions(60)
    height = np.repeat([20.0, 200.0, 5000.0], 20)[:, None]
    points = ways * FORM * (1.0 + 0.1 * ways[:, :1]) + height * ways
    have, want = field.outer_columns(points), field.columns(points)
    for part, bound in ((slice(0, 1), 1e-6), (slice(1, 4), 2e-6), (slice(4, 13), 1e-5)):
        apart = np.linalg.norm(have[:, part] - want[:, part], axis=1)
        assert np.max(apart / np.linalg.norm(want[:, part], axis=1)) < bound
    np.testing.assert_array_equal(have[:, 13], 0.0)


def test_table_of_a_fine_mesh_is_within_its_bound(monkeypatch, tmp_path) -> None:
    monkeypatch.setattr(tabulated_field, "FINE_MESH", 1000)
    monkeypatch.setattr(tabulated_field, "_FINE_USUAL", 1e-2)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    field = egg(3)
    monkeypatch.setattr(
        field, "columns", lambda points: pytest.fail("the closed sums took part")
        if len(points) > 1000 else GravityField.columns(field, points),
    )  # fmt: skip
    table = TabulatedField(field, AXES)
    points = directions(200) * AXES * np.linspace(1.0, 3.0, 200)[:, None]
    have, want = table.evaluate(points).acceleration, field.evaluate(points).acceleration
    apart = np.linalg.norm(have - want, axis=1) / np.linalg.norm(want, axis=1)
    assert np.max(apart) < 1e-2


def test_scaled_field_is_that_of_the_scaled_body() -> None:
    known = egg(2)
    shape = Polyhedron(1.3 * known.shape.vertices, known.shape.facets, "a larger egg")
    scaled = ScaledField(known, shape, 0.7 * known.mass)
    other = GravityField(shape, mass=0.7 * known.mass, contrast=0.2)
    points = np.concatenate([1.1 * FORM * directions(20), [[100.0, 50.0, -80.0]]])
    for have, want in zip(scaled.evaluate(points), other.evaluate(points), strict=True):
        np.testing.assert_allclose(have, want, rtol=1e-9, atol=1e-9 * np.abs(want).max())
    np.testing.assert_allclose(scaled.centre_of_mass, other.centre_of_mass, atol=1e-9)


def test_a_fine_true_mesh_has_a_table_that_serves_every_size_and_mass(
    monkeypatch, tmp_path
) -> None:
    """The table alone is replaced here, by the exact field: to make it takes too long."""
    made = []

    def exact(field: GravityField, axes: np.ndarray) -> GravityField:
        made.append(axes)
        return field

    monkeypatch.setattr("proxops.diagrams.scenario.true_body.TabulatedField", exact)
    body = kleopatra()
    mesh = body.shape.to_trimesh().subdivide()
    mesh.vertices *= 0.99
    assert len(mesh.faces) > FINE_MESH
    mesh.export(tmp_path / "fine.obj")
    truth = TruthConfig(mesh=str(tmp_path / "fine.obj"), mesh_unit="m", size=1.02, gravity=0.9)
    true_body = make_true_body(body, truth)
    again = make_true_body(body, TruthConfig(mesh=truth.mesh, mesh_unit="m", size=0.98))
    assert len(made) == 1
    assert np.all(made[0] >= body.keep_out_semi_axes)
    exactly = GravityField(true_body.shape, mass=0.9 * body.gravity_field.mass)
    points = body.keep_out_semi_axes * directions(3) * 1.5
    np.testing.assert_allclose(
        true_body.gravity_field.evaluate(points).acceleration,
        exactly.evaluate(points).acceleration,
        rtol=1e-9,
    )
    assert again.gravity_field.mass == body.gravity_field.mass
