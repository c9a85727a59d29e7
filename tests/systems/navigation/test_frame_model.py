"""The derivatives of a predicted frame, against differences of ray-cast ranges.

Eq. 11 to 13 of docs/method/equations.md.
"""

import functools

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from proxops.systems import Lidar, LidarErrors, LidarGeometry, Polyhedron
from proxops.systems.lidar.lidar_errors import measured_ranges
from proxops.systems.navigation import Estimate, MapError
from proxops.systems.navigation.estimate import (
    BASE,
    HALF_BEAM,
    LIDAR_BIAS,
    LIDAR_SCALE,
    MEASURED,
    SIZE,
)
from proxops.systems.navigation.frame_model import Comparison, FrameModel
from proxops.systems.shapes import ray_caster, vertex_normals

PLACE = np.array([160e3, 70e3, -60e3])
TURN = Rotation.from_rotvec([0.03, -0.02, 0.05])
# More rays than a frame has: some thousand meet the body.
GEOMETRY = LidarGeometry(planes=60, rays=720)
SIZE_COLUMN = 6


@functools.cache
def egg() -> Polyhedron:
    """Smooth and without symmetry: round, so that neighbouring facets differ little."""
    ball = trimesh.creation.icosphere(5)
    x, y, z = ball.vertices.T
    points = np.stack([100e3 * x + 12e3 * y * z, 60e3 * y * (1.0 + 0.2 * x), 50e3 * z], axis=1)
    return Polyhedron(points, ball.faces, "egg")


def model(shape: Polyhedron, map_error: MapError | None = None, beam: float = 0.0) -> FrameModel:
    return FrameModel(shape, GEOMETRY, 5.0, map_error or MapError(shape), 0.5 * beam)


def estimate(modes: int = 0) -> Estimate:
    n = BASE + modes
    mean = np.zeros(n)
    mean[:3] = PLACE
    return Estimate(mean, TURN.as_matrix(), np.zeros((n, n)))


def cast(shape: Polyhedron, position: np.ndarray = PLACE, turn: Rotation = TURN) -> np.ndarray:
    """A frame without errors."""
    directions = turn.apply(GEOMETRY.directions)
    distances, facets, _ = ray_caster(shape).first_hits(position, directions)
    ranges = np.where(facets >= 0, distances, np.inf)
    ranges[ranges > GEOMETRY.max_range] = np.inf
    return ranges


def compared(shape: Polyhedron, ranges: np.ndarray, **kwargs) -> Comparison:
    return model(shape, **kwargs).compared(estimate(), ranges)


def steep(found: Comparison) -> np.ndarray:
    """Rays that are used: those of finite variance."""
    return found.variances < np.inf


def agrees(found: np.ndarray, expected: np.ndarray, share: float = 0.02) -> None:
    """Nearly everywhere: where a ray changes the facet or passes an edge, it may differ."""
    scale = np.sqrt(np.mean(expected**2))
    assert scale > 0.0
    off = np.abs(found - expected)
    assert np.median(off) < 0.3 * share * scale
    assert np.mean(off < 3.0 * share * scale) > 0.97


# --- residuals ------------------------------------------------------------------------------------


def test_nothing_is_left_of_the_frame_that_is_predicted() -> None:
    shape = egg()
    ranges = cast(shape)
    found = compared(shape, ranges)
    assert set(found.rays) <= set(np.flatnonzero(ranges < np.inf))
    assert found.rays.size > 0.99 * np.count_nonzero(ranges < np.inf)
    assert np.abs(found.residuals).max() < 0.05
    assert found.rows.shape == (found.rays.size, MEASURED.size)


def test_flat_rays_are_not_used() -> None:
    shape = egg()
    found = compared(shape, cast(shape))
    directions = TURN.apply(GEOMETRY.directions[found.rays])
    _, facets, _ = ray_caster(shape).first_hits(PLACE, directions)
    cosines = -np.einsum("ki,ki->k", directions, shape.normals[facets])
    assert 0 < np.count_nonzero(~steep(found)) < found.rays.size
    np.testing.assert_array_equal(steep(found), cosines >= 0.05)
    np.testing.assert_allclose(found.variances[steep(found)], (5.0 * cosines[steep(found)]) ** 2)


def test_no_return_and_beyond_the_greatest_range_are_left_out() -> None:
    shape = egg()
    ranges = cast(shape)
    returned = np.flatnonzero(ranges < np.inf)
    ranges[returned[::3]], ranges[returned[1::3]] = np.inf, 1.01 * GEOMETRY.max_range
    found = compared(shape, ranges)
    assert set(found.rays) <= set(returned[2::3])


# --- derivatives ----------------------------------------------------------------------------------


def differences(shape: Polyhedron, index: int) -> tuple[Comparison, np.ndarray, np.ndarray]:
    """Which rays, and q times the change of their ranges for pose `index`, per m or rad."""
    step = 60.0 if index < 3 else 4e-4
    frames = []
    for sign in (1.0, -1.0):
        change = sign * step * np.eye(3)[index % 3]
        if index < 3:
            frames.append(cast(shape, PLACE + change))
        else:
            frames.append(cast(shape, PLACE, Rotation.from_rotvec(change) * TURN))
    found = compared(shape, cast(shape))
    after, before = (frame[found.rays] for frame in frames)
    good = steep(found) & (after < np.inf) & (before < np.inf)
    return found, good, (after - before)[good] / (2.0 * step)


def incidence(found: Comparison) -> np.ndarray:
    """Cosines: what residuals are multiplied by."""
    return np.sqrt(found.variances) / 5.0


@pytest.mark.parametrize("index", range(6))
def test_pose(index: int) -> None:
    found, good, slope = differences(egg(), index)
    agrees(found.rows[good, index], incidence(found)[good] * slope)


def test_size() -> None:
    shape = egg()
    larger = Polyhedron(1.001 * shape.vertices, shape.facets)
    found = compared(shape, cast(shape))
    change = cast(larger)[found.rays] - cast(shape)[found.rays]
    good = steep(found) & (np.abs(change) < 1e4)
    agrees(found.rows[good, SIZE_COLUMN], incidence(found)[good] * change[good] / 0.001)


@pytest.mark.parametrize(
    ("column", "errors", "value"),
    [(7, LidarErrors(bias=20.0), 20.0), (8, LidarErrors(scale_error=2e-3), 2e-3)],
)
def test_bias_and_scale(column: int, errors: LidarErrors, value: float) -> None:
    """What the lidar's own errors do to a range."""
    shape = egg()
    ranges = cast(shape)
    wrong = np.where(ranges < np.inf, measured_ranges(ranges, errors, 0, 0), np.inf)
    found = compared(shape, wrong)
    good = steep(found)
    np.testing.assert_allclose(found.residuals[good], found.rows[good, column] * value, atol=0.05)


def test_what_is_estimated_is_taken_off() -> None:
    """Size, bias and scale of the mean leave nothing of the frame that they predict.

    Even a size that is far off is predicted as the mesh of that size would be.
    """
    shape = egg()
    wrong = LidarErrors(bias=20.0, scale_error=2e-3)
    ranges = cast(Polyhedron(1.01 * shape.vertices, shape.facets))
    ranges = np.where(ranges < np.inf, measured_ranges(ranges, wrong, 0, 0), np.inf)
    known = estimate()
    known.mean[[SIZE, LIDAR_BIAS, LIDAR_SCALE]] = 0.01, 20.0, 2e-3
    found = model(shape).compared(known, ranges)
    good = steep(found)
    before = compared(shape, ranges)
    assert np.sqrt(np.mean(before.residuals[steep(before)] ** 2)) > 100.0
    np.testing.assert_allclose(found.residuals[good], 0.0, atol=0.1)


def test_coefficients_of_the_map() -> None:
    """Each displaces the mesh along the normals of its vertices."""
    shape = egg()
    errors = MapError(shape, 30.0, 40e3)
    normals, _ = vertex_normals(shape)
    coefficients = np.random.default_rng(3).normal(size=errors.modes)
    heights = errors.table @ coefficients
    moved = Polyhedron(shape.vertices + heights[:, None] * normals, shape.facets)
    found = model(shape, errors).compared(estimate(errors.modes), cast(moved))
    good = steep(found) & (np.abs(found.residuals) < 1e4)
    agrees(found.rows[good, 10:] @ coefficients, found.residuals[good])
    # And if they are known, next to nothing is left.
    known = estimate(errors.modes)
    known.mean[BASE:] = coefficients
    left = model(shape, errors).compared(known, cast(moved)).residuals[good]
    assert np.median(np.abs(left)) < 0.02 * np.median(np.abs(found.residuals[good]))


# --- beams ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("width", [5e-4, 2e-3])
def test_beams_on_planes(width: float) -> None:
    """Each beam reads the nearest point in its cone; on a box, that of a plane."""
    box = trimesh.creation.box(extents=(200e3, 120e3, 90e3))
    shape = Polyhedron(box.vertices, box.faces)
    ranges = cast(shape)
    directions = TURN.apply(GEOMETRY.directions)
    lidar = Lidar(shape, LidarErrors(beam_width=width), GEOMETRY)
    returns = lidar.true_returns(PLACE, TURN.as_matrix())
    read = np.full(ranges.size, np.inf)
    read[returns.rays] = returns.distances
    found = compared(shape, ranges, beam=width)
    # What the whole cone meets on the same face of the box, by rays around its edge.
    inside = np.ones(found.rays.size, dtype=bool)
    across = np.cross(directions[found.rays], [0.36, 0.48, 0.8])
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    normals = shape.normals[ray_caster(shape).first_hits(PLACE, directions[found.rays]).facets]
    for angle in np.arange(0.0, 2.0 * np.pi, np.pi / 4.0):
        other = np.cross(directions[found.rays], across)
        rim = directions[found.rays] + width * (np.cos(angle) * across + np.sin(angle) * other)
        rim /= np.linalg.norm(rim, axis=1, keepdims=True)
        met = ray_caster(shape).first_hits(PLACE, rim).facets
        inside &= (met >= 0) & (np.einsum("ki,ki->k", shape.normals[met], normals) > 0.999)
    good = inside & steep(found) & (read[found.rays] < np.inf)
    assert good.sum() > 100
    shorter = read[found.rays[good]] - ranges[found.rays[good]]
    assert shorter.min() < -50.0
    expected = found.rows[good, 9] * 0.5 * width
    cosines = -np.einsum("ki,ki->k", normals, directions[found.rays])[good]
    # To first order: next comes the share of half of the beam's angle over the cosine.
    second = (1.0 / cosines) * 0.5 * width
    error = np.abs(cosines * shorter - expected)
    assert (error < 2.0 * second * np.abs(expected) + 0.2).all()
    # And the mean of an estimate that knows the beam takes it off.
    known = estimate()
    known.mean[HALF_BEAM] = 0.5 * width
    left = model(shape, beam=width).compared(known, read).residuals[good]
    assert np.abs(left).max() < 0.02 * np.abs(expected).max() + 0.2
