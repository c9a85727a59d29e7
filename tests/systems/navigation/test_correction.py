"""The Kalman update, against the textbook's form and against frames of known errors.

Eq. 15 to 19 of docs/method/equations.md.
"""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from short_flights import kleopatra

from proxops.systems import ExpectedErrors, ray_directions
from proxops.systems.lidar import DEFAULT_GEOMETRY
from proxops.systems.navigation import Estimate, MapError, _update_kernel, correction
from proxops.systems.navigation.correction import Correction, corrected
from proxops.systems.navigation.estimate import (
    ATTITUDE,
    BASE,
    POSITION,
    first_estimate,
    first_sigmas,
)
from proxops.systems.navigation.frame_model import FrameModel
from proxops.systems.shapes import ray_caster

PLACE = np.array([150e3, 40e3, -30e3])
TURN = Rotation.from_rotvec([0.01, -0.006, 0.009])
NOISE = 20.0


def by_returns(covariance, columns, rows, innovations, variances):
    crossed = rows @ covariance[columns]
    return correction._by_returns(covariance, columns, rows, crossed, innovations, variances)


FORMS = {"by_returns": by_returns, "by_quantities": _update_kernel.update}


# --- the linear update ----------------------------------------------------------------------------


def joseph(covariance, columns, rows, innovations, variances):
    """Gain and covariance in Joseph's form, which every textbook has."""
    n = len(covariance)
    h = np.zeros((len(rows), n))
    h[:, columns] = rows
    r = np.diag(variances)
    total = h @ covariance @ h.T + r
    gain = np.linalg.solve(total, h @ covariance).T
    left = np.eye(n) - gain @ h
    after = left @ covariance @ left.T + gain @ r @ gain.T
    return gain @ innovations, after, innovations @ np.linalg.solve(total, innovations)


@pytest.mark.parametrize("form", FORMS)
@given(
    seed=st.integers(0, 9999),
    size=st.integers(3, 12),
    count=st.integers(1, 30),
    spread=st.floats(0.0, 3.0),
)
@settings(max_examples=30)
def test_both_forms_are_the_textbook_s(
    form: str, seed: int, size: int, count: int, spread: float
) -> None:
    """Whatever the scales, and however many quantities are measured at all."""
    rng = np.random.default_rng(seed)
    columns = np.sort(rng.choice(size, rng.integers(1, size + 1), replace=False))
    scales = 10.0 ** rng.uniform(-spread, spread, size)
    root = scales[:, None] * (rng.normal(size=(size, size)) + 2.0 * np.eye(size))
    covariance = root @ root.T
    exact = rng.random(size) < 0.3  # What is exact is correlated with nothing.
    covariance[exact] = covariance[:, exact] = 0.0
    rows = rng.normal(size=(count, columns.size)) / scales[columns]
    innovations, variances = rng.normal(size=count), rng.uniform(0.1, 10.0, count)
    given_ = covariance, columns, rows, innovations, variances
    moved, after, squares = joseph(*given_)
    found = FORMS[form](covariance, columns, rows, innovations, variances)
    sigma = np.where(exact, 1.0, np.sqrt(np.diag(covariance)))
    np.testing.assert_allclose(found.moved / sigma, moved / sigma, rtol=1e-9, atol=1e-9)
    both = np.outer(sigma, sigma)
    np.testing.assert_allclose(found.covariance / both, after / both, rtol=1e-9, atol=1e-9)
    assert found.nis == pytest.approx(squares, rel=1e-8, abs=1e-9)
    np.testing.assert_allclose(found.covariance, found.covariance.T, rtol=1e-12)
    # A measurement never makes anything less certain.
    assert (np.diag(found.covariance) <= np.diag(covariance) * (1.0 + 1e-9)).all()


# --- frames ---------------------------------------------------------------------------------------


def model(std: float = 0.0) -> FrameModel:
    shape = kleopatra().shape
    return FrameModel(shape, DEFAULT_GEOMETRY, NOISE, MapError(shape, std, 15e3))


def frame(seed: int, noise: float = NOISE) -> np.ndarray:
    distances, facets, _ = ray_caster(kleopatra().shape).first_hits(
        PLACE, TURN.apply(ray_directions())
    )
    noisy = distances + noise * np.random.default_rng(seed).normal(size=distances.size)
    return np.where(facets >= 0, noisy, np.inf)


def prior(
    sigma: float, modes: int = 0, turn: float = 1e-3, off: np.ndarray | None = None
) -> Estimate:
    """Knows the place to sigma, in m; `off` (3,) of it, in m."""
    expected = ExpectedErrors(attitude_deg=np.degrees(turn))
    place = PLACE if off is None else PLACE + off
    sigmas = first_sigmas(expected, np.array([0.0, 0.0, 3e-4]), modes, sigma, 1.0)
    return first_estimate(place, TURN.as_matrix(), sigmas)


def errors(found: Correction) -> tuple[np.ndarray, np.ndarray]:
    turn = Rotation.from_matrix(found.estimate.rotation) * TURN.inv()
    return found.estimate.mean[POSITION] - PLACE, turn.as_rotvec()


def test_the_covariance_says_how_good_it_is() -> None:
    """NEES of 60 frames: a chi square of six degrees of freedom each."""
    values = []
    rng = np.random.default_rng(5)
    for seed in range(60):
        off = 200.0 * rng.normal(size=3)
        given_ = prior(200.0, off=off)
        turn = Rotation.from_rotvec(1e-3 * rng.normal(size=3))
        given_ = given_._replace(rotation=(turn * TURN).as_matrix())
        found = corrected(model(), given_, frame(seed))
        wrong = np.concatenate(errors(found))
        where = np.r_[POSITION, ATTITUDE]
        values.append(wrong @ np.linalg.solve(found.estimate.covariance[np.ix_(where, where)],
                                              wrong))  # fmt: skip
    # 95 % of means of 60 lie from 5.2 to 6.9.
    assert 4.5 < np.mean(values) < 8.0
    assert max(values) < 30.0


@pytest.mark.parametrize("std", [0.0, 100.0])
def test_false_returns_are_rejected(std: float) -> None:
    """They move nothing: the answer is that of the frame without them."""
    modelled = model(std)
    given_ = prior(300.0, modelled.map_error.modes)
    ranges = frame(2)
    wrong = np.flatnonzero(ranges < np.inf)[5::9]
    falsified, without = ranges.copy(), ranges.copy()
    falsified[wrong] *= np.random.default_rng(2).uniform(0.2, 0.9, wrong.size)
    without[wrong] = np.inf
    found, clean = (corrected(modelled, given_, each) for each in (falsified, without))
    assert found.rejected >= clean.rejected
    if std == 0.0:  # Else only some of many returns are looked at.
        assert found.rejected - clean.rejected > 0.9 * wrong.size
        assert found.used == clean.used
        np.testing.assert_allclose(found.estimate.mean, clean.estimate.mean, atol=1e-6)
    off, before = errors(found)[0], errors(clean)[0]
    assert np.linalg.norm(off) < np.linalg.norm(before) + 30.0


@pytest.mark.parametrize(("deviations", "rejected"), [(4.5, 0), (5.5, 1)])
def test_the_gate_is_at_five_standard_deviations(deviations: float, rejected: int) -> None:
    """All else is without noise, and the pose is known: the one residual has that of a range."""
    ranges = frame(3, 0.0)
    known = prior(1e-3, turn=1e-8)
    clean = corrected(model(), known, ranges)
    ranges[int(np.flatnonzero(ranges < np.inf)[40])] += deviations * NOISE
    found = corrected(model(), known, ranges)
    assert (clean.rejected, found.rejected) == (0, rejected)
    assert found.used + rejected == clean.used


def test_a_frame_of_elsewhere_is_rejected_as_a_whole() -> None:
    given_ = prior(1.0, turn=1e-6, off=np.array([30e3, 0.0, 0.0]))
    found = corrected(model(), given_, frame(4, 0.0))
    assert found.used < found.rejected


def test_a_frame_without_the_body_changes_nothing() -> None:
    given_ = prior(10.0)
    found = corrected(model(), given_, np.full(DEFAULT_GEOMETRY.size, np.inf))
    assert (found.used, found.rejected) == (0, 0)
    assert np.isnan(found.rms)
    assert found.estimate is given_


def test_what_is_not_seen_stays_uncertain() -> None:
    """A frame says nothing of velocity or thrust when they are not correlated with the pose."""
    given_ = prior(300.0)
    found = corrected(model(), given_, frame(6)).estimate
    unseen = np.r_[3:6, 9:BASE]
    np.testing.assert_array_equal(found.mean[unseen], given_.mean[unseen])
    np.testing.assert_allclose(
        np.diag(found.covariance)[unseen], np.diag(given_.covariance)[unseen], rtol=1e-12
    )


def test_what_is_correlated_is_learned() -> None:
    """A velocity that made all of the position's error is known as well as the position."""
    given_ = prior(300.0)
    time = 50.0
    covariance = given_.covariance.copy()
    for i in range(3):
        block = np.ix_([i, 3 + i], [i, 3 + i])
        covariance[block] = 300.0**2 * np.array([[1.0, 1.0 / time], [1.0 / time, 1.0 / time**2]])
    mean = given_.mean.copy()
    mean[POSITION] += [200.0, -250.0, 100.0]
    mean[3:6] += np.array([200.0, -250.0, 100.0]) / time
    found = corrected(model(), Estimate(mean, given_.rotation, covariance), frame(7))
    off = found.estimate.mean[POSITION] - PLACE
    np.testing.assert_allclose(found.estimate.mean[3:6], off / time, atol=1e-6)
    sigma = np.sqrt(np.diag(found.estimate.covariance))
    np.testing.assert_allclose(sigma[3:6], sigma[:3] / time, rtol=1e-3)


def test_shift_is_the_distance_in_deviations() -> None:
    given_ = prior(300.0, off=np.array([600.0, 0.0, 0.0]))
    found = corrected(model(), given_, frame(9))
    moved = found.estimate.mean[POSITION] - given_.mean[POSITION]
    turned = Rotation.from_matrix(found.estimate.rotation @ given_.rotation.T).as_rotvec()
    by_hand = moved @ moved / 300.0**2 + turned @ turned / 1e-6
    assert found.shift == pytest.approx(by_hand, rel=1e-6)
    assert 3.0 < found.shift < 5.0
