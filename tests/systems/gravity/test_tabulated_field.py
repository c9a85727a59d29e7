"""The gravity table against the field that it was made from, and the laws that it must obey.

Eq. 31 of docs/method/equations.md.
"""

import functools
import tempfile

import numpy as np
import pytest
import trimesh
from jacobi import jacobi_integral
from plain_motion import acceleration
from scipy.integrate import solve_ivp
from short_flights import kleopatra

from proxops.systems.common.errors import InputError
from proxops.systems.gravity import GravityField, TabulatedField, tabulated_field
from proxops.systems.shapes.polyhedron import Polyhedron

AXES = np.array([1700.0, 1200.0, 1100.0])
ERROR = 1e-5


@functools.cache
def exact(contrast: float) -> GravityField:
    ball = trimesh.creation.icosphere(subdivisions=1)
    shape = Polyhedron(ball.vertices * [1000.0, 600.0, 500.0], ball.faces, "a low ball")
    return GravityField(shape, density=2000.0, contrast=contrast)


@pytest.fixture(autouse=True)
def cache_folder(tmp_path_factory, monkeypatch):
    folder = tmp_path_factory.getbasetemp() / "gravity_tables"
    monkeypatch.setenv("XDG_CACHE_HOME", str(folder))
    return folder / "proxops" / "gravity"


def table(contrast: float = 0.0) -> TabulatedField:
    return TabulatedField(exact(contrast), AXES, ERROR)


def outside(count: int, axes: np.ndarray = AXES, farthest: float = 3.0) -> np.ndarray:
    """Points (N, 3) from just above the ellipsoid to 10^farthest times as far."""
    random = np.random.default_rng(8)
    points = random.normal(size=(count, 3))
    level = 1.0 + np.where(
        random.random(count) < 0.5, 10.0 ** random.uniform(-9.0, -1.0, count),
        10.0 ** random.uniform(-1.0, farthest, count),
    )  # fmt: skip
    return points / np.linalg.norm(points / axes, axis=1)[:, None] * level[:, None]


def errors(found: TabulatedField, points: np.ndarray) -> tuple[float, float]:
    """Greatest relative errors of potential and acceleration."""
    have, want = found.evaluate(points), found.exact.evaluate(points)
    apart = np.linalg.norm(have.acceleration - want.acceleration, axis=1)
    return (
        float(np.abs(have.potential / want.potential - 1.0).max()),
        float((apart / np.linalg.norm(want.acceleration, axis=1)).max()),
    )


@pytest.mark.parametrize("contrast", [0.0, 0.3])
def test_the_error_is_below_the_bound_everywhere_outside(contrast):
    found, points = table(contrast), outside(20_000)
    assert np.all(np.linalg.norm(points / AXES, axis=1) >= 1.0)
    assert max(errors(found, points)) < ERROR
    assert not found.evaluate(points).inside.any()
    assert found.mass == exact(contrast).mass
    np.testing.assert_array_equal(found.centre_of_mass, exact(contrast).centre_of_mass)


@pytest.mark.parametrize("span", [1.0, 100.0])
def test_acceleration_and_gradient_are_derivatives_of_the_potential(span):
    found, points = table(), 1.001 * span * outside(300, farthest=0.5)
    step = 1e-3 * span * np.eye(3)
    here = found.evaluate(points)
    low = [found.evaluate(points - arm) for arm in step]
    high = [found.evaluate(points + arm) for arm in step]
    slope = np.stack([(b.potential - a.potential) / (2e-3 * span)
                      for a, b in zip(low, high, strict=True)], axis=1)  # fmt: skip
    bend = np.stack([(b.acceleration - a.acceleration) / (2e-3 * span)
                     for a, b in zip(low, high, strict=True)], axis=1)  # fmt: skip
    size = np.linalg.norm(here.acceleration, axis=1)
    # A step across the wall of a box finds the two boxes' difference; few do.
    off = np.linalg.norm(slope - here.acceleration, axis=1) / size
    assert np.quantile(off, 0.9) < 1e-7
    large = np.linalg.norm(here.gradient, axis=(1, 2))
    assert np.quantile(np.linalg.norm(bend - here.gradient, axis=(1, 2)) / large, 0.9) < 1e-6
    assert np.abs(np.trace(here.gradient, axis1=1, axis2=2) / large).max() < 1e-12
    np.testing.assert_array_equal(here.gradient, here.gradient.transpose(0, 2, 1))


def test_within_the_ellipsoid_it_is_the_exact_field():
    random = np.random.default_rng(4)
    points = random.uniform(-1.0, 1.0, (2000, 3))
    points = points[np.linalg.norm(points, axis=1) < 1.0] * AXES
    have, want = table().evaluate(points), exact(0.0).evaluate(points)
    assert want.inside.any()
    assert not want.inside.all()
    for some, all_ in zip(have, want, strict=True):
        np.testing.assert_array_equal(some, all_)
    mixed = table().evaluate(np.concatenate([points, outside(50)]))
    np.testing.assert_array_equal(mixed.acceleration[: len(points)], want.acceleration)


def test_a_body_far_smaller_than_the_ellipsoid_is_point_masses_everywhere_outside():
    axes = 20.0 * AXES
    found = TabulatedField(exact(0.3), axes, ERROR)
    assert max(errors(found, outside(500, axes))) < 1e-9


def test_a_free_orbit_keeps_its_energy():
    found = table()
    spin = 3e-4

    def rates(_, state):
        return np.concatenate([state[3:], acceleration(found, spin, state[:3], state[3:])])

    start = np.array([2500.0, 300.0, 200.0, 0.0, 0.0, 0.25])
    path = solve_ivp(rates, (0.0, 20_000.0), start, rtol=1e-9, atol=1e-9).y.T
    assert np.linalg.norm(path[:, :3] / AXES, axis=1).min() > 1.0
    potential = found.evaluate(path[:, :3]).potential
    jacobi = jacobi_integral(path[:, :3], path[:, 3:], potential, spin)
    assert np.ptp(jacobi) < 10.0 * ERROR * potential.max()


def test_it_is_made_once_and_a_damaged_file_is_made_again(cache_folder, monkeypatch, caplog):
    made = []
    make = tabulated_field.make_boxes
    monkeypatch.setattr(
        tabulated_field, "make_boxes", lambda *args: made.append(args) or make(*args)
    )

    def again() -> np.ndarray:
        tabulated_field._boxes.cache_clear()
        field = TabulatedField(exact(0.0), 2.0 * AXES, 1e-2)
        return field.evaluate(outside(30, 2.0 * AXES)).acceleration

    before = set(cache_folder.glob("*"))
    assert not TabulatedField.is_kept(exact(0.0), 2.0 * AXES, 1e-2)
    first = again()
    assert len(made) == 1
    assert TabulatedField.is_kept(exact(0.0), 2.0 * AXES, 1e-2)
    assert not TabulatedField.is_kept(exact(0.0), 2.0 * AXES, 2e-3)
    assert "making the gravity table of a low ball" in caplog.text
    caplog.clear()
    np.testing.assert_array_equal(again(), first)
    assert len(made) == 1
    assert not caplog.text
    (path,) = set(cache_folder.glob("*")) - before
    whole = path.read_bytes()
    for damaged in (whole[:-100], whole[:2000] + b"xxxx" + whole[2004:], b""):
        path.write_bytes(damaged)
        assert not TabulatedField.is_kept(exact(0.0), 2.0 * AXES, 1e-2)
        np.testing.assert_array_equal(again(), first)
        assert path.read_bytes() == whole
    with np.load(path) as file:
        arrays = dict(file)
    arrays["children"][0, 0] = 1_000_000
    np.savez(path, **arrays)
    np.testing.assert_array_equal(again(), first)
    assert len(made) == 5


def test_without_a_cache_folder_it_works_and_says_so(monkeypatch, tmp_path, caplog):
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "file"))
    tabulated_field._boxes.cache_clear()
    TabulatedField(exact(0.0), 2.0 * AXES, 1e-2)
    assert "the gravity table is not kept" in caplog.text


@pytest.mark.parametrize(
    ("axes", "error", "words"),
    [
        ([900.0, 1200.0, 1100.0], 1e-6, "sticks out of the ellipsoid"),
        ([1700.0, 1200.0], 1e-6, "three semi-axes"),
        ([1700.0, 1200.0, np.nan], 1e-6, "needs z above 0"),
        (AXES, 1e-13, "relative_error must be from 1e-11 to 0.01"),
    ],
)
def test_bad_input_is_refused(axes, error, words):
    with pytest.raises(InputError, match=words):
        TabulatedField(exact(0.0), axes, error)


def test_a_body_close_to_the_ellipsoid_is_exact_where_no_box_is_small_enough(monkeypatch):
    monkeypatch.setattr("proxops.systems.gravity._harmonic_boxes._DEEPEST", 6)
    tabulated_field._boxes.cache_clear()
    axes = 1.0001 * np.array([1000.0, 600.0, 500.0])
    found = TabulatedField(exact(0.0), axes, 1e-3)
    # Some points outside are in no box.
    points = outside(2000, axes)
    assert tabulated_field.kernel.evaluate(points, found.tables, np.empty((len(points), 14))) > 0
    assert max(errors(found, outside(2000, axes))) < 1e-3


@pytest.mark.slow
def test_kleopatras_table_keeps_its_bound_and_its_size():
    body = kleopatra()
    found = TabulatedField(body.exact_field, body.keep_out_semi_axes)
    assert max(errors(found, outside(40_000, body.keep_out_semi_axes))) < 1e-9
    assert sum(part.nbytes for part in found.tables if isinstance(part, np.ndarray)) < 64e6
    # No cell outside is left without a box.
    points = outside(40_000, body.keep_out_semi_axes, farthest=0.5)
    columns = np.empty((len(points), 14))
    assert tabulated_field.kernel.evaluate(points, found.tables, columns) == 0
