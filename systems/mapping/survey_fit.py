"""The batch least squares of a survey: path, attitude, rotation, gravity and surface at once.

A return at the vector y from the spacecraft at p, both in N, lies in the body at R_BN (p + y). Its
residual is its distance from the map's surface, along the normal. One step of Gauss-Newton solves
for all unknowns; heights of the map are eliminated first, because they are sparse.
"""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import scipy.linalg
import scipy.sparse as sp
from scipy.sparse.linalg import SuperLU, splu
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

from proxops.systems.common import Matrix3, Values, Vector3, Vectors3, one_thread
from proxops.systems.gravity import MoonConfig, tides
from proxops.systems.mapping._nearest_kernel import nearest_of
from proxops.systems.mapping._normal_kernel import LOCAL, add_returns
from proxops.systems.mapping.mass_points import MassPoints
from proxops.systems.mapping.path import DEGREE, Path
from proxops.systems.mapping.returns import Returns
from proxops.systems.rotation import TorqueFreeSpin
from proxops.systems.shapes import Surface, vertex_normals

# Facets, by nearness of their centroids, among which the nearest point is looked for.
_CANDIDATES = 8
# Unknowns that all returns depend on, then those of the dynamics. A body that tumbles has an
# inertia, too.
MOUNTING, ROTATION, POLE, RATE, BIAS, SCALE, BEAM, AFFINE, INERTIA, GRAVITY, ACCELERATION = (
    slice(0, 3), slice(3, 6), slice(3, 5), slice(5, 6), slice(6, 7), slice(7, 8), slice(8, 9),
    slice(9, 21), slice(21, 26), slice(-4, -3), slice(-3, None),
)  # fmt: skip
TAIL, TAIL_OF_TUMBLING = 25, 30
# Relative step of rates, and of an inertia over its trace, by which derivatives of a rotation are
# taken; and what an inertia may be off that of the map.
_RATE_STEP, _UNEVEN = 1e-5, 1e-4
# What changes an inertia, but for its size.
_UNEVENLY = np.zeros((5, 3, 3))
_UNEVENLY[[0, 0, 1, 1], [0, 1, 1, 2], [0, 1, 1, 2]] = [1.0, -1.0, 1.0, -1.0]
_UNEVENLY[[2, 2, 3, 3, 4, 4], [0, 1, 0, 2, 1, 2], [1, 0, 2, 0, 2, 1]] = 1.0
# A vertex moves in one step by no more than about this share of the edges' length, where no return
# says how far.
_STEP = 0.3


class Expected(NamedTuple):
    """One standard deviation of what is wrong before the survey, and of what varies."""

    gravity: float = 0.11
    """Of GM, over GM."""
    pole: float = 0.02
    """Of the direction of the spin axis, in rad."""
    rate: float = 3e-5
    """Of the spin rate, over the rate."""
    mounting: float = 6e-4
    """Of the attitude, constant, about each axis of S, in rad."""
    turning: float = 1.2e-4
    """Of the attitude, of what varies, in rad."""
    turning_time: float = 3600.0
    """In s, over which its correlation falls to 1/e."""
    noise: float = 50.0
    """Of a range, in m."""
    bias: float = 3.0
    """Of all ranges, in m."""
    scale: float = 1e-4
    """Of all ranges, over the range."""
    beam: float = 0.0
    """Half of the angle of the lidar's beams in rad, as far as it may be."""
    acceleration: float = 0.0
    """Of one that is constant in the body's frame, along each axis, in m/s^2."""
    varying: float = 1e-7
    """Of one that varies, in m/s^2."""
    varying_time: float = 600.0
    """In s, over which its correlation falls to 1/e."""
    thrust: float = 0.03
    """Of the thrust's acceleration, over that."""
    least_impulse: float = 0.0
    """In N s, below which a thruster gives nothing: no error, but known."""


class Tumbling(NamedTuple):
    """How a body turns that tumbles. Its angular velocity at the epoch is estimated."""

    start: Matrix3
    """R_NB (3, 3) at the epoch: it is chosen, not estimated."""
    inertia: Matrix3
    """(3, 3) in B, up to a factor: of the map with uniform density, once there is one. By how much
    it is off is estimated."""


@dc.dataclass
class Survey:
    """What is estimated, as it is now."""

    path: Path
    coefficients: np.ndarray
    """(J, 3) in m: of the path in N, less what thrust has moved."""
    driven: tuple[Values, Vectors3]
    """Times (F,) in s, and how far thrust has moved the spacecraft (F, 3) in m in N: known."""
    turns: np.ndarray
    """(A, 3) in rad: rotation vectors in S, of the attitude's error at `turn_times`."""
    turn_times: Values
    tail: np.ndarray
    """(TAIL,): mounting (3) in rad, pole (2) in rad and rate in rad/s (of a body that tumbles: its
    angular velocity at the epoch (3) in rad/s in B), bias in m, scale, half beam in rad, twelve
    that stay 0, where it tumbles what its inertia over its trace is off that of the map (5), and of
    gravity the GM in m^3/s^2 and a constant acceleration (3) in m/s^2 in B."""
    epoch: float
    """Time in s at which the phase is `phase`."""
    phase: float
    """Of the body's frame B, in rad: it is chosen, not estimated."""
    vertices: Vectors3
    """(V, 3) in m in B: the map."""
    facets: np.ndarray
    kicks: Values = dc.field(default_factory=lambda: np.zeros(0))
    """(B,) in m/s: by how much commands change the velocity at the kinks of the path."""
    moons: Sequence[MoonConfig] = ()
    """As they are believed; N has the axes that B is believed to have at time 0."""
    tumbling: Tumbling | None = None
    """None: it turns steadily about z of B."""

    def body_attitudes(self, times: Values) -> np.ndarray:
        """R_NB (T, 3, 3) at times (T,) in s."""
        if self.tumbling is not None:
            return self._turned(self.tail, times)
        about = self.tail[RATE] * (times - self.epoch) + self.phase
        spins = Rotation.from_rotvec(about[:, None] * [0.0, 0.0, 1.0])
        return (self.pole * spins).as_matrix()

    def _spin(self, tail: Values) -> TorqueFreeSpin:
        assert self.tumbling is not None
        even = self.tumbling.inertia / np.trace(self.tumbling.inertia)
        return TorqueFreeSpin(even + np.tensordot(tail[INERTIA], _UNEVENLY, 1), tail[ROTATION])

    def _turned(self, tail: Values, times: Values) -> np.ndarray:
        assert self.tumbling is not None
        attitudes = self._spin(tail).attitudes(times - self.epoch)
        turned = Rotation.from_quat(attitudes, scalar_first=True).as_matrix()
        return self.tumbling.start @ turned

    def turning(self, times: Values) -> np.ndarray:
        """Rotation vectors (T, 8, 3) in N by which B turns more, by each of ROTATION and INERTIA.

        Of a body that tumbles.
        """
        now, turned = self.body_attitudes(times).transpose(0, 2, 1), []
        for k in (*range(ROTATION.start, ROTATION.stop), *range(INERTIA.start, INERTIA.stop)):
            step = _RATE_STEP * (self.rate if k < ROTATION.stop else 1.0)
            other = self.tail.copy()
            other[k] += step
            turned.append(Rotation.from_matrix(self._turned(other, times) @ now).as_rotvec() / step)
        return np.stack(turned, axis=1)

    def angular_velocity(self, time: float) -> Vector3:
        """(3,) in rad/s in B at a time in s."""
        if self.tumbling is None:
            return np.array([0.0, 0.0, self.rate])
        return self._spin(self.tail).angular_velocity(time - self.epoch)

    @property
    def gm(self) -> float:
        """GM in m^3/s^2."""
        return float(self.tail[GRAVITY][0])

    @property
    def rate(self) -> float:
        """The spin rate in rad/s; of a body that tumbles, its size at the epoch."""
        if self.tumbling is not None:
            return float(np.linalg.norm(self.tail[ROTATION]))
        return float(self.tail[RATE][0])

    @property
    def pole(self) -> Rotation:
        """Turns z of N onto the spin axis."""
        return Rotation.from_rotvec([*self.tail[POLE], 0.0])

    @property
    def axis(self) -> Vector3:
        """(3,): the spin axis in N."""
        return self.pole.as_matrix()[:, 2]

    def positions(self, times: Values) -> Vectors3:
        """Of the spacecraft (T, 3) in m in N at times (T,) in s."""
        return self.path.matrix(times) @ self.coefficients + self.moved(times)

    def moved(self, times: Values) -> Vectors3:
        """How far thrust has moved the spacecraft (T, 3) in m in N at times (T,) in s."""
        known, driven = self.driven
        return np.stack([np.interp(times, known, column) for column in driven.T], axis=1)

    def placed(self, returns: Returns) -> Placed:
        """The returns as this places them."""
        turns = np.stack(
            [np.interp(returns.times, self.turn_times, column) for column in self.turns.T], axis=1
        )
        errors = Rotation.from_rotvec(turns + self.tail[MOUNTING]).as_matrix()
        attitudes = returns.attitudes @ errors
        along = np.einsum("kij,kj->ki", attitudes[returns.frames], returns.directions)
        lengths = returns.ranges * (1.0 - self.tail[SCALE]) - self.tail[BIAS]
        at = self.positions(returns.times)[returns.frames] + lengths[:, None] * along
        bodies = self.body_attitudes(returns.times)
        points = np.einsum("kji,kj->ki", bodies[returns.frames], at)
        return Placed(points, at, along, attitudes, bodies)


class Placed(NamedTuple):
    """Returns in the frame of the body."""

    points: Vectors3
    """(K, 3) in m in B."""
    inertial: Vectors3
    """(K, 3): the same in N."""
    along: Vectors3
    """(K, 3): the rays in N."""
    attitudes: np.ndarray
    """(F, 3, 3): R_NS."""
    bodies: np.ndarray
    """(F, 3, 3): R_NB."""


class Match(NamedTuple):
    """The places of a mesh that are nearest to points."""

    facets: Values
    """(K,) int."""
    places: np.ndarray
    """(K, 3): weights of the facet's corners."""
    normals: Vectors3
    """(K, 3)."""
    heights: Values
    """(K,) in m: of the points over the facets' planes."""


def facet_normals(vertices: Vectors3, facets: np.ndarray) -> Vectors3:
    """The outward unit normals (F, 3) of a mesh."""
    corners = vertices[facets]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return normals / np.linalg.norm(normals, axis=1, keepdims=True)


def matched(points: Vectors3, vertices: Vectors3, facets: np.ndarray) -> Match:
    """Finds the place of a mesh that is nearest to each point (K, 3), all in one frame in m."""
    tree = KDTree(vertices[facets].mean(axis=1))
    _, candidates = tree.query(points, k=_CANDIDATES)
    chosen, places = np.empty(len(points), dtype=np.int64), np.empty((len(points), 3))
    nearest_of(points, candidates, vertices, facets, chosen, places)
    normals = facet_normals(vertices, facets)[chosen]
    heights = np.einsum("ki,ki->k", points - vertices[facets[chosen, 0]], normals)
    return Match(chosen, places, normals, heights)


class Weighting(NamedTuple):
    """How one step weighs what it fits."""

    surface: float
    """Standard deviation in m of the map's own error along the normal, beside the range's."""
    roughness: float
    """Standard deviation of a vertex from the mean of its neighbours, over the edges' length."""
    free: bool = False
    """Whether vertices move along the normals; otherwise away from the origin."""
    slide: float = 0.0
    """Standard deviation in m by which the map as a whole moves and stretches in this step."""
    hold: bool = False
    """Whether attitude, pole and rate stay as they are believed."""


class Solution(NamedTuple):
    """The normal equations of a step, after it."""

    factor: SuperLU
    """Of the heights' own matrix (V, V)."""
    cross: np.ndarray
    """(V, G): of heights and global unknowns, solved by that matrix."""
    covariance: np.ndarray
    """(G, G): of the global unknowns."""
    outward: Vectors3
    """(V, 3): along which the heights are."""
    residuals: Values
    """(K,) in m, before the step."""
    deviations: Values
    """(K,) in m: of the residuals, as they are expected to be."""
    moved: float
    """Root mean square in m of the heights' step."""


@one_thread()
def improved(
    survey: Survey, returns: Returns, prior: Survey, expected: Expected, weighting: Weighting
) -> tuple[Survey, Solution]:
    """Takes one step of Gauss-Newton.

    Args:
      survey: as it is now. returns: what was measured.
      prior: its `tail` is what was believed before. expected: how wrong that may be.
      weighting: of this step.

    Returns:
      The survey after the step, and what the step knows.
    """
    placed = survey.placed(returns)
    match = matched(placed.points, survey.vertices, survey.facets)
    outward = _outward(survey, weighting.free)
    rows, incidences = _rows(survey, returns, placed, match)
    corners = survey.facets[match.facets]
    motions = -match.places * np.einsum("kci,ki->kc", outward[corners], match.normals)
    residuals = match.heights - survey.tail[BEAM] * returns.ranges * np.sqrt(1.0 - incidences**2)
    variances = weighting.surface**2 + (expected.noise * incidences) ** 2
    # Cauchy's weights: an outlier counts little.
    weights = 1.0 / (variances + residuals**2 / 4.0)
    count = 3 * survey.path.size + survey.turns.size + len(survey.tail)
    size = len(survey.vertices)
    equations = np.zeros((count, count)), np.zeros((size, count)), np.zeros(count)
    add_returns(
        returns.frames, _starts(survey, returns), rows, residuals, weights, corners, motions,
        equations,
    )  # fmt: skip
    matrix, cross, right = equations
    matrix += np.triu(matrix, 1).T
    add_motion(survey, expected, matrix, right)
    _add_priors(survey, prior, expected, weighting, matrix, right)
    heights = sp.csr_matrix(
        (motions.ravel(), corners.ravel(), np.arange(0, motions.size + 1, 3)),
        shape=(len(residuals), size),
    )
    own = (heights.T @ sp.diags_array(weights) @ heights).tocsc()
    side = heights.T @ (weights * residuals)
    smooth, target = _smoothness(survey, outward, weighting.roughness, own.diagonal())
    factor = splu(own + smooth)
    side = side + target
    solved = factor.solve(cross)
    reduced = matrix - cross.T @ solved
    chol = scipy.linalg.cho_factor(reduced)
    step = -scipy.linalg.cho_solve(chol, right - solved.T @ side)
    risen = -factor.solve(side) - solved @ step
    covariance = scipy.linalg.cho_solve(chol, np.eye(count))
    deviations = np.sqrt(variances)
    moved = float(np.sqrt(np.mean(risen**2)))
    after = _stepped(survey, step, risen, outward)
    return after, Solution(factor, solved, covariance, outward, residuals, deviations, moved)


def _outward(survey: Survey, free: bool) -> Vectors3:
    """Unit vectors (V, 3) along which the vertices move."""
    if not free:
        return survey.vertices / np.linalg.norm(survey.vertices, axis=1, keepdims=True)
    return vertex_normals(Surface(survey.vertices, survey.facets))[0]


def _starts(survey: Survey, returns: Returns) -> np.ndarray:
    """Where the unknowns of each frame's path and attitude begin: (F, 2)."""
    path = 3 * survey.path.basis(returns.times).first
    return np.stack([path, 3 * survey.path.size + 3 * _nodes(survey, returns)], axis=1)


def _nodes(survey: Survey, returns: Returns) -> np.ndarray:
    """The node (F,) of the attitude's error at or before each frame, but for the last."""
    node = np.searchsorted(survey.turn_times, returns.times, side="right") - 1
    return np.clip(node, 0, len(survey.turn_times) - 2)


def _rows(
    survey: Survey, returns: Returns, placed: Placed, match: Match
) -> tuple[np.ndarray, Values]:
    """Derivatives (K, LOCAL or more) of the residuals, and the cosines (K,) of the incidence."""
    width, frames = LOCAL + len(survey.tail) - TAIL, returns.frames
    rows = np.empty((len(frames), width))
    normals = np.einsum("kij,kj->ki", placed.bodies[frames], match.normals)  # In N.
    basis = survey.path.basis(returns.times).values[frames]
    spline = 3 * (DEGREE + 1)
    rows[:, :spline] = (basis[:, :, None] * normals[:, None]).reshape(len(rows), spline)
    lever = returns.ranges[:, None] * np.cross(placed.along, normals)
    turn = np.einsum("kji,kj->ki", placed.attitudes[frames], lever)
    times = survey.turn_times
    node = _nodes(survey, returns)
    share = ((returns.times - times[node]) / (times[node + 1] - times[node]))[frames, None]
    rows[:, spline : spline + 3] = (1.0 - share) * turn
    rows[:, spline + 3 : spline + 6] = share * turn
    tail = rows[:, spline + 6 :]
    tail[:, MOUNTING] = turn
    body = -np.cross(placed.inertial, normals)
    if survey.tumbling is None:
        tail[:, POLE] = body[:, :2]
        tail[:, RATE] = ((returns.times - survey.epoch)[frames] * (body @ survey.axis))[:, None]
    else:
        turning = np.einsum("ki,kpi->kp", body, survey.turning(returns.times)[frames])
        tail[:, ROTATION], tail[:, INERTIA] = turning[:, :3], turning[:, 3:]
    slant = np.einsum("ki,ki->k", placed.along, normals)
    tail[:, BIAS] = -slant[:, None]
    tail[:, SCALE] = -(slant * returns.ranges)[:, None]
    incidences = np.minimum(np.abs(slant), 1.0)
    # The map as a whole may move and stretch, by vectors that are linear in the place. Heights
    # along the normals of a coarse mesh can't do that, but for a part.
    size = np.ptp(survey.vertices, axis=0).max()
    places = np.concatenate([np.ones((len(rows), 1)), placed.points / size], axis=1)
    tail[:, AFFINE] = -(places[:, :, None] * match.normals[:, None]).reshape(-1, 12)
    tail[:, BEAM] = -(returns.ranges * np.sqrt(1.0 - incidences**2))[:, None]
    return rows, incidences


def add_motion(survey: Survey, expected: Expected, matrix: np.ndarray, right: np.ndarray) -> None:
    """Adds the equation of motion at the path's places, and what each burn is wrong by.

    What the commanded thrust does is in `Survey.moved`; it may be wrong by a share. Each burn is
    short, so what it is wrong by is a jump of the velocity.
    """
    path, size = survey.path, 3 * survey.path.size
    rows, residuals = motion_rows(survey, len(right))
    sigma = expected.varying * np.sqrt(2.0 * expected.varying_time / path.steps)
    # Each row has a few of the path's unknowns, and the tail's.
    some = sp.csr_array(rows.reshape(-1, len(right)) / np.repeat(sigma, 3)[:, None])
    matrix += (some.T @ some).toarray()
    right += some.T @ (residuals / sigma[:, None]).ravel()
    jumps = path.jumps / (expected.thrust * survey.kicks)[:, None]
    for i in range(3):
        axis = np.arange(i, size, 3)
        matrix[np.ix_(axis, axis)] += jumps.T @ jumps
        right[axis] += jumps.T @ (jumps @ survey.coefficients[:, i])


def motion_rows(survey: Survey, count: int) -> tuple[np.ndarray, Vectors3]:
    """The equation of motion, p'' = gravity + constant, at the P places of the path.

    How B turns, if it is steadily, is left to the returns: they know it far better.

    Args:
      survey: as it is now. count: of the global unknowns, G.

    Returns:
      Derivatives (P, 3, G) of the residuals, and the residuals (P, 3) in m/s^2 in N.
    """
    path, times = survey.path, survey.path.places
    bodies = survey.body_attitudes(times)
    positions = survey.positions(times)
    inside = np.einsum("tji,tj->ti", bodies, positions)
    pull, gradient = MassPoints.of(survey.vertices, survey.facets).pull(inside)
    gm = survey.gm
    pull = np.einsum("tij,tj->ti", bodies, pull)
    gradient = gm * np.einsum("tij,tjk,tlk->til", bodies, gradient, bodies)
    constant = np.einsum("tij,j->ti", bodies, survey.tail[ACCELERATION])
    second = path.matrix(times, 2)
    residuals = second @ survey.coefficients - gm * pull - constant
    if survey.moons:
        residuals -= tides(survey.moons, times, positions)
    size, value = 3 * path.size, path.matrix(times)
    rows = np.zeros((len(times), 3, count))
    for i in range(3):
        rows[:, i, i:size:3] = second
        for j in range(3):
            rows[:, i, j:size:3] -= gradient[:, i, j, None] * value
    tail = rows[:, :, count - len(survey.tail) :]
    tail[:, :, GRAVITY] = -pull[:, :, None]
    tail[:, :, ACCELERATION] = -bodies
    if survey.tumbling is not None:
        # B turns beneath the spacecraft, and what pulls in B turns with it.
        turning, along = survey.turning(times), (gm * pull + constant)[:, None]
        moved = np.einsum("tij,tkj->tik", gradient, np.cross(turning, positions[:, None]))
        moved -= np.cross(turning, along).transpose(0, 2, 1)
        tail[:, :, ROTATION], tail[:, :, INERTIA] = moved[:, :, :3], moved[:, :, 3:]
    return rows, residuals


def _add_priors(
    survey: Survey, prior: Survey, expected: Expected, weighting: Weighting, matrix: np.ndarray,
    right: np.ndarray,
) -> None:  # fmt: skip
    """Adds what was known before: of the tail, and of how the attitude's error varies."""
    size, count = 3 * survey.path.size, len(right)
    hold = 1e-3 if weighting.hold else 1.0
    rate, gm = abs(prior.rate), prior.gm
    sigma = np.r_[
        np.full(3, hold * expected.mounting), np.full(2, hold * expected.pole),
        hold * expected.rate * rate, expected.bias, expected.scale, expected.beam,
        np.full(12, weighting.slide), np.full(len(prior.tail) - TAIL, hold * _UNEVEN),
        expected.gravity * gm, np.full(3, expected.acceleration),
    ]  # fmt: skip
    least = np.r_[np.ones(5), rate, 1e3, np.ones(len(prior.tail) - 11), gm, np.ones(3)]
    sigma = np.maximum(sigma, 1e-12 * least)
    tail = np.arange(count - len(prior.tail), count)
    if survey.tumbling is not None:
        # What it is wrong by at the start has spread over all axes at the epoch.
        sigma[ROTATION] = hold * expected.pole * rate
    matrix[tail, tail] += sigma**-2.0
    right[tail] += (survey.tail - prior.tail) / sigma**2
    held = np.exp(-np.diff(survey.turn_times) / expected.turning_time)
    turning = hold * max(expected.turning, 1e-9)
    nodes = len(survey.turn_times)
    # x_k+1 - held x_k has the variance (1 - held^2) turning^2.
    chain = np.eye(nodes)
    chain[np.arange(1, nodes), np.arange(nodes - 1)] = -held
    chain[1:] /= np.sqrt(1.0 - held**2)[:, None]
    own = chain.T @ chain / turning**2
    for i in range(3):
        index = size + i + 3 * np.arange(nodes)
        matrix[np.ix_(index, index)] += own
        right[index] += own @ survey.turns[:, i]


def _smoothness(
    survey: Survey, outward: Vectors3, roughness: float, seen: Values
) -> tuple[sp.csc_array, np.ndarray]:
    """The normal matrix (V, V) and right side (V,) of a smooth surface."""
    size, facets = len(survey.vertices), survey.facets
    first, second = facets.ravel(), np.roll(facets, -1, axis=1).ravel()
    links = sp.csr_array((np.ones(first.size), (first, second)), shape=(size, size))
    links = links + links.T
    links.data[:] = 1.0
    degree = np.asarray(links.sum(axis=1)).ravel()
    laplacian = sp.eye_array(size) - sp.diags_array(1.0 / degree) @ links
    edges = np.linalg.norm(survey.vertices[first] - survey.vertices[second], axis=1)
    lengths = np.bincount(first, edges, size) / np.bincount(first, minlength=size)
    weighed = sp.diags_array(1.0 / (roughness * lengths)) @ laplacian
    bent = np.einsum("vi,vi->v", laplacian @ survey.vertices, outward)
    own = weighed.T @ weighed + sp.diags_array(np.maximum((_STEP * lengths) ** -2.0 - seen, 0.0))
    return own.tocsc(), weighed.T @ (bent / (roughness * lengths))


def _stepped(survey: Survey, step: Values, risen: Values, outward: Vectors3) -> Survey:
    """The survey after a step of its global unknowns (G,) and of the heights (V,)."""
    size, count = survey.coefficients.size, len(step)
    shared = count - len(survey.tail)
    turns = survey.turns + step[size:shared].reshape(-1, 3)
    tail = survey.tail + step[shared:]
    moved = tail[AFFINE].reshape(4, 3).copy()
    tail[AFFINE] = 0.0
    vertices = survey.vertices + risen[:, None] * outward
    extent = np.ptp(survey.vertices, axis=0).max()
    vertices = vertices + moved[0] + (survey.vertices / extent) @ moved[1:]
    return dc.replace(
        survey,
        coefficients=survey.coefficients + step[:size].reshape(-1, 3),
        turns=turns,
        tail=tail,
        vertices=vertices,
    )
