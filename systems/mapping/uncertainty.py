"""What is uncertain of a survey's map, and where."""

from __future__ import annotations

import dataclasses as dc
from typing import NamedTuple

import numpy as np

from proxops.systems.common import Values, Vector3, one_thread
from proxops.systems.mapping.returns import Returns
from proxops.systems.mapping.survey_fit import (
    AFFINE,
    GRAVITY,
    INERTIA,
    RATE,
    ROTATION,
    Solution,
    Survey,
    matched,
)
from proxops.systems.shapes import Surface, rigid_motions, vertex_normals

# Random vectors by which the vertices' own errors are computed.
_PROBES = 200
# The theory is linear and takes returns as independent: its deviations are taken so much larger.
_DOUBT = 1.5
# Columns of the correlated part that hold all but this share of it are kept, and the most of them.
_NEGLIGIBLE, _MOST = 0.02, 120
# Of the returns of a frame on one facet, the errors that beams and curvature make are alike.
_FEWEST = 3.0


class MapUncertainty(NamedTuple):
    """One standard deviation of a map along its normals, and of what was found beside."""

    deviations: Values
    """(V,) in m, at each vertex."""
    table: np.ndarray
    """(V, M) in m: displacement of each vertex by independent errors of variance 1."""
    rest: float
    """m^2: variance of what is finer than that."""
    correlation: float
    """In m: over how much the errors are alike."""
    counts: Values
    """(V,): returns about each vertex."""
    gravity: float
    """Of GM, over GM."""
    pole: float
    """Of the spin axis in the frame of the map, in rad, about each of two axes."""
    rate: float
    """Of the spin rate, over the rate."""
    centre: Vector3
    """(3,) in m: of the centre of mass in the frame of the map, along the axes of B."""
    weights: Values
    """(V,): share of each vertex in the area of the map."""

    @property
    def covered(self) -> float:
        """Share of the surface that has returns."""
        return float(self.weights @ (self.counts >= _FEWEST))

    @property
    def rms(self) -> float:
        """Root mean square in m of the deviations over the surface."""
        return float(np.sqrt(self.weights @ self.deviations**2))


@one_thread()
def map_uncertainty(survey: Survey, solution: Solution, returns: Returns) -> MapUncertainty:
    """Says what is uncertain of a map, by the covariance of the last step and its residuals.

    Who uses a map registers it: that it is moved or turned as a whole is no error of its surface.
    It is one of the centre of mass and of the spin axis, which lie elsewhere in it. What its facets
    are too coarse for is the root mean square of the residuals beyond the range noise.
    """
    vertices, facets = survey.vertices, survey.facets
    # The diagonal of an inverse, by random signs (Hutchinson): off it there is little.
    signs = np.random.default_rng(0).choice([-1.0, 1.0], (len(vertices), _PROBES))
    own = np.abs(np.mean(signs * solution.factor.solve(signs), axis=1))
    # Heights follow the global unknowns: h = h0 - cross g, but for what moves all of the map.
    count = len(solution.covariance)
    tail = count - len(survey.tail)
    moving = -solution.cross.copy()
    size = float(np.ptp(vertices, axis=0).max())
    places = np.concatenate([np.ones((len(vertices), 1)), vertices / size], axis=1)
    affine = (places[:, :, None] * solution.outward[:, None]).reshape(-1, 12)
    moving[:, tail:][:, AFFINE] += affine
    rigid = rigid_motions(vertices, solution.outward, np.zeros(3), size)
    register = np.linalg.pinv(rigid)
    whole = register @ moving
    moving -= rigid @ whole
    # Unknowns are of many units: correlations have eigenvectors that rounding leaves whole.
    each = np.sqrt(np.diag(solution.covariance))
    alike = solution.covariance / np.outer(each, each)
    values, vectors = np.linalg.eigh(0.5 * (alike + alike.T))
    table = (moving * each) @ (vectors * np.sqrt(np.maximum(values, 0.0)))
    left, singular, _ = np.linalg.svd(table, full_matrices=False)
    held = np.cumsum(singular**2) / max(float((singular**2).sum()), 1e-300)
    modes = min(_MOST, int(np.searchsorted(held, 1.0 - _NEGLIGIBLE)) + 1)
    table = _DOUBT * left[:, :modes] * singular[:modes]
    places = survey.placed(returns).points
    match = matched(places, vertices, facets)
    counts = np.bincount(facets[match.facets].ravel(), match.places.ravel(), len(vertices))
    coarse = _coarseness(match, counts, facets, solution)
    spread = np.sqrt(_DOUBT**2 * own + coarse**2)
    deviations = np.sqrt(spread**2 + np.einsum("vm,vm->v", table, table))
    edges = np.linalg.norm(vertices[facets] - vertices[np.roll(facets, -1, axis=1)], axis=2)
    areas = vertex_normals(Surface(vertices, facets))[1]
    weights = areas / areas.sum()
    sigma = np.sqrt(np.diag(solution.covariance)[tail:])
    rate, axis = float(sigma[RATE][0] / abs(survey.rate)), 0.0
    if survey.tumbling is not None:
        rate, axis = _of_the_rate(survey, solution.covariance[tail:, tail:], returns.times[-1])
    # Of the map against the axis and the centre of mass: what all of it has in common, and what
    # the errors of single vertices do to a registration.
    common = np.einsum("ig,gh,ih->i", whole, solution.covariance, whole)
    motion = np.sqrt(common + register**2 @ spread**2)
    return MapUncertainty(
        deviations, table, float(weights @ spread**2), float(np.mean(edges)), counts,
        float(sigma[GRAVITY][0] / survey.gm),
        float(np.hypot(motion[3:5].max() / size, axis)), rate, motion[:3], weights,
    )  # fmt: skip


def _of_the_rate(survey: Survey, covariance: np.ndarray, time: float) -> tuple[float, float]:
    """Of the angular velocity of a body that tumbles: its size, over that, and direction in rad.

    At a time in s; `covariance` is that of the survey's tail.
    """
    now, columns = survey.angular_velocity(time), []
    size = float(np.linalg.norm(now))
    known = [*range(ROTATION.start, ROTATION.stop), *range(INERTIA.start, INERTIA.stop)]
    for k in known:
        step, tail = 1e-5 * (size if k < ROTATION.stop else 1.0), survey.tail.copy()
        tail[k] += step
        columns.append((dc.replace(survey, tail=tail).angular_velocity(time) - now) / step)
    by = np.stack(columns, axis=1)
    spread = by @ covariance[np.ix_(known, known)] @ by.T
    along = now / size
    across = np.eye(3) - np.outer(along, along)
    widest = float(np.linalg.eigvalsh(across @ spread @ across)[-1])
    return float(np.sqrt(along @ spread @ along)) / size, float(np.sqrt(widest)) / size


def _coarseness(match, counts, facets, solution: Solution) -> Values:
    """Standard deviation (V,) in m of what the facets about each vertex do not follow."""
    squares = solution.residuals**2
    noise = solution.deviations**2
    usual = max(float(np.median(squares) / 0.455 - np.median(noise)), 0.0)
    inner = np.bincount(
        facets[match.facets].ravel(),
        (match.places * np.minimum(squares, 25.0 * noise)[:, None]).ravel(),
        len(counts),
    )
    mean = inner / np.maximum(counts, 1.0)
    local = np.sqrt(np.maximum(mean, usual))
    return np.where(counts < _FEWEST, np.maximum(local, np.sqrt(noise.mean())), local)
