"""The mesh doctor's findings against solids whose defects and figures are known."""

import re
from fractions import Fraction

import numpy as np
import pytest
import trimesh
from contact_binary import contact_binary, together
from hypothesis import given, settings
from hypothesis import strategies as st
from plain_polyhedral_gravity import box, star_shaped

from proxops.systems.common.errors import InputError
from proxops.systems.shapes.enclosing_ellipsoid import smallest_ellipsoid
from proxops.systems.shapes.mass import mass_properties
from proxops.systems.shapes.mesh_checks import (
    find_defects,
    nested_shells,
    shell_labels,
    smallest_angles,
    winding_number,
)
from proxops.systems.shapes.polyhedron import Polyhedron
from proxops.systems.shapes.self_intersection import self_intersections

sizes = pytest.mark.parametrize("size", [1e-6, 1.0, 1e9])
few = settings(max_examples=10)
seeds = st.integers(0, 2**32 - 1)


def arrays(mesh: trimesh.Trimesh) -> tuple[np.ndarray, np.ndarray]:
    return np.array(mesh.vertices), np.array(mesh.faces)


def joined(*meshes: trimesh.Trimesh) -> tuple[np.ndarray, np.ndarray]:
    return arrays(together(*meshes))


def ball(radius: float = 1.0, x: float = 0.0, inwards: bool = False) -> trimesh.Trimesh:
    mesh = trimesh.creation.icosphere(2, radius=radius)
    mesh.apply_translation([x, 0.0, 0.0])
    if inwards:
        mesh.invert()
    return mesh


# --- defects --------------------------------------------------------------------------------------


@sizes
def test_sound_bodies_have_no_defects(size: float) -> None:
    for vertices, facets in (
        arrays(star_shaped(3)),
        arrays(contact_binary(1.0, 3)),
        box(np.zeros(3), np.array([1.0, 2.0, 1e-3])),
        joined(ball(2.0), ball(1.0, inwards=True)),  # A shell around a void.
        joined(ball(2.0), ball(1.0, inwards=True), ball(0.4)),  # And a stone in the void.
        joined(ball(1.0), ball(1.0, x=3.0)),
    ):
        moved = size * (vertices + [7.0, -5.0, 3.0])
        assert find_defects(moved, facets) == []
        assert len(self_intersections(moved, facets)) == 0


@sizes
@pytest.mark.parametrize(
    ("body", "kind", "wrong"),
    [
        (joined(ball(2.0), ball(1.0)), "shell in shell", 320),  # A void wound as a stone?
        (joined(ball(2.0), ball(1.0, x=4.0, inwards=True)), "inside out", 320),
        (joined(ball(2.0, inwards=True), ball(1.0, x=4.0, inwards=True)), "inside out", 640),
    ],
)
def test_shells_wound_the_wrong_way(size: float, body, kind: str, wrong: int) -> None:
    """Though, but for the last, the sum of their volumes is positive."""
    (defect,) = find_defects(size * body[0], body[1])
    assert defect.kind == kind
    assert len(defect.facets) == wrong
    with pytest.raises(InputError, match=re.escape(defect.text)):
        Polyhedron(size * body[0], body[1])


def test_all_defects_are_named_with_their_places() -> None:
    vertices, facets = arrays(ball())
    facets = facets[facets[:, 0] != facets[17, 0]]  # A fan is gone.
    facets[40] = facets[40, ::-1]
    facets = np.vstack([facets, facets[60, [0, 0, 1]]])
    found = {defect.kind: defect for defect in find_defects(vertices, facets)}
    assert set(found) == {"no area", "holes", "mixed winding", "crowded edges"}
    assert found["no area"].facets.tolist() == [len(facets) - 1]
    assert 1 <= len(found["mixed winding"].facets) <= 3
    assert "holes" in found["holes"].about("the rock")
    assert found["holes"].about("the rock").startswith("the rock has holes: ")


def test_shells_and_winding_numbers() -> None:
    vertices, facets = joined(ball(2.0), ball(1.0, inwards=True), ball(1.0, x=5.0))
    count, labels = shell_labels(facets, len(vertices))
    assert count == 3
    np.testing.assert_array_equal(labels, np.repeat([0, 1, 2], 320))
    for x, expected in ((0.0, 0.0), (1.5, 1.0), (3.0, 0.0), (5.0, 1.0)):
        point = np.array([x, 0.01, 0.02])
        assert winding_number(vertices, facets, point) == pytest.approx(expected, abs=1e-12)


def test_smallest_angles() -> None:
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0.5, np.sqrt(0.75), 0], [1, 1e-9, 0]])
    facets = np.array([[0, 1, 2], [0, 1, 3], [0, 1, 4], [0, 1, 1]])
    angles = smallest_angles(corners, facets)
    np.testing.assert_allclose(angles, [45.0, 60.0, np.degrees(1e-9), 0.0], rtol=1e-12)
    mesh = star_shaped(4)
    expected = np.degrees(mesh.face_angles.min(axis=1))
    np.testing.assert_allclose(smallest_angles(*arrays(mesh)), expected, rtol=1e-9)


# --- self-intersection ----------------------------------------------------------------------------


def _pair(second: list[list[float]], share: int = 0) -> int:
    """Counts the intersections of a triangle in z = 0 and a second one; they may share corners."""
    first = np.array([[0, 0, 0], [4, 0, 0], [0, 4, 0.0]])
    vertices = np.vstack([first, second])
    facets = np.array([[0, 1, 2], [*range(share), *range(3, 6 - share)]])
    return len(self_intersections(vertices, facets))


@pytest.mark.parametrize(
    ("second", "share", "meet"),
    [
        ([[1, 1, -1], [1, 1, 1], [9, 9, 1]], 0, 1),  # Pierces it.
        ([[1, 1, 0.1], [1, 1, 1], [9, 9, 1]], 0, 0),  # Above it.
        ([[1, 1, 0], [1, 2, 1], [2, 1, 1]], 0, 1),  # Stands on it with a corner,
        ([[0, 2, 0], [-1, 2, 1], [-1, 2, -1]], 0, 1),  # touches its rim,
        ([[4, 0, 0], [5, 0, 1], [5, 1, 1]], 0, 1),  # its corner.
        ([[5, 5, -1], [5, 5, 1], [9, 9, 1]], 0, 0),  # Through its plane, beside it.
        ([[1, 1, 0], [2, 1, 0], [1, 2, 0]], 0, 1),  # In its plane: within it,
        ([[-9, -9, 0], [30, -9, 0], [-9, 30, 0]], 0, 1),  # around it,
        ([[-1, 1, 0], [5, 1, 0], [-1, 2, 0]], 0, 1),  # across it,
        ([[2, 2, 0], [4, 4, 0], [5, 3, 0]], 0, 1),  # at its rim,
        ([[3, 3, 0], [4, 4, 0], [5, 3, 0]], 0, 0),  # beside it.
        ([[1, 0, 0], [1, 4, 0], [1, 1, 4]], 0, 1),  # An edge lies in it.
        ([[-1, -1, 1], [-1, 1, 1]], 1, 0),  # From a common corner: away,
        ([[-1, -1, 0], [-1, 0, 0]], 1, 0),  # away in its plane,
        ([[2, 1, 0], [1, 2, 0]], 1, 1),  # into it, in its plane,
        ([[9, 3, 0], [3, 9, 0]], 1, 1),  # over it,
        ([[3, 3, -1], [3, 3, 1]], 1, 1),  # cutting through its far edge,
        ([[1, 1, -1], [1, 1, 1]], 1, 1),  # cutting it in the middle,
        ([[1, 1, 0], [1, 1, 1]], 1, 1),  # along it.
        ([[0, -4, 0]], 2, 0),  # From a common edge: the plane goes on,
        ([[0, 4, 1e-9]], 2, 0),  # folded, not quite,
        ([[1, 4, 0]], 2, 1),  # folded back onto itself,
        ([[0, 4, 0]], 2, 1),  # a copy with its own corner.
    ],
)
def test_two_triangles(second, share: int, meet: int) -> None:
    assert _pair(second, share) == meet


@few
@given(seeds)
def test_pairs_against_sampling(seed: int) -> None:
    """Random pairs of triangles against where the other's edges pass through each."""
    rng = np.random.default_rng(seed)
    vertices = rng.normal(size=(6, 3))
    found = len(self_intersections(vertices, np.arange(6).reshape(2, 3)))
    crossed = False
    for one, other in ((vertices[:3], vertices[3:]), (vertices[3:], vertices[:3])):
        for k in range(3):
            p, q = one[k], one[(k + 1) % 3]
            a, b, c = other
            # p + t (q - p) = a + u (b - a) + v (c - a)
            t, u, v = np.linalg.solve(np.stack([p - q, b - a, c - a], axis=1), p - a)
            crossed |= 0 <= t <= 1 and u >= 0 and v >= 0 and u + v <= 1
    assert found == crossed


def test_exact_where_rounding_decides() -> None:
    """A corner one unit in the last place on either side of a slanting plane."""
    base = np.array([[0.1, 0.2, 0.3], [1.7, 0.4, 0.9], [0.3, 1.9, 0.6]])
    corner = 0.25 * base[0] + 0.25 * base[1] + 0.5 * base[2]
    apex = corner + [0.1, 0.2, 1.0]
    results = []
    for nudge in range(-4, 5):
        tip = corner.copy()
        tip[2] += nudge * np.spacing(tip[2])
        rows = [[Fraction(x) - Fraction(y) for x, y in zip(p, tip, strict=True)] for p in base]
        (a, b, c), (d, e, f), (g, h, i) = rows
        below = a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g)
        vertices = np.vstack([base, tip, apex, apex + [0.3, 0.0, 0.1]])
        meet = len(self_intersections(vertices, np.arange(6).reshape(2, 3))) == 1
        # The others are above the plane; so the tip must not be.
        above = np.linalg.det(base - apex)
        assert meet == (below == 0 or (below > 0) != (above > 0))
        results.append(meet)
    assert len(set(results)) == 2


@sizes
def test_overlapping_lobes(size: float) -> None:
    """Two balls that were put together without making one surface of them."""
    vertices, facets = joined(ball(), ball(x=1.1))
    pairs = self_intersections(size * vertices, facets)
    assert len(pairs) > 50
    assert (pairs[:, 0] < 320).all()
    assert (pairs[:, 1] >= 320).all()
    # The balls meet where x = 0.55.
    corners = vertices[facets[np.unique(pairs)]]
    assert (corners[:, :, 0].min(axis=1) < 0.56).all()
    assert (corners[:, :, 0].max(axis=1) > 0.54).all()


@few
@given(seeds)
def test_flat_sides_do_not_cut_themselves(seed: int) -> None:
    """A box of many facets, turned: all its neighbours are coplanar but for rounding."""
    mesh = trimesh.creation.box((1.0, 2.0, 3.0)).subdivide().subdivide()
    if seed % 2:
        mesh.apply_transform(trimesh.transformations.random_rotation_matrix(
            np.random.default_rng(seed).random(3)
        ))  # fmt: skip
    assert len(self_intersections(*arrays(mesh))) == 0


# --- figures --------------------------------------------------------------------------------------


def test_moments_of_a_box_and_a_tetrahedron() -> None:
    extents = np.array([4.0, 2.0, 1.0])
    found = mass_properties(*box(np.array([5.0, 6, 7]), np.array([5.0, 6, 7]) + extents))
    assert found.volume == pytest.approx(8.0, rel=1e-14)
    assert found.area == pytest.approx(28.0, rel=1e-14)
    np.testing.assert_allclose(found.centre_of_mass, [7.0, 7.0, 7.5], rtol=1e-14)
    squares = extents**2
    expected = 8.0 / 12.0 * (squares.sum() - squares)
    np.testing.assert_allclose(found.inertia, np.diag(expected), atol=1e-12)
    np.testing.assert_allclose(found.principal_moments, expected, rtol=1e-13)
    np.testing.assert_allclose(found.principal_axes, np.eye(3), atol=1e-12)
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]])
    found = mass_properties(corners, np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]]))
    # About the centroid: 1/80 on the diagonal, 1/480 off it.
    expected = np.full((3, 3), 1 / 480) + np.eye(3) * (1 / 80 - 1 / 480)
    np.testing.assert_allclose(found.inertia, expected, rtol=1e-12)


@few
@given(seeds)
def test_moments_against_trimesh(seed: int) -> None:
    mesh = star_shaped(seed, size=300.0)
    mesh.apply_translation(np.random.default_rng(seed).uniform(-900, 900, 3))
    found = mass_properties(*arrays(mesh))
    scale = np.abs(mesh.moment_inertia).max()
    np.testing.assert_allclose(found.inertia, mesh.moment_inertia, atol=1e-9 * scale)
    np.testing.assert_allclose(found.centre_of_mass, mesh.center_mass, atol=1e-9)
    axes = found.principal_axes
    np.testing.assert_allclose(axes @ axes.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(axes) == pytest.approx(1.0)
    turned = axes @ found.inertia @ axes.T
    np.testing.assert_allclose(turned, np.diag(found.principal_moments), atol=1e-9 * scale)


@sizes
def test_smallest_ellipsoids_in_closed_form(size: float) -> None:
    low = np.array([-1.0, -2.0, -0.5])
    corners, _ = box(size * low, -size * low)
    found = smallest_ellipsoid(corners)
    np.testing.assert_allclose(found.semi_axes, -np.sqrt(3.0) * size * low, rtol=1e-4)
    assert found.level < 1.0
    # Kept apart from any other by the bound.
    assert 1.0 <= found.volume / found.volume_bound < 1.0 + 1e-6
    found = smallest_ellipsoid(size * np.array([3.0, 1.0, 2.0]) * np.array(ball().vertices), 0.1)
    np.testing.assert_allclose(found.semi_axes, 1.1 * size * np.array([3, 1, 2]), rtol=2e-3)
    assert found.level == pytest.approx(1 / 1.1**2, rel=1e-6)


@few
@given(seeds)
def test_no_other_ellipsoid_is_smaller(seed: int) -> None:
    mesh = star_shaped(seed, size=1e3)
    points = np.array(mesh.vertices) - mesh.center_mass
    found = smallest_ellipsoid(points)
    levels = np.sum((points / found.semi_axes) ** 2, axis=1)
    assert levels.max() == found.level == levels[found.farthest]
    assert 1.0 - 1e-9 < found.level < 1.0
    assert 1.0 <= found.volume / found.volume_bound < 1.0 + 1e-6
    rng = np.random.default_rng(seed)
    for _ in range(50):
        axes = found.semi_axes * np.exp(rng.normal(scale=0.1, size=3))
        axes *= np.sqrt(np.sum((points / axes) ** 2, axis=1).max())
        assert axes.prod() >= found.semi_axes.prod() * (1.0 - 1e-9)


def test_ellipsoids_that_there_are_not() -> None:
    for points, margin, complaint in (
        (np.eye(3), -0.1, "margin"),
        (np.eye(3), np.nan, "margin"),
        (np.eye(3) * [1, 1, 0], 0.1, "in a plane"),
    ):
        with pytest.raises(InputError, match=complaint):
            smallest_ellipsoid(points, margin)


@pytest.mark.slow
def test_thousands_of_shells_side_by_side() -> None:
    """Each pair of them was looked at in full, which took an hour."""
    count = 3000
    tetrahedron = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], dtype=float)
    corners = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
    shift = np.arange(count)[:, None, None] * np.array([2.0, 0.0, 0.0])
    vertices = (tetrahedron + shift).reshape(-1, 3)
    facets = (corners + 4 * np.arange(count)[:, None, None]).reshape(-1, 3)
    assert not nested_shells(vertices, facets).inside_out.size
    facets[8:12] = facets[8:12, ::-1]
    np.testing.assert_array_equal(nested_shells(vertices, facets).inside_out, [2])
