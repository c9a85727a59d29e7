"""The table against the polyhedron, and against a field that it must have exactly."""

from pathlib import Path

import numpy as np
import pytest
import trimesh
from short_flights import kleopatra

from proxops.diagrams.scenario.body import load_body
from proxops.systems import GravityField, PointMassField, Polyhedron
from proxops.systems.assurance import gravity_table as gravity_table_module
from proxops.systems.assurance.gravity_table import GravityTable, gravity_table


def directions(count: int) -> np.ndarray:
    drawn = np.random.default_rng(7).normal(size=(count, 3))
    return drawn / np.linalg.norm(drawn, axis=1)[:, None]


@pytest.fixture(scope="module")
def table() -> GravityTable:
    return gravity_table(kleopatra().gravity_field, kleopatra().keep_out_semi_axes)


@pytest.mark.parametrize(
    ("level", "greatest", "mean"),
    [
        (1.0, 5e-5, 5e-6),
        (1.1, 3e-5, 5e-6),
        (2.0, 3e-5, 1e-5),
        (10.0, 3e-5, 1e-5),
        (1e3, 1e-7, 1e-8),
    ],
)
def test_within_its_stated_error_of_the_polyhedron(
    table: GravityTable, level: float, greatest: float, mean: float
) -> None:
    points = level * directions(400) * kleopatra().keep_out_semi_axes
    error = table.acceleration(points) - kleopatra().gravity_field.evaluate(points).acceleration
    sizes = np.linalg.norm(error, axis=1)
    assert sizes.max() < greatest
    assert np.sqrt(np.mean(sizes**2)) < mean


def test_continuous_where_it_ends(table: GravityTable) -> None:
    """Below its lowest level it goes on: paths that fail are followed there."""
    for direction in directions(20) * kleopatra().keep_out_semi_axes:
        above, below = table.acceleration(direction * np.array([[0.9500001], [0.9499999]]))
        assert np.abs(above - below).max() < 1e-7
    assert not table.acceleration(np.array([[0.0, 0.0, 0.0], [1e200, 0.0, 0.0]])).any()


def test_a_point_mass_is_exact() -> None:
    field = PointMassField(1e15)
    points = 1.3 * directions(50) * [4e3, 3e3, 2e3]
    found = gravity_table(field, np.array([4e3, 3e3, 2e3])).acceleration(points)
    assert found == pytest.approx(field.evaluate(points).acceleration, rel=1e-12)


def test_made_once_for_the_same_field(table: GravityTable) -> None:
    axes = kleopatra().keep_out_semi_axes
    assert gravity_table(load_body("kleopatra").gravity_field, axes) is table
    one, other = PointMassField(1e15), PointMassField(2e15)
    first = gravity_table(one, axes)
    assert gravity_table(one, axes) is first
    assert gravity_table(other, axes) is not first
    assert gravity_table(one, 2.0 * axes) is not first


def test_what_it_says_of_itself_holds_between_its_samples(table: GravityTable) -> None:
    level = 1.0 + np.random.default_rng(2).exponential(0.3, (3000, 1))
    points = level * directions(3000) * kleopatra().keep_out_semi_axes
    true = kleopatra().gravity_field.evaluate(points)
    error = np.linalg.norm(table.acceleration(points) - true.acceleration, axis=1).max()
    assert 0.3 * table.error < error <= table.error
    size = np.linalg.norm(true.acceleration, axis=1).max()
    assert 0.8 * table.strongest < size <= table.strongest
    steep = level[:, 0] ** 3 * np.linalg.norm(true.gradient, ord=2, axis=(1, 2))
    assert 0.3 * table.steepness < steep.max() <= table.steepness


def test_greatest_bounds_the_field_outside(table: GravityTable) -> None:
    levels = np.random.default_rng(1).uniform(1.0, 3.0, (2000, 1))
    points = levels * directions(2000) * kleopatra().keep_out_semi_axes
    found = np.abs(kleopatra().gravity_field.evaluate(points).acceleration).max(axis=0)
    assert (found <= 1.01 * table.greatest).all()
    assert (found >= 0.8 * table.greatest).all()


@pytest.fixture
def low_ball() -> GravityField:
    ball = trimesh.creation.icosphere(subdivisions=1)
    shape = Polyhedron(ball.vertices * [1000.0, 600.0, 500.0], ball.faces, "a low ball")
    return GravityField(shape, density=2000.0)


def test_kept_on_disk_for_the_next_process(
    low_ball: GravityField, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setenv("LOCALAPPDATA", str(tmp_path))
    axes = np.array([1400.0, 900.0, 800.0])
    made = []
    make = gravity_table_module._made
    monkeypatch.setattr(
        gravity_table_module, "_made", lambda *given: made.append(given) or make(*given)
    )

    def again(axes: np.ndarray = axes) -> GravityTable:
        gravity_table_module._table.cache_clear()
        return gravity_table(low_ball, axes)

    first = again()
    (file,) = (tmp_path / "proxops" / "assurance").iterdir()
    whole = file.read_bytes()
    for name, value in vars(again()).items():
        np.testing.assert_array_equal(value, getattr(first, name))
    assert len(made) == 1
    # Of another ellipsoid; then with a file that is damaged, and with arrays of another form.
    again(1.1 * axes)
    assert len(made) == 2
    file.write_bytes(whole[: len(whole) // 2])
    np.testing.assert_array_equal(again().nodes, first.nodes)
    assert len(made) == 3
    assert file.read_bytes() == whole
    with np.load(file) as stored:
        arrays = dict(stored)

    def write(**other: np.ndarray) -> None:
        np.savez(file, allow_pickle=False, **(arrays | other))

    write(nodes=arrays["nodes"][1:])
    np.testing.assert_array_equal(again().nodes, first.nodes)
    assert len(made) == 4
    write(error=np.array(np.nan))
    assert again().error == first.error
    assert len(made) == 5
