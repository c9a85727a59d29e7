"""True bodies that differ from the map: displaced, registered, cut in two, of two densities."""

import pickle
from collections.abc import Callable

import numpy as np
import pytest
import trimesh
from contact_binary import contact_binary, together
from gauss_law import outward_flux
from plain_polyhedral_gravity import G, PlainPolyhedralGravity, box
from scipy.spatial.transform import Rotation

from proxops.diagrams.scenario.body import load_body
from proxops.systems.common.errors import InputError
from proxops.systems.gravity.gravity_field import GravityField
from proxops.systems.shapes import Polyhedron, displaced, halves, registered, roughened
from proxops.systems.shapes.displacement import random_field

MASS = 2.97e18


@pytest.fixture(scope="module")
def kleopatra() -> Polyhedron:
    return load_body("kleopatra").shape


@pytest.fixture(scope="module")
def binary() -> Polyhedron:
    return Polyhedron.from_trimesh(contact_binary(subdivisions=3), "m")


def ball(radius: float = 1.0, centre: tuple = (0.0, 0.0, 0.0)) -> trimesh.Trimesh:
    mesh = trimesh.creation.icosphere(2, radius)
    return trimesh.Trimesh(mesh.vertices + centre, mesh.faces, process=False)


def two_balls() -> Polyhedron:
    return Polyhedron.from_trimesh(together(ball(1.0, (-1.5, 0, 0)), ball(1.0, (1.5, 0, 0))), "m")


# --- displaced ------------------------------------------------------------------------------------


def test_displacement_has_its_rms(kleopatra) -> None:
    """Over the facets: the mean of the squares at their corners, weighted by their areas."""
    moved = displaced(kleopatra, 500.0, 15e3, 3)
    squares = ((moved.vertices - kleopatra.vertices) ** 2).sum(axis=1)
    mesh = kleopatra.to_trimesh()
    mean = np.average(squares[kleopatra.facets].mean(axis=1), weights=mesh.area_faces)
    assert np.sqrt(mean) == pytest.approx(500.0, rel=1e-12)
    np.testing.assert_array_equal(moved.facets, kleopatra.facets)


def test_displacement_is_along_the_normals(kleopatra) -> None:
    shift = displaced(kleopatra, 500.0, 15e3, 3).vertices - kleopatra.vertices
    length = np.linalg.norm(shift, axis=1)
    normals = np.zeros_like(kleopatra.vertices)
    mesh = kleopatra.to_trimesh()
    for facet, normal, area in zip(mesh.faces, mesh.face_normals, mesh.area_faces, strict=True):
        normals[facet] += area * normal
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    np.testing.assert_allclose(np.abs(np.sum(shift * normals, axis=1)), length, rtol=1e-8)


def test_no_rigid_motion_is_left(kleopatra) -> None:
    """The best fit of a motion to the heights, by least squares over the surface, is none."""
    shift = displaced(kleopatra, 500.0, 15e3, 4).vertices - kleopatra.vertices
    heights = np.linalg.norm(shift, axis=1)
    normals = shift / heights[:, None]  # Up to the sign, which is also the height's.
    areas = np.zeros(len(shift))
    np.add.at(areas, kleopatra.facets.ravel(), np.repeat(kleopatra.to_trimesh().area_faces, 3))
    rows = np.hstack([normals, np.cross(kleopatra.vertices / 1e5, normals)])
    fit = np.linalg.lstsq(rows * np.sqrt(areas)[:, None], heights * np.sqrt(areas))[0]
    assert np.abs(fit).max() < 1e-9


def test_covariance_of_the_field() -> None:
    """Mean of products over 2,000 seeds, at distances up to three correlation lengths."""
    length = 7.0
    points = np.c_[np.linspace(0.0, 3.0 * length, 7), np.zeros(7), np.zeros(7)]
    turned = points @ Rotation.from_rotvec([0.3, 1.0, -0.4]).as_matrix()
    fields = np.array([random_field(turned + 50.0, length, seed) for seed in range(2000)])
    expected = np.exp(-(np.subtract.outer(points[:, 0], points[:, 0]) ** 2) / (2.0 * length**2))
    np.testing.assert_allclose(fields.T @ fields / len(fields), expected, atol=0.1)
    assert np.abs(fields.mean(axis=0)).max() < 0.1
    kurtosis = (fields**4).mean() / (fields**2).mean() ** 2
    assert kurtosis == pytest.approx(3.0, abs=0.2)  # As of a Gaussian.


def test_a_roughened_map_may_cross_itself(kleopatra: Polyhedron) -> None:
    """Where it need not, it is the displaced one."""
    np.testing.assert_array_equal(
        roughened(kleopatra, 500.0, 15e3, 3).vertices, displaced(kleopatra, 500.0, 15e3, 3).vertices
    )
    with pytest.raises(InputError, match="smaller rms"):
        displaced(kleopatra, 8e3, 5e3, 3)
    rough = GravityField(roughened(kleopatra, 8e3, 5e3, 3), mass=1e18)
    far = 1e7 * np.eye(3)
    np.testing.assert_allclose(
        rough.evaluate(far).acceleration,
        GravityField(kleopatra, mass=1e18).evaluate(far).acceleration,
        atol=1e-3 * 6.674e-11 * 1e18 / 1e14,
    )


def test_covariance_of_a_displaced_ball() -> None:
    """Over seeds and pairs of vertices: of a field finer than the body the fit takes little."""
    shape, length = Polyhedron.from_trimesh(ball(), "m"), 0.3
    bodies = [displaced(shape, 0.01, length, seed).vertices for seed in range(40)]
    heights = np.linalg.norm(bodies, axis=2) - 1.0
    distances = np.linalg.norm(shape.vertices[:, None] - shape.vertices, axis=2)
    products = heights.T @ heights / len(heights) / 0.01**2
    for near in (0.0, 0.3, 0.6, 1.2):
        pairs = np.abs(distances - near) < 0.03
        expected = np.exp(-(distances[pairs] ** 2) / (2.0 * length**2)).mean()
        assert products[pairs].mean() == pytest.approx(expected, abs=0.1)


def test_seeds_and_scale_of_a_displacement(binary) -> None:
    one, same, other = (displaced(binary, 3.0, 60.0, seed) for seed in (1, 1, 2))
    np.testing.assert_array_equal(one.vertices, same.vertices)
    assert np.abs(one.vertices - other.vertices).max() > 3.0
    large = Polyhedron(1e3 * binary.vertices, binary.facets)
    scaled = displaced(large, 3e3, 60e3, 1)
    np.testing.assert_allclose(scaled.vertices, 1e3 * one.vertices, rtol=0, atol=1e-6)
    assert displaced(binary, 0.0, 60.0, 1) is binary


# --- registered -----------------------------------------------------------------------------------


def thrown(shape: Polyhedron, seed: int) -> Polyhedron:
    """The shape off by 5 % of its size and 5 degrees."""
    rng = np.random.default_rng(seed)
    axis, way = (v / np.linalg.norm(v) for v in rng.normal(size=(2, 3)))
    turn = Rotation.from_rotvec(np.radians(5.0) * axis).as_matrix()
    vertices = shape.vertices @ turn.T + 0.05 * shape.extents.max() * way
    return Polyhedron(vertices, shape.facets)


def test_registration_undoes_a_motion(kleopatra) -> None:
    found = registered(thrown(kleopatra, 1), kleopatra)
    np.testing.assert_allclose(found.vertices, kleopatra.vertices, rtol=0, atol=1e-5)


def test_registration_of_a_displaced_body(kleopatra) -> None:
    """What `displaced` left in the frame stays there, from any start."""
    true = displaced(kleopatra, 500.0, 15e3, 3)
    found = [registered(thrown(true, seed), kleopatra) for seed in (3, 4)]
    np.testing.assert_allclose(found[0].vertices, found[1].vertices, rtol=0, atol=0.01)
    assert np.abs(found[0].vertices - true.vertices).max() < 30.0
    again = registered(thrown(true, 3), kleopatra)
    np.testing.assert_array_equal(again.vertices, found[0].vertices)


def test_registration_of_another_mesh_of_the_body() -> None:
    """The same surface with four times the facets, in another order."""
    coarse = contact_binary(subdivisions=3)
    fine = Polyhedron.from_trimesh(coarse.subdivide(), "m")
    found = registered(thrown(fine, 5), Polyhedron.from_trimesh(coarse, "m"))
    np.testing.assert_allclose(found.vertices, fine.vertices, rtol=0, atol=1e-5)


def test_what_finds_no_place_is_refused(kleopatra, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("proxops.systems.shapes.registration._ITERATIONS", 1)
    with pytest.raises(InputError, match="finds no place"):
        registered(thrown(kleopatra, 1), kleopatra)


# --- halves ---------------------------------------------------------------------------------------


def test_halves_of_a_box() -> None:
    low, high = np.array([-1.0, -0.7, -0.4]), np.array([1.2, 0.5, 0.9])
    for axis in range(3):
        at = 0.3 * low[axis] + 0.7 * high[axis]
        lower, upper = halves(Polyhedron(*box(low, high)), axis, at)
        share = (high - low).prod() / (high - low)[axis]
        assert lower.volume == pytest.approx(share * (at - low[axis]), rel=1e-14)
        assert upper.volume == pytest.approx(share * (high[axis] - at), rel=1e-14)
        middle = (low + high) / 2
        middle[axis] = (low[axis] + at) / 2
        np.testing.assert_allclose(lower.centre_of_mass, middle, atol=1e-14)
        assert lower.vertices[:, axis].max() == upper.vertices[:, axis].min() == at


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_halves_make_the_whole(kleopatra, axis: int) -> None:
    """Volumes, moments and, without the cut, areas; the cut's two sides are equal."""
    at = 0.1 * kleopatra.extents[axis]
    parts = halves(kleopatra, axis, at)
    assert sum(p.volume for p in parts) == pytest.approx(kleopatra.volume, rel=1e-13)
    moment = sum(p.volume * p.centre_of_mass for p in parts)
    whole = kleopatra.volume * kleopatra.centre_of_mass
    np.testing.assert_allclose(moment, whole, atol=1e-13 * kleopatra.volume * 2e5)
    cuts, rest = [], 0.0
    for part in parts:
        mesh = part.to_trimesh()
        assert mesh.is_watertight
        assert mesh.is_winding_consistent
        lid = (np.asarray(mesh.triangles)[:, :, axis] == at).all(axis=1)
        cuts.append(mesh.area_faces[lid] @ mesh.face_normals[lid, axis])
        rest += mesh.area_faces[~lid].sum()
    assert cuts[0] == pytest.approx(-cuts[1], rel=1e-12)
    assert cuts[0] > 0.0
    assert rest == pytest.approx(kleopatra.to_trimesh().area, rel=1e-13)
    # The cut's area is the slope of the lower part's volume.
    volumes = [halves(kleopatra, axis, at + move)[0].volume for move in (-50.0, 50.0)]
    assert cuts[0] == pytest.approx((volumes[1] - volumes[0]) / 100.0, rel=1e-4)


@pytest.mark.parametrize("axis", [0, 2])
def test_halves_of_a_ring(axis: int) -> None:
    """Two loops in the cut: side by side, or one about the other's centre."""
    ring = trimesh.creation.torus(2.0, 0.5, major_sections=48, minor_sections=24)
    shape = Polyhedron.from_trimesh(ring, "m")
    lower, upper = halves(shape, axis, 0.013)
    assert lower.volume + upper.volume == pytest.approx(shape.volume, rel=1e-13)
    area = {0: 2 * np.pi * 0.5**2, 2: 2 * np.pi * 2.0 * 1.0}[axis]
    assert lower.volume == pytest.approx(0.5 * shape.volume + 0.013 * area, rel=1e-3)
    points = np.random.default_rng(0).uniform(-3.0, 3.0, (100, 3))
    points[:20, axis] = 0.013
    parts = [GravityField(half, density=2000.0).evaluate(points) for half in (lower, upper)]
    whole = GravityField(shape, density=2000.0).evaluate(points)
    for index in range(3):
        scale = np.abs(whole[index]).max()
        summed = parts[0][index] + parts[1][index]
        np.testing.assert_allclose(summed, whole[index], rtol=0, atol=1e-12 * scale)


@pytest.mark.parametrize("at", [0.0, 1.5, -1.4])
def test_halves_of_two_balls(at: float) -> None:
    """Between the balls nothing is split; through one of them the other stays whole."""
    lower, upper = halves(two_balls(), 0, at)
    one = ball().volume
    assert lower.volume + upper.volume == pytest.approx(2.0 * one, rel=1e-13)
    share = {0.0: 1.0, 1.5: 1.5, -1.4: 0.5 + 0.25 * (3 * 0.1 - 0.1**3)}[at]
    assert lower.volume == pytest.approx(share * one, rel=2e-3)


# --- two densities --------------------------------------------------------------------------------


def test_contrast_of_a_box_against_two_boxes() -> None:
    """The halves as two meshes of their own, by a second implementation of the gravity."""
    low, high = np.array([-2.0, -0.7, -0.4]), np.array([2.0, 0.5, 0.9])
    field = GravityField(Polyhedron(*box(low, high)), density=2000.0, contrast=0.3)
    middle = np.array([0.0, 0.0, 0.0])
    left = PlainPolyhedralGravity(*box(low, np.r_[middle[0], high[1:]]), 1400.0)
    right = PlainPolyhedralGravity(*box(np.r_[middle[0], low[1:]], high), 2600.0)
    points = np.random.default_rng(0).uniform(-4.0, 4.0, (200, 3))
    found = field.evaluate(points)
    apart = [(left.at(p), right.at(p)) for p in points]
    for index in range(3):
        expected = np.array([a[index] + b[index] for a, b in apart], dtype=float)
        scale = np.abs(expected).max()
        np.testing.assert_allclose(found[index], expected, rtol=1e-11, atol=1e-12 * scale)
    np.testing.assert_array_equal(found.inside, ((points > low) & (points < high)).all(axis=1))
    assert field.mass == pytest.approx(2000.0 * (high - low).prod(), rel=1e-14)
    np.testing.assert_allclose(field.centre_of_mass, [0.3, -0.1, 0.25], atol=1e-14)


def test_gauss_law_about_the_body_and_each_lobe(binary) -> None:
    field = GravityField(binary, density=1500.0, contrast=-0.2)
    flux = outward_flux(field, np.zeros(3), 2.0 * binary.extents[0])
    assert flux == pytest.approx(-4 * np.pi * G * field.mass, rel=1e-12)
    pair = GravityField(two_balls(), density=1500.0, contrast=0.25)
    whole = -4 * np.pi * G * 1500.0 * ball().volume
    assert outward_flux(pair, (1.5, 0, 0), 1.4) == pytest.approx(1.25 * whole, rel=1e-9)
    assert outward_flux(pair, (-1.5, 0, 0), 1.4) == pytest.approx(0.75 * whole, rel=1e-9)


def test_gauss_law_across_the_cut(kleopatra) -> None:
    """A ball within the body that the plane cuts at a third of its radius."""
    field = GravityField(kleopatra, mass=MASS, contrast=0.4)
    plane = kleopatra.centre_of_mass[0]
    lower, upper = halves(kleopatra, 0, plane)
    density = MASS / (0.6 * lower.volume + 1.4 * upper.volume)
    middle = upper.vertices[upper.vertices[:, 0] == upper.vertices[:, 0].min()].mean(axis=0)
    radius = 9e3
    centre = np.r_[plane + radius / 3, middle[1:]]
    cap = np.pi * (2 / 3 * radius) ** 2 * (radius - 2 / 9 * radius)  # Below the plane.
    enclosed = density * (0.6 * cap + 1.4 * (4 / 3 * np.pi * radius**3 - cap))
    assert field.evaluate(centre + 1.01 * radius * np.r_[-np.eye(3), np.eye(3)]).inside.all()
    flux = outward_flux(field, centre, radius, breaks=(-1 / 3,))
    assert flux == pytest.approx(-4 * np.pi * G * enclosed, rel=1e-6)


def test_field_beside_and_on_the_cut(kleopatra) -> None:
    """Potential and acceleration are continuous; the gradient jumps by 4 pi G times densities'."""
    field = GravityField(kleopatra, mass=MASS, contrast=0.1)
    plane = kleopatra.centre_of_mass[0]
    rng = np.random.default_rng(3)
    points = np.c_[np.full(300, plane), rng.uniform(-4e4, 4e4, (300, 2))]
    step = np.array([1e-3, 0.0, 0.0])
    at, below, above = (field.evaluate(points + k * step) for k in (0, -1, 1))
    np.testing.assert_allclose(above.potential, below.potential, rtol=1e-8)
    np.testing.assert_allclose(above.acceleration, below.acceleration, rtol=0, atol=1e-8)
    np.testing.assert_array_equal(at.inside, above.inside)
    np.testing.assert_array_equal(at.inside, below.inside)
    assert 30 < at.inside.sum() < 270
    lower, upper = halves(kleopatra, 0, plane)
    density = MASS / (0.9 * lower.volume + 1.1 * upper.volume)
    jump = above.gradient[:, 0, 0] - below.gradient[:, 0, 0]
    expected = np.where(at.inside, -4 * np.pi * G * 0.2 * density, 0.0)
    np.testing.assert_allclose(jump, expected, atol=1e-4 * G * density)
    trace = np.trace(at.gradient, axis1=1, axis2=2)
    np.testing.assert_allclose(trace, -4 * np.pi * G * density * at.inside, atol=1e-9 * G * density)


def test_contrast_on_any_axis_and_none() -> None:
    """The cut is across the longest extent; opposite contrasts are each other's mirror image."""
    low, high = np.array([-1.0, -1.0, -2.0]), np.array([1.0, 1.0, 2.0])
    shape = Polyhedron(*box(low, high))
    plus, minus = (GravityField(shape, density=2e3, contrast=d) for d in (0.5, -0.5))
    np.testing.assert_allclose(plus.centre_of_mass, [0.0, 0.0, 0.5], atol=1e-14)
    points = np.random.default_rng(4).uniform(-4.0, 4.0, (50, 3))
    mirror = np.array([1.0, 1.0, -1.0])
    np.testing.assert_allclose(
        plus.evaluate(points).acceleration,
        minus.evaluate(points * mirror).acceleration * mirror,
        rtol=0,
        atol=1e-18,
    )
    copy = pickle.loads(pickle.dumps(plus))
    np.testing.assert_array_equal(copy.evaluate(points).potential, plus.evaluate(points).potential)


# --- what is refused ------------------------------------------------------------------------------


def hollow() -> Polyhedron:
    inner = ball(0.3)
    void = trimesh.Trimesh(inner.vertices, inner.faces[:, ::-1], process=False)
    return Polyhedron.from_trimesh(together(ball(), void), "m")


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda shape: displaced(shape, -1.0, 60.0, 1), "rms from 0"),
        (lambda shape: displaced(shape, 1.0, 0.0, 1), "correlation above 0"),
        (lambda shape: displaced(shape, 60.0, 40.0, 1), "displaced by 60 m rms"),
        (lambda shape: displaced(shape, 1e5, 40.0, 1), "smaller rms"),
        (lambda shape: halves(shape, 3, 0.5), "axis must be 0, 1 or 2"),
        (lambda shape: halves(shape, 1, 1e6), "does not cut"),
        (lambda shape: halves(shape, 1, np.nan), "does not cut"),
        (lambda shape: halves(hollow(), 0, 0.1), "void"),
        (lambda shape: GravityField(shape, density=2e3, contrast=1.0), "contrast must be above -1"),
        (lambda shape: GravityField(shape, density=2e3, contrast=0.97), "lower part.*no body has"),
        (lambda shape: GravityField(shape, density=1.5e4, contrast=0.9), "upper part.*no body has"),
    ],
)
def test_refusals(binary, call: Callable[[Polyhedron], object], words: str) -> None:
    with pytest.raises(InputError, match=words):
        call(binary)
