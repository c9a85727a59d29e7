"""Distances, tangents and lines of sight about an ellipsoid."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.optimize import minimize

from proxops.systems.shapes import blocks_segment, clearances, closest_point, tangent_half_spaces

KLEOPATRA = np.array([140e3, 70e3, 65e3])
# Distinct, two equal, all equal, very long, very flat.
AXES = [
    KLEOPATRA,
    np.array([1.0, 3.0, 2.0]),
    np.array([2.0, 1.0, 1.0]),
    np.array([1.0, 2.0, 2.0]),
    np.array([3.0, 3.0, 3.0]),
    np.array([100.0, 1.0, 1.5]),
    np.array([100.0, 90.0, 0.5]),
]
each = pytest.mark.parametrize("semi_axes", AXES, ids=str)
axes = arrays(float, 3, elements=st.floats(0.05, 20.0))
# Zeros and signs come up often, as do tiny offsets from a plane of symmetry.
coordinate = st.one_of(
    st.just(0.0), st.floats(-30.0, 30.0), st.sampled_from([1e-12, -1e-9, 1e-15, -1e-300])
)
vectors = arrays(float, 3, elements=coordinate)
many = settings(max_examples=50)


def on_ellipsoid(semi_axes: np.ndarray, polar: np.ndarray, azimuth: np.ndarray) -> np.ndarray:
    unit = [np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth), np.cos(polar)]
    return semi_axes * np.stack(unit, axis=-1)


def distance_by_search(semi_axes: np.ndarray, point: np.ndarray) -> float:
    """Least distance over a grid of the surface, polished by a minimiser from the best few."""

    def distance(angles: np.ndarray) -> float:
        return float(np.linalg.norm(on_ellipsoid(scaled, angles[0], angles[1]) - target))

    scale = semi_axes.max()
    scaled, target = semi_axes / scale, point / scale
    polar, azimuth = np.meshgrid(np.linspace(0, np.pi, 61), np.linspace(0, 2 * np.pi, 121))
    grid = np.linalg.norm(on_ellipsoid(scaled, polar, azimuth) - target, axis=-1).ravel()
    starts = np.argsort(grid)[:3]
    options = {"xatol": 1e-10, "fatol": 1e-15, "maxiter": 2000}
    return scale * min(
        minimize(
            distance, [polar.flat[k], azimuth.flat[k]], method="Nelder-Mead", options=options
        ).fun
        for k in starts
    )


@each
def test_against_search(semi_axes: np.ndarray) -> None:
    rng = np.random.default_rng(0)
    points = rng.uniform(-1.6, 1.6, (12, 3)) * semi_axes
    points[:3] *= 0.2
    points[3:6, rng.integers(3)] = 0.0
    inside = np.sum((points / semi_axes) ** 2, axis=1) < 1.0
    assert inside.any()
    expected = np.array([distance_by_search(semi_axes, point) for point in points])
    np.testing.assert_allclose(
        clearances(semi_axes, points),
        np.where(inside, -expected, expected),
        rtol=1e-7,
        atol=1e-9 * semi_axes.max(),
    )


@each
def test_points_on_the_axes(semi_axes: np.ndarray) -> None:
    """Outside a - x; inside the nearest point leaves the axis where x < a - c^2 / a."""
    for axis, a in enumerate(semi_axes):
        x = a * np.array([0.0, 1e-6, 0.1, 0.5, 0.9, 0.999, 1.0, 1.001, 1.5, 30.0])
        points = np.zeros((2 * len(x), 3))
        points[:, axis] = np.concatenate([x, -x])
        expected = x - a
        for c in np.delete(semi_axes, axis):
            if c < a:
                # In the plane of the two axes, from the ellipse's equation.
                sideways = c * np.sqrt(np.maximum(1 - x**2 / (a**2 - c**2), 0.0))
                leaves = x < (a**2 - c**2) / a
                expected = np.where(leaves, np.maximum(expected, -sideways), expected)
        np.testing.assert_allclose(
            clearances(semi_axes, points), np.tile(expected, 2), rtol=1e-11, atol=1e-13 * a
        )


@each
def test_inside_on_planes_of_symmetry(semi_axes: np.ndarray) -> None:
    """The limit of points beside the plane: the distance is continuous."""
    rng = np.random.default_rng(2)
    points = rng.uniform(-0.55, 0.55, (60, 3)) * semi_axes
    for axis, length in enumerate(semi_axes):
        flat = points.copy()
        flat[:, axis] = 0.0
        at = clearances(semi_axes, flat)
        step = 1e-9 * length
        for side in (step, -step):
            beside = flat.copy()
            beside[:, axis] = side
            np.testing.assert_allclose(clearances(semi_axes, beside), at, rtol=0, atol=1.01 * step)


@many
@given(axes, vectors)
def test_closest_point(semi_axes: np.ndarray, point: np.ndarray) -> None:
    """It lies on the surface, the way there is along the normal, and the signs are the point's."""
    nearest = closest_point(semi_axes, point)
    level = np.sum((nearest / semi_axes) ** 2)
    assert level == pytest.approx(1.0, abs=1e-12)
    away = point - nearest
    normal = nearest / semi_axes**2
    normal /= np.linalg.norm(normal)
    scale = semi_axes.max() + np.linalg.norm(point)
    assert np.linalg.norm(np.cross(away, normal)) < 1e-11 * scale
    assert (nearest * point >= 0).all()
    inside = np.sum((point / semi_axes) ** 2) < 1.0
    clearance = clearances(semi_axes, point[None])[0]
    assert abs(clearance) == pytest.approx(np.linalg.norm(away), rel=1e-12)
    assert (clearance < 0) == (inside and abs(clearance) > 0)


@many
@given(axes, vectors, vectors)
def test_clearance_is_least_and_lipschitz(
    semi_axes: np.ndarray, point: np.ndarray, other: np.ndarray
) -> None:
    """No surface point is nearer, and the clearance changes no faster than the place."""
    first, second = clearances(semi_axes, np.stack([point, other]))
    slack = 1e-11 * (semi_axes.max() + np.linalg.norm(point) + np.linalg.norm(other))
    assert abs(first - second) <= np.linalg.norm(point - other) + slack
    polar, azimuth = np.meshgrid(np.linspace(0, np.pi, 13), np.linspace(0, 6, 13))
    surface = on_ellipsoid(semi_axes, polar, azimuth).reshape(-1, 3)
    assert abs(first) <= np.linalg.norm(surface - point, axis=1).min() + slack


def test_nan_is_not_hidden() -> None:
    points = np.array([[np.nan, 0.0, 0.0], [2e5, 0.0, 0.0]])
    result = clearances(KLEOPATRA, points)
    assert np.isnan(result[0])
    assert result[1] == pytest.approx(6e4)


@many
@given(axes, vectors)
def test_tangent_half_spaces(semi_axes: np.ndarray, point: np.ndarray) -> None:
    """A unit normal; the ellipsoid is on one side and touches, where the docstring says."""
    normals, offsets = tangent_half_spaces(semi_axes, point[None])
    normal, offset = normals[0], offsets[0]
    assert np.linalg.norm(normal) == pytest.approx(1.0)
    # The ellipsoid's extent along n, its support function, is |a n|.
    extent = np.linalg.norm(semi_axes * normal)
    assert offset == pytest.approx(extent, rel=1e-12)
    touch = semi_axes**2 * normal / extent
    assert normal @ touch == pytest.approx(offset, rel=1e-12)
    if np.linalg.norm(point / semi_axes) >= 1.0:
        along = np.linalg.norm(np.cross(touch, point))
        assert along <= 1e-9 * np.linalg.norm(touch) * np.linalg.norm(point)
        assert touch @ point > 0
        outside = np.sum((point / semi_axes) ** 2) > 1.0 + 1e-9
        assert not outside or normal @ point > offset
    else:
        # The shortest way out: along the normal, as far as the surface is away.
        depth = -clearances(semi_axes, point[None])[0]
        assert offset - normal @ point == pytest.approx(depth, rel=1e-6, abs=1e-9 * offset)


@many
@given(axes, vectors, vectors)
def test_blocks_segment_against_sampling(
    semi_axes: np.ndarray, start: np.ndarray, end: np.ndarray
) -> None:
    share = np.linspace(0.0, 1.0, 2001)[:, None]
    level = np.sum(((start * (1 - share) + end * share) / semi_axes) ** 2, axis=1)
    # Between samples the level is a parabola: it can dip by this much.
    dip = np.sum(((end - start) / semi_axes) ** 2) / 4 / 2000**2
    blocked = blocks_segment(semi_axes, start, end)
    if level.min() < 1.0 - 1e-12:
        assert blocked
    elif level.min() > 1.0 + dip + 1e-12:
        assert not blocked
    assert blocks_segment(semi_axes, end, start) == blocked or abs(level.min() - 1.0) < dip + 1e-9
