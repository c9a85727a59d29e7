"""One step of the batch least squares beside finite differences and a dense solution."""

import dataclasses as dc

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from proxops.systems.common import InputError
from proxops.systems.mapping import batch, survey_fit
from proxops.systems.mapping.path import Path
from proxops.systems.mapping.returns import Returns
from proxops.systems.mapping.spheres import sphere
from proxops.systems.mapping.survey_fit import (
    ACCELERATION,
    AFFINE,
    GRAVITY,
    RATE,
    ROTATION,
    TAIL,
    TAIL_OF_TUMBLING,
    Expected,
    Survey,
    Tumbling,
    Weighting,
    improved,
    matched,
)

AXES = np.array([100.0, 60.0, 50.0])
GM, RADIUS, RATE_TRUE = 2.0, 260.0, 3e-4
EXPECTED = Expected(noise=0.05, bias=0.01, mounting=1e-3, varying=3e-6, beam=1e-3)


def seen_ellipsoid(frames=60, rays=120, noise=0.05) -> tuple[Returns, np.ndarray]:
    """Exact returns of an ellipsoid from a circular orbit over the poles, and the positions in N.

    A point mass pulls at the orbit: gravity of the ellipsoid is not simulated.
    """
    random = np.random.default_rng(1)
    times = np.linspace(0.0, 40_000.0, frames)
    n = np.sqrt(GM / RADIUS**3)
    places = RADIUS * np.stack([np.cos(n * times), np.zeros(frames), np.sin(n * times)], axis=1)
    directions, ranges, owners = [], [], []
    for k in range(frames):
        turn = Rotation.from_rotvec([0.0, 0.0, RATE_TRUE * times[k]])
        start = turn.inv().apply(places[k])
        aim = random.uniform(-1.0, 1.0, (rays, 3)) * AXES
        ray = (aim - start) / np.linalg.norm(aim - start, axis=1, keepdims=True)
        a = ((ray / AXES) ** 2).sum(axis=1)
        b = (ray * start / AXES**2).sum(axis=1)
        c = ((start / AXES) ** 2).sum() - 1.0
        root = b**2 - a * c
        met = root > 0.0
        ranges.append((-b[met] - np.sqrt(root[met])) / a[met])
        directions.append(ray[met])
        owners.append(np.full(met.sum(), k))
    attitudes = Rotation.from_rotvec(np.outer(RATE_TRUE * times, [0.0, 0.0, 1.0])).as_matrix()
    lengths = np.concatenate(ranges)
    lengths = lengths + noise * random.standard_normal(len(lengths))
    returns = Returns(
        times, attitudes, np.zeros((frames, 3)), np.concatenate(owners),
        np.concatenate(directions), lengths,
    )  # fmt: skip
    return returns, places


@pytest.fixture(scope="module")
def case() -> tuple[Survey, Returns]:
    returns, places = seen_ellipsoid()
    path, ball = Path.between(0.0, 40_000.0, 2000.0), sphere(2)
    coefficients = np.linalg.lstsq(path.matrix(returns.times), places, rcond=None)[0]
    tail = np.zeros(TAIL)
    tail[RATE], tail[GRAVITY] = RATE_TRUE, GM
    survey = Survey(
        path, coefficients, (returns.times, returns.driven), np.zeros((3, 3)),
        np.linspace(0.0, 40_000.0, 3), tail, 0.0, 0.0, ball.vertices * AXES * 1.02, ball.facets,
    )  # fmt: skip
    return survey, returns


def residuals(survey: Survey, returns: Returns, match: survey_fit.Match) -> np.ndarray:
    points = survey.placed(returns).points
    corner = survey.vertices[survey.facets[match.facets, 0]]
    return np.einsum("ki,ki->k", points - corner, match.normals)


@pytest.fixture(scope="module")
def tumbling(case) -> tuple[Survey, Returns]:
    """The same path about a body that tumbles."""
    survey, returns = case
    tail = np.zeros(TAIL_OF_TUMBLING)
    tail[ROTATION] = RATE_TRUE * np.array([0.3, 0.2, 0.9])
    tail[GRAVITY], tail[ACCELERATION] = GM, [1e-6, -2e-6, 1e-6]
    start = Rotation.from_rotvec([0.2, -0.1, 0.4]).as_matrix()
    about = Tumbling(start, np.diag([1.0, 1.9, 2.1]))
    return dc.replace(survey, tail=tail, epoch=20_000.0, tumbling=about), returns


def derivatives(of, survey: Survey, unknown: int, step: float) -> np.ndarray:
    """Central differences of a function of a survey, by one unknown of its tail."""
    either = []
    for sign in (1.0, -1.0):
        tail = survey.tail.copy()
        tail[unknown] += sign * step
        either.append(of(dc.replace(survey, tail=tail)))
    return (either[0] - either[1]) / (2.0 * step)


SHARED = [*[(i, 1e-6) for i in range(5)], (5, 1e-10), (6, 1e-3), (7, 1e-6)]
TUMBLING = [*[(i, 1e-10) for i in range(3, 6)], *[(i, 1e-6) for i in range(21, 26)]]
STEPS = [*[("case", *each) for each in SHARED], *[("tumbling", *each) for each in TUMBLING]]


@pytest.mark.parametrize(("name", "unknown", "step"), STEPS)
def test_derivatives_of_what_all_returns_share(request, name, unknown, step) -> None:
    survey, returns = request.getfixturevalue(name)
    placed = survey.placed(returns)
    match = matched(placed.points, survey.vertices, survey.facets)
    rows, _ = survey_fit._rows(survey, returns, placed, match)
    wanted = derivatives(lambda other: residuals(other, returns, match), survey, unknown, step)
    # How a body that tumbles turns is differenced forwards.
    tolerance = {"case": 1e-4, "tumbling": 1e-3}[name] * np.abs(wanted).max()
    np.testing.assert_allclose(rows[:, 24 + unknown], wanted, atol=tolerance)


@pytest.mark.parametrize(
    ("unknown", "step"), [*TUMBLING, (26, 1e-4), (27, 1e-9), (28, 1e-9), (29, 1e-9)]
)
def test_derivatives_of_the_motion(tumbling, unknown: int, step: float) -> None:
    survey, _ = tumbling
    count = 3 * survey.path.size + 9 + TAIL_OF_TUMBLING
    rows, _ = survey_fit.motion_rows(survey, count)
    wanted = derivatives(
        lambda other: survey_fit.motion_rows(other, count)[1], survey, unknown, step
    )
    found = rows[:, :, count - TAIL_OF_TUMBLING + unknown]
    np.testing.assert_allclose(found, wanted, atol=1e-3 * np.abs(wanted).max())


def test_a_step_is_that_of_dense_normal_equations(case) -> None:
    survey, returns = case
    weighting = Weighting(surface=1.0, roughness=0.3, free=True, slide=5.0)
    after, solution = improved(survey, returns, survey, EXPECTED, weighting)
    step = np.r_[
        (after.coefficients - survey.coefficients).ravel(), after.turns.ravel(),
    ]  # fmt: skip
    placed = survey.placed(returns)
    match = matched(placed.points, survey.vertices, survey.facets)
    rows, incidences = survey_fit._rows(survey, returns, placed, match)
    starts = survey_fit._starts(survey, returns)[returns.frames]
    count, size = 3 * survey.path.size + 9 + TAIL, len(survey.vertices)
    whole = np.zeros((len(rows), count + size))
    each = np.arange(len(rows))[:, None]
    whole[each, starts[:, :1] + np.arange(18)] = rows[:, :18]
    whole[each, starts[:, 1:] + np.arange(6)] = rows[:, 18:24]
    whole[:, count - TAIL : count - 4] = rows[:, 24:]
    corners = survey.facets[match.facets]
    outward = survey_fit._outward(survey, True)
    motions = -match.places * np.einsum("kci,ki->kc", outward[corners], match.normals)
    np.add.at(whole, (each, count + corners), motions)
    variances = 1.0 + (EXPECTED.noise * incidences) ** 2
    weights = 1.0 / (variances + solution.residuals**2 / 4.0)
    matrix, right = np.zeros((count, count)), np.zeros(count)
    survey_fit.add_motion(survey, EXPECTED, matrix, right)
    survey_fit._add_priors(survey, survey, EXPECTED, weighting, matrix, right)
    own = np.bincount(corners.ravel(), (weights[:, None] * motions**2).ravel(), size)
    smooth, target = survey_fit._smoothness(survey, outward, 0.3, own)
    full = whole.T @ (weights[:, None] * whole)
    full[:count, :count] += matrix
    full[count:, count:] += smooth.toarray()
    side = whole.T @ (weights * solution.residuals) + np.r_[right, target]
    wanted = -np.linalg.solve(full, side)
    np.testing.assert_allclose(step, wanted[: len(step)], rtol=1e-3, atol=1e-5)
    assert np.abs(after.tail[AFFINE]).max() == 0.0
    inverse = np.linalg.inv(full)[:count, :count]
    np.testing.assert_allclose(
        np.diag(solution.covariance), np.diag(inverse), rtol=1e-3, atol=1e-12
    )


def test_steps_find_the_ellipsoid(case) -> None:
    survey, returns = case
    weighting = Weighting(surface=0.5, roughness=0.3, free=True, slide=5.0)
    survey, solution = improved(survey, returns, survey, EXPECTED, weighting)
    for _ in range(2):
        survey, solution = improved(survey, returns, survey, EXPECTED, weighting)
    volume = trimesh.Trimesh(survey.vertices, survey.facets, process=False).volume
    # It began at 1.02 ** 3 of it, less what facets cut off.
    assert abs(volume / (4.0 / 3.0 * np.pi * AXES.prod()) - 1.0) < 0.01
    assert np.median(np.abs(solution.residuals)) < 0.3


@pytest.mark.parametrize("factor", [0.5, 2.0])
def test_a_map_of_another_size_is_refused(case, factor: float) -> None:
    batch._check_size(case[0].vertices, AXES)
    with pytest.raises(InputError, match="another body"):
        batch._check_size(case[0].vertices, factor * AXES)


def test_a_vertex_that_stands_out_alone_ends_no_estimate_but_no_map() -> None:
    """False returns may draw one out, while the map is coarse and star-shaped."""
    vertices = sphere(3).vertices * AXES
    vertices[7] *= 9.0
    batch._check_size(np.quantile(vertices, batch._MOST_OF_IT, axis=0), AXES)
    with pytest.raises(InputError, match="another body"):
        batch._check_size(vertices, AXES)


def test_nearest_places_are_those_of_trimesh() -> None:
    ball, random = sphere(2), np.random.default_rng(2)
    points = random.standard_normal((300, 3)) * 1.5
    match = matched(points, ball.vertices, ball.facets)
    feet = np.einsum("kc,kci->ki", match.places, ball.vertices[ball.facets[match.facets]])
    mesh = trimesh.Trimesh(ball.vertices, ball.facets, process=False)
    _, distances, _ = trimesh.proximity.closest_point(mesh, points)
    found = np.linalg.norm(points - feet, axis=1)
    far = np.linalg.norm(points, axis=1) > 0.6
    np.testing.assert_allclose(found[far], distances[far], atol=1e-9)
