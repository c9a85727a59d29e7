"""The shape of a body: its geometry, what it is read from, and what is refused."""

from pathlib import Path

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from plain_polyhedral_gravity import box, star_shaped

from proxops.diagrams.scenario.body import load_body
from proxops.systems.common.errors import InputError
from proxops.systems.shapes.polyhedron import Polyhedron

LOW, HIGH = np.array([-1.0, 2.0, 0.5]), np.array([1.5, 3.0, 4.0])
few = settings(max_examples=12)
seeds = st.integers(0, 2**32 - 1)
# A pebble of a millimetre, a body in metres, a planet.
sizes = pytest.mark.parametrize("size", [1e-3, 1.0, 1e9])


def test_box() -> None:
    shape = Polyhedron(*box(LOW, HIGH))
    extents = HIGH - LOW
    assert shape.volume == pytest.approx(np.prod(extents), rel=1e-14)
    np.testing.assert_allclose(shape.centre_of_mass, (LOW + HIGH) / 2, rtol=1e-14)
    np.testing.assert_array_equal(shape.extents, extents)
    outward = shape.vertices[shape.facets].mean(axis=1) - (LOW + HIGH) / 2
    assert (np.sum(outward * shape.normals, axis=1) > 0).all()
    np.testing.assert_allclose(np.abs(shape.normals).sum(axis=1), 1.0)


@few
@given(seeds, st.floats(-3, 9))
def test_random_bodies_against_trimesh(seed: int, magnitude: float) -> None:
    mesh = star_shaped(seed, subdivisions=1)
    size = 10.0**magnitude
    offset = size * np.random.default_rng(seed).uniform(-3, 3, 3)
    shape = Polyhedron(size * mesh.vertices + offset, mesh.faces)
    assert shape.volume == pytest.approx(size**3 * mesh.volume, rel=1e-12)
    centre = size * mesh.center_mass + offset
    np.testing.assert_allclose(shape.centre_of_mass, centre, rtol=0, atol=1e-12 * size)
    np.testing.assert_allclose(shape.normals, mesh.face_normals, atol=1e-9)
    recentred = shape.recentred()
    np.testing.assert_allclose(recentred.centre_of_mass, 0.0, atol=1e-12 * size)
    assert recentred.volume == pytest.approx(shape.volume, rel=1e-12)


def test_bent_body_has_its_signed_volume() -> None:
    """A horseshoe: its centre is outside it, where sums of absolute volumes go wrong."""
    outline = np.array([[0, 0], [4, 0], [4, 3], [3, 3], [3, 1], [1, 1], [1, 3], [0, 3.0]])
    squares = [[0, 1, 4, 5], [1, 2, 3, 4], [0, 5, 6, 7]]
    lid = np.array([[s[0], s[i], s[i + 1]] for s in squares for i in (1, 2)])
    n = len(outline)
    vertices = np.vstack([np.c_[outline, np.zeros(n)], np.c_[outline, np.ones(n)]])
    walls = []
    for i in range(n):
        j = (i + 1) % n
        walls += [[i, j, n + j], [i, n + j, n + i]]
    shape = Polyhedron(vertices, np.concatenate([lid[:, ::-1], lid + n, walls]))
    assert shape.volume == pytest.approx(4 * 3 - 2 * 2, rel=1e-14)
    centre = (12 * np.array([2, 1.5]) - 4 * np.array([2, 2.0])) / 8
    np.testing.assert_allclose(shape.centre_of_mass, [*centre, 0.5], rtol=1e-14)


@pytest.mark.parametrize("body", ["kleopatra", 0, 1])
def test_edges(body: str | int) -> None:
    """Each edge once; its first facet runs along it, its second back."""
    if isinstance(body, str):
        shape = load_body(body).shape
    else:
        shape = Polyhedron.from_trimesh(star_shaped(body), "m")
    edges, neighbours = shape.edges
    assert len(edges) == 3 * len(shape.facets) // 2
    assert len(edges) == len(shape.vertices) + len(shape.facets) - 2
    assert len(np.unique(np.sort(edges, axis=1), axis=0)) == len(edges)
    assert (neighbours[:, 0] != neighbours[:, 1]).all()
    for side, ends in enumerate((edges, edges[:, ::-1])):
        corners = shape.facets[neighbours[:, side]]
        runs = [(corners[:, [k, (k + 1) % 3]] == ends).all(axis=1) for k in range(3)]
        assert np.any(runs, axis=0).all()


def test_hash_names_the_shape() -> None:
    vertices, facets = box(LOW, HIGH)
    shape = Polyhedron(vertices, facets, "a")
    assert shape.sha256 == Polyhedron(vertices.copy(), facets.astype(np.int32), "b").sha256
    assert shape.sha256 != Polyhedron(vertices * 2, facets).sha256
    assert shape.sha256 != Polyhedron(vertices, np.roll(facets, 1, axis=0)).sha256


def test_shape_cannot_be_changed_behind_its_back() -> None:
    vertices, facets = box(LOW, HIGH)
    shape = Polyhedron(vertices, facets)
    vertices[0] = 99.0
    assert shape.vertices.max() < 99.0
    with pytest.raises(ValueError, match="read-only"):
        shape.vertices[0] = 1.0
    with pytest.raises(ValueError, match="read-only"):
        shape.facets[0] = 1


# --- files ----------------------------------------------------------------------------------------


def test_loads_polygons_text_path_and_default_unit(tmp_path: Path) -> None:
    """OBJ facets with four corners, and a path given as text; kilometres unless said otherwise."""
    path = tmp_path / "cube.obj"
    corners = "".join(f"v {i} {j} {k}\n" for i in (0, 1) for j in (0, 1) for k in (0, 1))
    squares = ["1 2 4 3", "5 7 8 6", "1 5 6 2", "3 4 8 7", "1 3 7 5", "2 6 8 4"]
    path.write_text("# a cube\n" + corners + "".join(f"f {square}\n" for square in squares))
    shape = Polyhedron.load(str(path))
    assert shape.facets.shape == (12, 3)
    assert shape.volume == pytest.approx(1e9)


# --- refusals -------------------------------------------------------------------------------------


def _mixed(v: np.ndarray, f: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    f[5] = f[5, ::-1]
    return v, f


def _nan(v: np.ndarray, f: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    v[7, 1] = np.nan
    return v, f


def _duplicate(v: np.ndarray, f: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Facet 0 with a private copy of its first vertex."""
    f = f.copy()
    v = np.vstack([v, v[f[0, 0]]])
    f[0, 0] = len(v) - 1
    return v, f


def _index_too_large(v: np.ndarray, f: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    f[3, 1] = len(v)
    return v, f


def _no_height(v: np.ndarray, f: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A tetrahedron whose four corners lie in a plane."""
    size = np.abs(v).max()
    corners = size * np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0.3, 0.3, 0]])
    return corners, np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])


@sizes
@pytest.mark.parametrize(
    ("spoil", "complaint"),
    [
        (lambda v, f: (v, f[1:]), "has holes: 3 edges"),
        (lambda v, f: (v, f[:, ::-1]), "is inside out"),
        (_mixed, r"mixed winding: .* \(3 such edges"),
        (_nan, "vertex 7 is .*, not finite"),
        (_duplicate, "1 duplicate vertices"),
        (_no_height, "encloses no volume"),
        (_index_too_large, "names a vertex outside"),
    ],
)
def test_unsound_mesh_is_refused_at_any_size(size: float, spoil, complaint: str) -> None:
    mesh = star_shaped(2, subdivisions=1, size=size)
    vertices, facets = np.array(mesh.vertices), np.array(mesh.faces)
    Polyhedron(vertices, facets)  # Sound before it is spoilt.
    with pytest.raises(InputError, match=f"^lump.*({complaint})"):
        Polyhedron(*spoil(vertices, facets), name="lump")


@sizes
def test_thin_but_sound_bodies_pass_at_any_size(size: float) -> None:
    """A needle and a plate of 1:1000, far from the origin."""
    for thin in ([1.0, 1e-3, 1e-3], [1.0, 1.0, 1e-3]):
        low = size * np.array([5.0, -3.0, 4.0])
        shape = Polyhedron(*box(low, low + size * np.array(thin)))
        assert shape.volume == pytest.approx(size**3 * np.prod(thin), rel=1e-9)


def test_the_centre_of_mass_does_not_depend_on_the_order_of_sums() -> None:
    """So it is the same on every processor, to the last bit, and with it the shape's hash."""
    ball = trimesh.creation.icosphere(subdivisions=3, radius=7.3)
    ball.vertices *= 1.0 + 0.1 * np.sin(3.0 * ball.vertices)
    order = np.random.default_rng(5).permutation(len(ball.faces))
    one = Polyhedron(ball.vertices, ball.faces)
    other = Polyhedron(ball.vertices, ball.faces[order])
    np.testing.assert_array_equal(one.centre_of_mass, other.centre_of_mass)
