"""The shipped shape of Kleopatra, checked by means other than those that built it."""

import math

import numpy as np
import pytest
import trimesh
import yaml

from proxops.assets import ASSETS, loft

# Facts of the radar model that the table was measured on (Ostro et al. 2000).
RADAR_VOLUME_KM3 = 708_868.0
RADAR_EXTENTS_KM = (217.0, 94.0, 81.0)


@pytest.fixture(scope="module")
def mesh() -> trimesh.Trimesh:
    return trimesh.load_mesh(ASSETS / "kleopatra/kleopatra.obj", process=False)


@pytest.fixture(scope="module")
def sections() -> np.ndarray:
    return loft.read_sections()


@pytest.fixture(scope="module")
def surface(sections: np.ndarray) -> trimesh.Trimesh:
    return loft.loft(sections)


@pytest.fixture(scope="module")
def constants() -> dict:
    return yaml.safe_load((ASSETS / "kleopatra/kleopatra.yaml").read_text(encoding="utf-8"))


def signed_volume(corners: np.ndarray) -> float:
    """Volume by the divergence theorem, corners (F, 3 corners, 3); negative if inside out."""
    return float(np.linalg.det(corners).sum() / 6)


def test_loft_of_a_cylinder_with_cones(tmp_path) -> None:
    """Prisms and pyramids over a regular hexagon: the volume is exact."""
    rows = ["0,0,0" + ",0" * 6, "1,0,0" + ",2" * 6, "4,0,0" + ",2" * 6, "6,0,0" + ",0" * 6]
    path = tmp_path / "radii.csv"
    path.write_text("header\n" + "\n".join(rows))
    body = loft.loft(loft.read_sections(path))
    hexagon = 6 * math.sqrt(3)
    assert body.is_watertight
    assert signed_volume(body.triangles) == pytest.approx(hexagon * (1 / 3 + 3 + 2 / 3), rel=1e-12)


def test_loft_matches_the_radar_model(surface: trimesh.Trimesh) -> None:
    assert surface.vertices.shape == (96 * 64 + 2, 3)
    assert surface.is_volume
    assert surface.euler_number == 2
    assert surface.volume == pytest.approx(0.9975 * RADAR_VOLUME_KM3, rel=2e-4)
    np.testing.assert_allclose(surface.extents, RADAR_EXTENTS_KM, atol=3)
    np.testing.assert_allclose(surface.center_mass, 0, atol=0.02)


@pytest.mark.parametrize(("cap", "band"), [(1, 2), (2, 2), (3, 4), (8, 42)])
def test_geodesic_capsule_is_closed(cap: int, band: int) -> None:
    ring, azimuth, faces = loft.geodesic_capsule(cap, band)
    assert len(faces) == 10 * cap * (cap + band)
    assert len(ring) == len(azimuth) == len(faces) // 2 + 2  # Euler's formula, genus 0
    directed = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    edges = {tuple(edge) for edge in directed.tolist()}
    assert len(edges) == len(directed)  # each edge once in either direction: closed, consistent
    assert edges == {(b, a) for a, b in edges}
    degree = np.bincount(faces.ravel())
    assert (degree == 5).sum() == 12
    assert (degree == 6).sum() == len(ring) - 12
    x = ring / ring[-1] * 2 - 1
    radius = np.sqrt(1 - x**2)
    sphere = np.stack([x, radius * np.cos(azimuth), radius * np.sin(azimuth)], axis=1)
    assert signed_volume(sphere[faces]) > 0


def test_mesh_has_good_facets(mesh: trimesh.Trimesh) -> None:
    side = mesh.triangles - np.roll(mesh.triangles, -1, axis=1)
    side /= np.linalg.norm(side, axis=2, keepdims=True)
    angle = np.degrees(np.arccos(np.clip(-np.sum(side * np.roll(side, 1, axis=1), axis=2), -1, 1)))
    np.testing.assert_allclose(angle.sum(axis=1), 180, atol=1e-6)
    assert angle.min() > 35
    assert np.degrees(mesh.face_adjacency_angles.max()) < 60  # no facet folded over its neighbour


def test_mesh_follows_the_loft(mesh: trimesh.Trimesh, surface: trimesh.Trimesh) -> None:
    assert mesh.volume == pytest.approx(surface.volume, rel=3e-3)
    for source, target in ((mesh, surface), (surface, mesh)):
        points, *_ = trimesh.sample.sample_surface(source, 5000, seed=20)
        _, distance, _ = trimesh.proximity.closest_point(target, points)
        assert math.sqrt(np.mean(distance**2)) < 0.1
        assert distance.max() < 1.0


def test_origin_is_the_centre_of_mass(mesh: trimesh.Trimesh) -> None:
    tetrahedra = np.linalg.det(mesh.triangles) / 6
    centre = (tetrahedra[:, None] * mesh.triangles.sum(axis=1) / 4).sum(axis=0) / tetrahedra.sum()
    np.testing.assert_allclose(centre, 0, atol=1e-4)  # 0.1 m


def test_long_axis_is_x_and_spin_axis_is_z(mesh: trimesh.Trimesh) -> None:
    np.testing.assert_allclose(mesh.extents, RADAR_EXTENTS_KM, atol=3)
    moments = np.diag(mesh.moment_inertia)
    assert moments[0] < moments[1] < moments[2]


def test_keep_out_ellipsoid_holds_the_body(
    mesh: trimesh.Trimesh, surface: trimesh.Trimesh, constants: dict
) -> None:
    semi_axes_km = np.array(constants["keep_out_semi_axes_m"]) / 1e3
    for body in (mesh, surface):
        scale = np.linalg.norm(body.vertices / semi_axes_km, axis=1)
        assert 1 / scale.max() >= 1.05
