"""Boulders and craters: the law of their sizes, and the surface that they make."""

import dataclasses as dc

import numpy as np
import pytest
import trimesh

from proxops.systems.common import InputError
from proxops.systems.shapes import (
    BouldersConfig,
    Polyhedron,
    find_defects,
    ray_caster,
    relief_of,
    with_boulders,
    with_lone_boulder,
)
from proxops.systems.shapes.boulders import DEPTH, HEIGHT, widths

BALL = Polyhedron.from_trimesh(trimesh.creation.icosphere(4, 500.0), "m")


def test_as_many_are_wider_as_the_law_says() -> None:
    found = widths(100.0, 20.0, 2.65)
    assert found.max() == 100.0
    assert found.min() >= 20.0
    for width in (90.0, 50.0, 25.0):
        assert np.count_nonzero(found >= width) == int((width / 100.0) ** -2.65)
    assert widths(10.0, 20.0, 2.65).size == 0


def heights(shape: Polyhedron) -> np.ndarray:
    return np.linalg.norm(shape.vertices, axis=1) - 500.0


def test_one_boulder_and_one_crater() -> None:
    """Their heights are those of paraboloids; the mean of the surface stays."""
    boulder = BouldersConfig(widest_m=200.0, narrowest_m=199.0)
    found = heights(with_boulders(BALL, boulder))
    assert found.max() == pytest.approx(HEIGHT * 200.0, rel=0.02)
    volume = with_boulders(BALL, boulder).volume / BALL.volume
    assert volume == pytest.approx(1.0, abs=1e-3)
    crater = BouldersConfig(crater_widest_m=200.0, narrowest_m=199.0)
    assert heights(with_boulders(BALL, crater)).min() == pytest.approx(-DEPTH * 200.0, rel=0.05)


def test_what_is_told_of_the_relief_is_what_it_is() -> None:
    boulders = BouldersConfig(widest_m=120.0, crater_widest_m=200.0, narrowest_m=40.0, seed=4)
    rms, correlation = relief_of(boulders, BALL)
    found = heights(with_boulders(BALL, boulders))
    assert np.std(found) == pytest.approx(rms, rel=0.2)
    assert 0.2 * 120.0 < correlation < 120.0
    assert relief_of(BouldersConfig(), BALL) == (0.0, 0.0)


def test_seeds_place_them_elsewhere() -> None:
    boulders = BouldersConfig(widest_m=120.0, narrowest_m=60.0)
    one, same, other = (
        with_boulders(BALL, dc.replace(boulders, seed=seed)).vertices for seed in (1, 1, 2)
    )
    np.testing.assert_array_equal(one, same)
    assert np.abs(one - other).max() > 1.0


def test_too_narrow_ones_are_refused() -> None:
    with pytest.raises(InputError, match=r"narrowest_m is too narrow .* take at least [\d.]+ m"):
        with_boulders(BALL, BouldersConfig(widest_m=10.0, narrowest_m=1.0))


def test_a_lone_boulder_lies_where_it_is_asked_for() -> None:
    """A ball of 2 m on a mesh of facets of 30 m: closed, and as high as its law says."""
    way = np.array([1.0, 2.0, -1.0]) / np.sqrt(6.0)
    found = with_lone_boulder(BALL, 2.0, 7.0 * way)
    assert find_defects(found.vertices, found.facets) == []
    before, after = (
        1000.0 - ray_caster(each).distances(1000.0 * way[None], -way[None])[0]
        for each in (BALL, found)
    )
    assert after - before == pytest.approx(HEIGHT * 2.0, rel=0.05)
    # What the ground does not hold of the ball: a cap 0.8 m high.
    cap = np.pi * 0.8**2 * (3.0 * 1.0 - 0.8) / 3.0
    assert found.volume - BALL.volume == pytest.approx(cap, rel=0.1)
    with pytest.raises(InputError, match=r"lone_at_m: .* has no surface"):
        with_lone_boulder(BALL, 2.0, np.zeros(3))


def test_lone_boulders_leave_no_facets_without_area() -> None:
    """As where a ball meets facets, one in twenty places."""
    for way in np.random.default_rng(1).standard_normal((60, 3)):
        found = with_lone_boulder(BALL, 2.0, way)
        assert find_defects(found.vertices, found.facets) == []
