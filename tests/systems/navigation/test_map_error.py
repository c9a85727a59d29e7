"""The smooth displacements of a map, against surfaces that `displaced` draws."""

import functools
import os
import subprocess
import sys

import numpy as np
import pytest
import trimesh
from pages import ROOT
from short_flights import kleopatra

from proxops.systems import Polyhedron
from proxops.systems.navigation.map_error import MapError
from proxops.systems.shapes import displaced, vertex_normals

STD, CORRELATION = 107.0, 15e3


@functools.cache
def map_error() -> MapError:
    return MapError(kleopatra().shape, STD, CORRELATION)


@functools.cache
def heights(seed: int) -> np.ndarray:
    """Of the surface of a seed over the map (V,), along the normals."""
    shape = kleopatra().shape
    normals, _ = vertex_normals(shape)
    moved = displaced(shape, STD, CORRELATION, seed).vertices - shape.vertices
    return np.einsum("vi,vi->v", moved, normals)


def rms(values: np.ndarray) -> float:
    """Over the surface."""
    _, weights = vertex_normals(kleopatra().shape)
    return float(np.sqrt(weights @ values**2 / weights.sum()))


@pytest.mark.parametrize("seed", [1, 2])
def test_drawn_surfaces_are_reproduced(seed: int) -> None:
    """But for what the functions leave out: 1.5 % of the variance."""
    drawn, errors = heights(seed), map_error()
    _, weights = vertex_normals(kleopatra().shape)
    root = np.sqrt(weights)[:, None]
    fit, *_ = np.linalg.lstsq(root * errors.table, root[:, 0] * drawn)
    assert rms(drawn) == pytest.approx(STD, rel=0.01)
    assert rms(drawn - errors.table @ fit) < 0.15 * STD


@pytest.mark.slow
def test_coefficients_have_variance_one() -> None:
    """Chi square of those that are told well apart; their sizes are independent."""
    errors = map_error()
    _, weights = vertex_normals(kleopatra().shape)
    root = np.sqrt(weights)[:, None]
    inverse = np.linalg.pinv(root * errors.table)
    fits = np.array([inverse @ (root[:, 0] * heights(seed)) for seed in range(40)])
    half = fits[:, : errors.modes // 2]
    # `displaced` scales each surface to the rms; by chance, a field's own varies.
    assert np.mean(half**2) == pytest.approx(1.0, abs=0.15)
    correlations = np.corrcoef(half.T) - np.eye(half.shape[1])
    assert np.sqrt(np.mean(correlations**2)) < 1.3 / np.sqrt(40)


def test_variance_over_the_surface() -> None:
    """That of the field, less the rigid motions and what is left out."""
    errors = map_error()
    _, weights = vertex_normals(kleopatra().shape)
    variance = weights @ (errors.table**2).sum(axis=1) / weights.sum()
    assert 0.8 * STD**2 < variance < STD**2
    # Nowhere is the surface known much better or worse than it was told.
    sigma = np.sqrt((errors.table**2).sum(axis=1))
    assert sigma.max() < 1.05 * STD
    assert np.percentile(sigma, 5) > 0.7 * STD


def test_what_is_left_out_counts_ten_times() -> None:
    """For it is the same whenever a place is seen again."""
    errors, left = map_error(), []
    root = np.sqrt(vertex_normals(kleopatra().shape)[1])[:, None]
    for seed in range(1, 5):
        drawn = heights(seed)
        fit, *_ = np.linalg.lstsq(root * errors.table, root[:, 0] * drawn)
        rest = root[:, 0] * (drawn - errors.table @ fit)
        left.append(rest @ rest / (root**2).sum())
    assert 0.0 < errors.rest < STD**2
    assert errors.rest == pytest.approx(10.0 * np.mean(left), rel=0.6)


def test_rigid_motions_are_not_in_the_span() -> None:
    """A map is registered: its frame is that of the best fit."""
    shape, errors = kleopatra().shape, map_error()
    normals, weights = vertex_normals(shape)
    arms = (shape.vertices - shape.centre_of_mass) / shape.extents.max()
    rigid = np.hstack([normals, np.cross(arms, normals)])
    rigid /= np.sqrt(weights @ rigid**2 / weights.sum())
    along = (weights[:, None] * errors.table).T @ rigid / weights.sum()
    assert (np.linalg.norm(along, axis=0) < 0.03 * STD).all()


def test_neighbours_are_alike_as_told() -> None:
    """The covariance of two places, by their distance, far from what registration takes."""
    shape, errors = kleopatra().shape, map_error()
    one = errors.table[::20] / np.linalg.norm(errors.table[::20], axis=1, keepdims=True)
    away = np.linalg.norm(shape.vertices[::20, None] - shape.vertices[None, ::20], axis=-1)
    alike = one @ one.T
    for low, high in ((0.4, 0.6), (0.9, 1.1), (1.4, 1.6), (3.0, 4.0)):
        band = (away > low * CORRELATION) & (away < high * CORRELATION)
        told = np.exp(-((away[band] / CORRELATION) ** 2) / 2.0)
        assert alike[band].mean() == pytest.approx(told.mean(), abs=0.12)


def test_a_map_without_error_has_no_modes() -> None:
    errors = MapError(kleopatra().shape)
    assert (errors.modes, errors.rest, errors.std) == (0, 0.0, 0.0)
    assert errors.table.shape == (len(kleopatra().shape.vertices), 0)


@pytest.mark.slow
def test_a_large_mesh_is_interpolated() -> None:
    """The functions of a fine mesh are those of the same body with fewer facets."""
    coarse, fine = (ellipsoid(subdivisions) for subdivisions in (3, 5))
    assert len(coarse.vertices) < 1200 < len(fine.vertices)
    low, high = MapError(coarse, 10.0, 40e3), MapError(fine, 10.0, 40e3)
    # The first vertices of a finer sphere are those of the coarser one.
    np.testing.assert_allclose(fine.vertices[: len(coarse.vertices)], coarse.vertices, atol=1e-6)
    same = high.table[: len(coarse.vertices)]
    ours, theirs = low.table @ low.table.T, same @ same.T
    assert np.sqrt(np.mean((ours - theirs) ** 2)) < 0.06 * 10.0**2


def ellipsoid(subdivisions: int) -> Polyhedron:
    ball = trimesh.creation.icosphere(subdivisions)
    return Polyhedron(ball.vertices * [110e3, 60e3, 45e3], ball.faces)


@pytest.mark.slow
def test_does_not_depend_on_the_number_of_threads() -> None:
    """Nor do drawn surfaces: a seed gives the same flight bit for bit."""
    code = (
        "import hashlib; from short_flights import kleopatra\n"
        "from proxops.systems.navigation.map_error import MapError, shift_of_centre\n"
        f"table = MapError(kleopatra().shape, {STD}, {CORRELATION}).table\n"
        f"shift = shift_of_centre(kleopatra().shape, {STD}, {CORRELATION})\n"
        "from proxops.systems.shapes import displaced\n"
        "surfaces = [displaced(kleopatra().shape, 400.0, 15e3, k).vertices for k in range(4)]\n"
        "hashes = [hashlib.sha256(each.tobytes()).hexdigest() for each in (table, *surfaces)]\n"
        "print(hashes, repr(shift))"
    )
    found = set()
    for threads in ("1", "2"):
        names = dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"), threads)
        found.add(
            subprocess.run(
                [sys.executable, "-c", code],
                env=os.environ | names | {"PYTHONPATH": str(ROOT / "tests" / "helpers")},
                capture_output=True,
                text=True,
                check=True,
            ).stdout
        )
    assert len(found) == 1
