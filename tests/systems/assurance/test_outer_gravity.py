"""What runtime assurance takes for gravity, against the polyhedron that it stands for."""

import numpy as np
import pytest
from braking_ball import ball_field
from short_flights import kleopatra

from proxops.systems import BackupBraking, FlightLimits, GravityField, Polyhedron
from proxops.systems.assurance._braking_kernel import gravity_outside
from proxops.systems.assurance.outer_gravity import OuterGravity, outer_gravity


def directions(count: int) -> np.ndarray:
    drawn = np.random.default_rng(7).normal(size=(count, 3))
    return drawn / np.linalg.norm(drawn, axis=1)[:, None]


@pytest.fixture(scope="module")
def gravity() -> OuterGravity:
    return outer_gravity(kleopatra().exact_field, kleopatra().keep_out_semi_axes)


def pulls(gravity: OuterGravity, points: np.ndarray) -> np.ndarray:
    found = np.empty((len(points), 3))
    for (x, y, z), row in zip(points, found, strict=True):
        assert gravity_outside(x, y, z, gravity.tables, row)
    return found


def test_its_bounds_hold_between_its_samples(gravity: OuterGravity) -> None:
    level = 1.0 + np.random.default_rng(2).exponential(0.3, (3000, 1))
    level[2000:] = 10.0 ** np.random.default_rng(3).uniform(0.0, 3.0, (1000, 1))
    points = level * directions(3000) * kleopatra().keep_out_semi_axes
    true = kleopatra().exact_field.evaluate(points)
    error = np.linalg.norm(pulls(gravity, points) - true.acceleration, axis=1)
    assert 0.0 < error.max() <= gravity.error
    size = np.linalg.norm(true.acceleration, axis=1).max()
    assert 0.8 * gravity.strongest < size <= gravity.strongest
    steep = level[:, 0] ** 3 * np.linalg.norm(true.gradient, ord=2, axis=(1, 2))
    assert 0.3 * gravity.steepness < steep.max() <= gravity.steepness
    along = np.abs(true.acceleration).max(axis=0)
    assert (along <= 1.01 * gravity.greatest).all()
    assert (along >= 0.8 * gravity.greatest).all()


def test_steepest_of_a_point_mass_is_far_above_its_flat_side() -> None:
    """There the bound's fall, as the cube of the level, is that of the field itself."""
    field, axes = ball_field(1e15, 2500.0), np.array([8e3, 6e3, 3e3])
    mu = 6.6743e-11 * field.mass
    expected = 1.05 * 2.0 * mu / 3e3**3
    assert outer_gravity(field, axes).steepness == pytest.approx(expected, rel=2e-3)


def test_in_the_ellipsoid_it_is_that_of_the_surface_above(gravity: OuterGravity) -> None:
    """Paths that fail are followed there."""
    for place in directions(20) * kleopatra().keep_out_semi_axes:
        just_out, just_in, deep = pulls(gravity, np.outer([1.0 + 1e-9, 1.0 - 1e-9, 0.3], place))
        assert np.abs(just_out - just_in).max() < 1e-8
        assert np.abs(deep - just_in).max() < 1e-8
    row = np.ones(3)
    assert not gravity_outside(0.0, 0.0, 0.0, gravity.tables, row)
    assert not row.any()


def test_no_state_is_admitted_where_the_table_has_no_gravity(monkeypatch) -> None:
    """A body that touches the ellipsoid leaves cells that no box is small enough for."""
    monkeypatch.setattr("proxops.systems.gravity._harmonic_boxes._DEEPEST", 9)
    ball = ball_field(1e17, 30e3).shape
    shape = Polyhedron(ball.vertices * [1.0, 0.7, 0.7], ball.facets, "an egg")
    limits = FlightLimits(100.0, 7.0, 40.0, np.array([30.01e3, 26e3, 26e3]))
    backup = BackupBraking(GravityField(shape, mass=1e17), 0.0, limits)
    margins = [
        backup.backup_margin(np.array([*place, 0.0, 0.0, 0.0]))
        for place in ([30.1e3, 0.0, 0.0], [0.0, 26.2e3, 0.0], [32e3, 0.0, 0.0])
    ]
    assert margins[0] == -np.inf
    assert min(margins[1:]) > 0.0
