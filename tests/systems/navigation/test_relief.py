"""Relief that is alike from frame to frame: what it does to residuals, and what is forgotten."""

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from proxops.systems.lidar import LidarGeometry
from proxops.systems.navigation import ExpectedErrors, MapError
from proxops.systems.navigation.correction import corrected
from proxops.systems.navigation.estimate import (
    ATTITUDE,
    BASE,
    LIDAR_BIAS,
    LIDAR_SCALE,
    POSITION,
    Estimate,
    first_estimate,
    first_sigmas,
)
from proxops.systems.navigation.frame_model import FrameModel
from proxops.systems.navigation.relief import PATTERNS, forgotten, relief_rows
from proxops.systems.shapes import Polyhedron, ray_caster


def test_what_looks_like_an_error_of_the_pose_has_the_relief_s_covariance() -> None:
    """Against the projection on the space of the rows by the pseudo-inverse."""
    random = np.random.default_rng(3)
    rows, points = random.normal(size=(60, PATTERNS)), random.uniform(0.0, 50.0, (60, 3))
    found, anew = relief_rows(rows, points, 2.0, 15.0)
    away = np.linalg.norm(points[:, None] - points, axis=2)
    covariance = 4.0 * np.exp(-((away / 15.0) ** 2) / 2.0)
    onto = rows @ np.linalg.pinv(rows)
    np.testing.assert_allclose(found @ found.T, onto @ covariance @ onto, atol=1e-10)
    # Some four frames in a row see the same: each counts as one of them.
    assert anew == pytest.approx(4.0 * np.trace(onto @ covariance) / PATTERNS)


def test_many_rays_are_thinned_but_count() -> None:
    """On a line, four times as many rays see the same stones: the same likeness, summed."""
    places = np.linspace(0.0, 100.0, 800)
    rows = np.stack([(places / 100.0) ** k for k in range(PATTERNS)], axis=1)
    points = np.stack([places, 0.0 * places, 0.0 * places], axis=1)
    many, _ = relief_rows(rows, points, 1.0, 20.0)
    few, _ = relief_rows(rows[::4], points[::4], 1.0, 20.0)
    # Their effect on the mean of the residuals.
    assert many.mean(axis=0) @ many.mean(axis=0) == pytest.approx(
        few.mean(axis=0) @ few.mean(axis=0), rel=0.05
    )


def test_fewer_rays_than_patterns() -> None:
    random = np.random.default_rng(1)
    found, _ = relief_rows(random.normal(size=(4, PATTERNS)), random.normal(size=(4, 3)), 1.0, 1.0)
    assert found.shape == (4, PATTERNS)
    assert not found[:, 4:].any()


def test_after_a_long_way_nothing_is_remembered() -> None:
    random = np.random.default_rng(2)
    root = random.normal(size=(BASE + PATTERNS, BASE + PATTERNS))
    before = Estimate(random.normal(size=BASE + PATTERNS), np.eye(3), root @ root.T)
    here = forgotten(before, before, BASE, 30.0)
    np.testing.assert_array_equal(here.covariance, before.covariance)
    mean = before.mean.copy()
    mean[:3] += [3e6, 0.0, 0.0]
    far = forgotten(before._replace(mean=mean), before, BASE, 30.0)
    np.testing.assert_allclose(far.covariance[BASE:, BASE:], np.eye(PATTERNS), atol=1e-12)
    assert not far.covariance[:BASE, BASE:].any()
    assert not far.mean[BASE:].any()
    np.testing.assert_array_equal(far.covariance[:BASE, :BASE], before.covariance[:BASE, :BASE])


def test_relief_takes_what_the_modes_leave_out() -> None:
    ball = Polyhedron.from_trimesh(trimesh.creation.icosphere(3, 2.0), "m")
    smooth = MapError(ball, 2.0, 0.7)
    rough = smooth.with_relief(3.0, 0.1)
    assert smooth.with_relief(0.0, 0.1) is smooth
    assert smooth.rest > 0.0
    assert rough.std == pytest.approx(np.hypot(2.0, 3.0))
    assert rough.relief**2 == pytest.approx(9.0 + smooth.rest / 10.0)
    assert rough.coefficients == smooth.modes + PATTERNS
    assert ExpectedErrors().relief_rms_m == 0.0
    # Waves so short that hundreds of modes would be needed: much is left out.
    fine = MapError(ball, 2.0, 0.3)
    assert smooth.relief == 0.0
    assert 4.0 * 0.05 < fine.relief**2 == pytest.approx(fine.rest / 10.0)
    assert (fine.relief_correlation, fine.coefficients) == (0.3, fine.modes + PATTERNS)


def heights(points: np.ndarray, seed: int, std: float, correlation: float) -> np.ndarray:
    """A random field at points (K, 3), by random waves."""
    random = np.random.default_rng(seed)
    waves, phases = random.normal(size=(500, 3)) / correlation, random.uniform(0.0, 7.0, 500)
    return std * np.sqrt(2.0 / 500.0) * np.cos(points @ waves.T + phases).sum(axis=1)


def seen_of(ball: Polyhedron, model: FrameModel, place: np.ndarray) -> tuple[np.ndarray, ...]:
    """Of the rays (N,) from a place (3,): which meet a ball; and of these where, and the ranges and
    cosines of the incidence there."""
    hits = ray_caster(ball).first_hits(place, model.directions)
    met = hits.facets >= 0
    rays, ranges = model.directions[met], hits.distances[met]
    cosines = -np.einsum("ki,ki->k", rays, ball.normals[hits.facets[met]])
    return met, place + ranges[:, None] * rays, ranges, cosines


def test_stones_that_are_seen_for_long_do_not_tell_where_one_is() -> None:
    """A ball whose map may be wavy, and has no relief, is seen 30 times from the same place."""
    ball = Polyhedron.from_trimesh(trimesh.creation.icosphere(4, 270.0), "m")
    wavy = 0.1 * np.cos(ball.vertices[:, :1] / 60.0)
    error = MapError.known(wavy, 0.0).with_relief(0.2, 12.0)
    model = FrameModel(ball, LidarGeometry(12, 36, 1000.0), 0.1, error)
    spin = np.array([0.0, 0.0, 4e-4])
    sigma = first_sigmas(ExpectedErrors(), spin, error.coefficients, 10.0, 0.0)
    place, off = np.array([0.0, 0.0, 370.0]), []
    pose = np.r_[POSITION, ATTITUDE]
    met, points, distances, cosines = seen_of(ball, model, place)
    for seed in range(20):
        random, ranges = np.random.default_rng(100 + seed), np.full(len(met), np.inf)
        estimate = first_estimate(place, np.eye(3), sigma)
        # The map's error is drawn as it is expected, too.
        wave = 0.1 * random.standard_normal() * np.cos(points[:, 0] / 60.0)
        risen = (heights(points, seed, 0.2, 12.0) + wave) / cosines
        for _ in range(30):
            ranges[met] = distances - risen + 0.1 * random.standard_normal(len(risen))
            estimate = corrected(model, estimate, ranges).estimate
        turned = Rotation.from_matrix(estimate.rotation).as_rotvec()
        errors = np.concatenate([estimate.mean[POSITION] - place, turned])
        off.append(errors @ np.linalg.solve(estimate.covariance[np.ix_(pose, pose)], errors))
    assert np.mean(off) < 1.4**2 * len(pose), f"{np.mean(off)}"


def test_relief_is_not_taken_for_an_error_of_the_lidar() -> None:
    """A ball is left behind: how far away it is stays as unsure as the scale of the ranges."""
    ball = Polyhedron.from_trimesh(trimesh.creation.icosphere(4, 270.0), "m")
    model = FrameModel(
        ball, LidarGeometry(12, 360, 2000.0), 0.05, MapError(ball).with_relief(0.2, 12.0)
    )
    told = ExpectedErrors(lidar_scale=1e-4, lidar_bias_m=0.01, attitude_deg=0.05)
    spin = np.array([0.0, 0.0, 4e-4])
    sigma = first_sigmas(told, spin, model.map_error.coefficients, 1.0, 0.0)
    ways = 20.0 * np.array([0.0, 0.3, 1.0]) / np.hypot(0.3, 1.0)
    held, start, off = np.r_[LIDAR_BIAS, LIDAR_SCALE], np.array([20.0, 0.0, 370.0]), []
    for seed in range(8):
        random = np.random.default_rng(seed)
        scale, place = 1e-4 * random.standard_normal(), start.copy()
        estimate = first_estimate(place, np.eye(3), sigma)
        for _ in range(30):
            met, points, distances, cosines = seen_of(ball, model, place)
            ranges = np.full(len(met), np.inf)
            risen = heights(points, seed, 0.2, 12.0) / cosines
            noise = 0.05 * random.standard_normal(len(risen))
            ranges[met] = (1.0 + scale) * (distances - risen) + noise
            found = corrected(model, estimate, ranges).estimate
            place = place + ways
            mean = found.mean.copy()
            mean[POSITION] += ways
            estimate = forgotten(found._replace(mean=mean), found, BASE, 12.0)
        up, error = place / np.linalg.norm(place), estimate.mean[POSITION] - place
        pose = estimate.covariance[POSITION, POSITION]
        off.append((up @ error) ** 2 / (up @ pose @ up))
        np.testing.assert_array_equal(estimate.mean[held], 0.0)
        np.testing.assert_array_equal(np.sqrt(np.diag(estimate.covariance))[held], [0.01, 1e-4])
        assert np.linalg.eigvalsh(estimate.covariance)[0] > -1e-12
    assert np.mean(off) < 2.0, f"{off}"
