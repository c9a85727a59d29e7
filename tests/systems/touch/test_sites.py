"""Places on a ball, on a ramp and in a pit, against closed forms."""

import itertools

import numpy as np
import pytest
import trimesh

from proxops.systems.common import InputError
from proxops.systems.shapes import Polyhedron
from proxops.systems.touch.sites import (
    LIMITS,
    SiteLimits,
    SiteWorld,
    best_sites,
    map_sites,
    measured_sites,
    nearest_site,
    place_below,
    place_near,
    use_of_limits,
    why_not,
)

RADIUS = 250.0
NO_SUN = np.zeros((0, 3))


def ball(subdivisions: int = 4) -> Polyhedron:
    mesh = trimesh.creation.icosphere(subdivisions, RADIUS)
    return Polyhedron(mesh.vertices, mesh.faces)


def pull(positions: np.ndarray) -> np.ndarray:
    """1e-4 m/s^2 towards the centre."""
    return -1e-4 * positions / np.linalg.norm(positions, axis=1, keepdims=True)


def block(depth: float) -> Polyhedron:
    """A block of 100 m with its upper face at z = 0, and a shaft of 8 m by 8 m in its middle."""
    x = np.array([-50.0, -4.0, 4.0, 50.0])
    y = x
    top = [(a, b, 0.0) for a in x for b in y]
    floor = [(a, b, -depth) for a in x[1:3] for b in y[1:3]]
    bottom = [(a, b, -100.0) for a in (-50.0, 50.0) for b in (-50.0, 50.0)]
    vertices = np.array(top + floor + bottom)
    quads = [
        (4 * i + j, 4 * (i + 1) + j, 4 * (i + 1) + j + 1, 4 * i + j + 1)
        for i in range(3)
        for j in range(3)
        if (i, j) != (1, 1)
    ]
    # Shaft: corners of the hole are 5, 9, 10, 6; of its floor 16, 18, 19, 17.
    rim, low = (5, 9, 10, 6), (16, 18, 19, 17)
    quads.append(low)
    for k in range(4):
        m = (k + 1) % 4
        quads.append((rim[m], low[m], low[k], rim[k]))
    # Outer walls, as fans over the four points of each side.
    sides = [[0, 4, 8, 12], [12, 13, 14, 15], [15, 11, 7, 3], [3, 2, 1, 0]]
    base = [20, 22, 23, 21]
    facets = [t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))]
    for k, side in enumerate(sides):
        low_a, low_b = base[k], base[(k + 1) % 4]
        facets += [(low_a, b, a) for a, b in itertools.pairwise(side)]
        facets.append((low_a, low_b, side[-1]))
    facets += [(20, 21, 23), (20, 23, 22)]
    return Polyhedron(vertices, np.array(facets))


def test_a_ball() -> None:
    shape, limits = ball(), SiteLimits(radius_m=5.0, cone_deg=80.0)
    sites, facets = map_sites(shape, limits, SiteWorld(pull, 1000.0, NO_SUN))
    assert len(facets) == len(shape.facets)
    out = sites.positions / np.linalg.norm(sites.positions, axis=1, keepdims=True)
    assert np.arccos((out * sites.normals).sum(axis=1).clip(-1, 1)).max() < np.radians(1.5)
    # The slope is the angle between normal and radius; hovering takes the weight.
    angle = np.arccos(np.clip((out * sites.normals).sum(axis=1), -1.0, 1.0))
    np.testing.assert_allclose(sites.slope, angle, atol=1e-7)
    np.testing.assert_allclose(sites.hover, 0.1 * np.abs(out).max(axis=1), rtol=1e-9)
    assert sites.free.all()
    # The dome over its plane: a paraboloid's z = r^2 / (2 R), uniform between 0 and 5^2 / 500 m.
    fine, _ = map_sites(ball(7), limits, SiteWorld(pull, 1000.0, NO_SUN), most=200)
    sag = limits.radius_m**2 / (2.0 * RADIUS)
    np.testing.assert_allclose(fine.roughness, sag / np.sqrt(12.0), rtol=0.15)
    np.testing.assert_allclose(fine.height, sag / 2.0, rtol=0.15)


def test_slope_of_a_ramp() -> None:
    """On the upper face of a block whose gravity is tilted by 20 degrees."""
    shape, tilt = block(1.0), np.radians(20.0)
    plumb = 1e-4 * np.array([np.sin(tilt), 0.0, -np.cos(tilt)])
    world = SiteWorld(lambda at: np.broadcast_to(plumb, at.shape), 1000.0, np.eye(3)[:1])
    place = measured_sites(shape, np.array([[30.0, 0, 0]]), np.eye(3)[2:], SiteLimits(), world)
    assert place.slope[0] == pytest.approx(tilt, abs=1e-6)
    np.testing.assert_allclose(place.normals, np.eye(3)[2:], atol=1e-6)
    assert abs(place.roughness[0]) < 1e-4
    assert place.light[0] == pytest.approx(0.0, abs=1e-4)


def test_a_shaft_is_a_concavity() -> None:
    world = SiteWorld(lambda at: np.tile([0.0, 0.0, -1e-4], (len(at), 1)), 1000.0, NO_SUN)
    limits, up = SiteLimits(radius_m=2.0), np.eye(3)[2:]
    for depth, free in ((20.0, False), (2.0, True)):
        place = measured_sites(block(depth), np.array([[0.0, 0, -depth]]), up, limits, world)
        assert place.free[0] == free  # 4 m aside and 20 m deep: 11 degrees; 2 m deep: 63.
    # A disc wider than the shaft: the ground stands 2 m over its floor.
    wide = SiteLimits(radius_m=6.0, height_m=1.0)
    place = measured_sites(block(2.0), np.array([[0.0, 0, -2.0]]), up, wide, world)
    use = use_of_limits(place, wide, 6.0)
    assert place.height[0] > 0.8
    assert any("terrain stands" in text or "roughness" in text for text in why_not(
        place, use, 0, wide, 6.0
    ))  # fmt: skip


def test_limits_and_what_is_nearest() -> None:
    shape, limits = ball(), SiteLimits(slope_deg=5.0)
    suns = np.array([[1.0, 0.0, 0.0]])
    sites, _ = map_sites(shape, limits, SiteWorld(pull, 1000.0, suns))
    use = use_of_limits(sites, limits, 6.0)
    can = use.max(axis=1) <= 1.0
    # Half of the ball is lit, and nothing else is wrong with it.
    assert 0.45 < can.mean() < 0.55
    assert (sites.normals[can, 0] > 0.0).all()
    best = best_sites(sites, use, 5, 100.0)
    places = sites.positions[best]
    apart = np.linalg.norm(places[:, None] - places, axis=2) + 1e9 * np.eye(5)
    assert apart.min() >= 100.0
    worst = use[best].max(axis=1)
    assert (np.diff(worst) >= 0.0).all()
    assert worst[0] == use.max(axis=1).min()
    far = int(sites.positions[:, 0].argmin())
    assert why_not(sites, use, far, limits, 6.0) == ["the Sun never rises there"]
    near = nearest_site(sites, use, sites.positions[far])
    assert near is not None
    assert sites.normals[near, 0] < 0.1
    heavy = use_of_limits(sites, limits, 0.1)
    assert nearest_site(sites, heavy, sites.positions[far]) is None
    assert heavy[far, LIMITS.index("hover")] == pytest.approx(sites.hover[far] / 0.05)


def test_places_on_the_map() -> None:
    shape = ball()
    point, facet = place_below(shape, 30.0, 45.0)
    assert np.linalg.norm(point) == pytest.approx(RADIUS, rel=2e-3)
    expected = np.array([np.cos(np.pi / 6) / np.sqrt(2)] * 2 + [0.5])
    np.testing.assert_allclose(point / np.linalg.norm(point), expected, atol=1e-6)
    corners = shape.vertices[shape.facets[facet]]
    assert np.dot(point - corners[0], shape.normals[facet]) == pytest.approx(0.0, abs=1e-3)
    near, same = place_near(shape, 1.01 * point, 5.0)
    assert np.linalg.norm(near - point) < 0.1
    assert same == facet
    with pytest.raises(InputError, match="m off the map, whose nearest point is"):
        place_near(shape, 2.0 * point, 5.0)
    with pytest.raises(InputError, match="-90 to 90"):
        place_below(shape, 91.0, 0.0)


def test_nearest_point_of_a_facet() -> None:
    """Against a search over the facets of a tetrahedron, from all round."""
    mesh = trimesh.creation.box()
    shape = Polyhedron(mesh.vertices, mesh.faces)
    rng = np.random.default_rng(0)
    for position in rng.uniform(-2.0, 2.0, (20, 3)):
        outside = np.maximum(np.abs(position) - 0.5, 0.0)
        if not outside.any():
            continue
        point, _ = place_near(shape, position, 10.0)
        np.testing.assert_allclose(point, np.clip(position, -0.5, 0.5), atol=1e-12)
