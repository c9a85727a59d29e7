"""The map with what a flight taught of it: made, kept in files, and flown with again."""

from pathlib import Path

import numpy as np
import pytest
from navigated_flight import PERIOD, flight, frame, navigation
from short_flights import BRIEF, PdController, kleopatra, short_scenario

from proxops.diagrams.flight import fly, make_navigation, mended_map_of_flight
from proxops.diagrams.scenario import (
    Body,
    LidarNavigationConfig,
    Scenario,
    filter_tuning,
    load_scenario,
)
from proxops.systems import (
    InputError,
    LidarFrames,
    LidarNavigation,
    MapError,
    MendedMap,
    Polyhedron,
)
from proxops.systems.navigation import (
    Estimate,
    ExpectedErrors,
    load_map,
    save_mended_map,
    shift_of_centre,
)
from proxops.systems.navigation.estimate import BASE, SIZE
from proxops.systems.navigation.mended_map import mended_map
from proxops.systems.shapes import displaced, mesh_bytes, vertex_normals

RMS, CORRELATION = 110.0, 15e3


def octahedron() -> Polyhedron:
    vertices = 1000.0 * np.vstack([np.eye(3), -np.eye(3)])
    facets = [
        [0, 1, 2],
        [1, 3, 2],
        [3, 4, 2],
        [4, 0, 2],
        [1, 0, 5],
        [3, 1, 5],
        [4, 3, 5],
        [0, 4, 5],
    ]
    return Polyhedron(vertices, np.array(facets))


def known(rest: float = 0.0) -> tuple[Polyhedron, MapError, Estimate]:
    """An octahedron with two errors: of the vertex at +x, and of those at +y and -y."""
    shape = octahedron()
    table = np.zeros((6, 2))
    table[0, 0], table[[1, 4], 1] = 30.0, 20.0
    mean, covariance = np.zeros(BASE + 2), np.zeros((BASE + 2, BASE + 2))
    mean[SIZE], mean[BASE:] = 0.01, [2.0, -1.0]
    chosen = np.ix_([SIZE, BASE, BASE + 1], [SIZE, BASE, BASE + 1])
    covariance[chosen] = [[1e-4, 1e-3, 0.0], [1e-3, 0.25, 0.1], [0.0, 0.1, 0.16]]
    return shape, MapError.known(table, rest), Estimate(mean, np.eye(3), covariance)


def test_vertices_move_along_their_normals() -> None:
    """Of an octahedron these point along the axes. 0.75 and 0.84 of the variance are explained."""
    moved = mended_map(*known()).shape.vertices
    lengths = [1055.0, 993.2, 1010.0, 1010.0, 993.2, 1010.0]
    np.testing.assert_allclose(np.abs(moved).max(axis=1), lengths)


def test_what_is_left_is_what_the_covariance_says() -> None:
    """Its closed form for each pair of vertices; 0.09 is added to the coefficients' variances."""
    left = mended_map(*known()).error
    heights = np.zeros((6, 3))
    heights[:, 0], heights[0, 1], heights[[1, 4], 2] = 1000.0, 30.0, 20.0
    covariance = np.array([[1e-4, 1e-3, 0.0], [1e-3, 0.34, 0.1], [0.0, 0.1, 0.25]])
    np.testing.assert_allclose(
        left.table @ left.table.T, heights @ covariance @ heights.T, atol=1e-3
    )
    np.testing.assert_allclose(
        left.deviations**2, np.einsum("vi,ij,vj->v", heights, covariance, heights), atol=1e-3
    )
    assert left.std == pytest.approx(np.sqrt(np.mean(left.deviations**2)))
    finer = mended_map(*known(rest=500.0)).error
    assert finer.rest == 500.0
    assert (finer.deviations > left.deviations).all()


# --- files ----------------------------------------------------------------------------------------


def test_files_give_it_back(tmp_path: Path) -> None:
    mended = mended_map(*known(rest=5.0))
    save_mended_map(mended, tmp_path / "mended.obj")
    shape, error = load_map(tmp_path / "mended.obj", "km")
    np.testing.assert_allclose(shape.vertices, mended.shape.vertices, rtol=1e-12)
    assert error is not None
    np.testing.assert_allclose(error.table, mended.error.table, rtol=1e-6, atol=1e-6)
    assert error.rest == 5.0


def test_what_was_not_learned_is_not_mended() -> None:
    shape, _, estimate = known()
    nothing = estimate._replace(mean=np.zeros(BASE), covariance=np.zeros((BASE, BASE)))
    with pytest.raises(InputError, match=r"not mended.*surface_rms_m"):
        mended_map(shape, MapError(shape), nothing)
    with pytest.raises(InputError, match="told its true state"):
        fly(short_scenario(**BRIEF), PdController(), finished=mended_map_of_flight)


def test_errors_of_another_mesh_or_damaged_ones_are_refused(tmp_path: Path) -> None:
    path, beside = tmp_path / "mended.obj", tmp_path / "mended.npz"
    mended = mended_map(*known())
    save_mended_map(mended, path)
    with pytest.raises(InputError, match="of another mesh"):
        load_map(path, "m")
    content = beside.read_bytes()
    beside.write_bytes(content[: len(content) // 2])
    with pytest.raises(InputError, match="is not the error of a map"):
        load_map(path, "km")
    table = mended.error.table * np.nan
    np.savez(beside, vertices=mended.shape.vertices, left=table, rest=0.0)
    with pytest.raises(InputError, match="is damaged"):
        load_map(path, "km")
    np.savez(beside, vertices=np.array([{}]), left=table, rest=0.0)
    with pytest.raises(InputError, match="is not the error of a map"):
        load_map(path, "km")
    with pytest.raises(InputError, match=r"ends in \.obj"):
        save_mended_map(mended, tmp_path / "mended.stl")


# --- flown ----------------------------------------------------------------------------------------


def flown_by(
    system: LidarNavigation, true: Polyhedron, steps: int, noise: int
) -> tuple[list[float], MendedMap]:
    """Its position errors in m along a flight about the true surface, and its map at the end."""
    flown, context, errors = flight(), system.CreateDefaultContext(), []
    ranges, force = (system.GetInputPort(name) for name in ("ranges", "commanded_force"))
    for k in range(steps):
        context.SetTime(PERIOD * k)
        ranges.FixValue(context, frame(flown.states[k, :3], noise + k, body=true))
        force.FixValue(context, flown.forces[k])
        state = system.GetOutputPort("state").Eval(context)
        errors.append(float(np.linalg.norm(state[:3] - flown.states[k, :3])))
        context.SetDiscreteState(system.EvalUniquePeriodicDiscreteUpdate(context))
    return errors, system.mended_map(context)


@pytest.mark.slow
def test_a_mended_map_is_nearer_to_the_truth_and_flies_better_from_the_start() -> None:
    body = kleopatra()
    true = displaced(body.shape, RMS, CORRELATION, 5)
    expected = ExpectedErrors(surface_rms_m=RMS, surface_correlation_m=CORRELATION)
    first = navigation(expected=expected)
    before, found = flown_by(first, true, 40, 500)
    normals, _ = vertex_normals(body.shape)
    seen = found.deviations < 0.7 * RMS
    assert 0.1 < seen.mean() < 0.9
    off, left = (
        np.einsum("vi,vi->v", true.vertices - shape.vertices, normals)
        for shape in (body.shape, found.shape)
    )
    assert np.mean(left[seen] ** 2) < 0.5 * np.mean(off[seen] ** 2)
    assert np.mean(np.abs(left) < 3.0 * found.deviations) > 0.9
    second = LidarNavigation(
        found.shape, body.gravity_field, body.spin_rate, 100.0, LidarFrames(50.0),
        map_error=found.error,
    )  # fmt: skip
    after, _ = flown_by(second, true, 6, 900)
    assert np.median(after) < 0.7 * np.median(before[:6])


def _navigation(scenario: Scenario, body: Body) -> LidarNavigation:
    return make_navigation(scenario, body, filter_tuning(scenario, body))


def test_a_scenario_names_the_map_by_which_is_navigated(tmp_path: Path) -> None:
    body = kleopatra()
    heights = np.linspace(0.0, 50.0, len(body.shape.vertices))[:, None]
    normals, _ = vertex_normals(body.shape)
    shape = Polyhedron(body.shape.vertices + heights * normals, body.shape.facets)
    (tmp_path / "other.obj").write_bytes(mesh_bytes(shape.vertices / 1e3, shape.facets, ".obj"))
    (tmp_path / "scenario.yaml").write_text("navigation: !LidarNavigation {map: other.obj}\n")
    scenario = load_scenario(tmp_path / "scenario.yaml")
    made = _navigation(scenario, body)
    np.testing.assert_allclose(made.model.shape.vertices, shape.vertices)
    assert made.model.map_error.modes == 0
    error = MapError.known(np.ones((len(heights), 2)), 0.0)
    save_mended_map(MendedMap(shape, error), tmp_path / "other.obj")
    assert isinstance(scenario.navigation, LidarNavigationConfig)
    assert _navigation(scenario, body).model.map_error.modes == 2
    (tmp_path / "other.npz").unlink()
    scenario.navigation.map_unit = "m"
    with pytest.raises(InputError, match=r"0\.001 times as long"):
        _navigation(scenario, body)
    scenario.navigation.map_unit = "km"
    made = _navigation(scenario, body)
    np.testing.assert_allclose(made.model.shape.vertices, shape.vertices)
    assert made.model.map_error.modes == 0


# --- the centre of mass ---------------------------------------------------------------------------


def test_a_wrong_surface_moves_the_centre_of_mass() -> None:
    """As surfaces that are drawn move it."""
    shape = kleopatra().shape
    shifts = np.array(
        [displaced(shape, RMS, CORRELATION, seed).centre_of_mass for seed in range(10)]
    )
    drawn = np.sqrt(np.mean(shifts**2, axis=0)).max()
    assert shift_of_centre(shape, RMS, CORRELATION) == pytest.approx(drawn, rel=0.4)
    scenario = load_scenario(None, {"navigation.expected.surface_rms_m": RMS})
    told = filter_tuning(scenario, kleopatra()).centre_of_mass_m
    assert told == pytest.approx(drawn, rel=0.4)
