"""A log holds what its schema says, its summary is right, and a file that exists is whole."""

import dataclasses as dc
import gc
import hashlib
import pickle
from importlib import metadata
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from pydrake.solvers import SolutionResult
from scipy.interpolate import CubicHermiteSpline
from scipy.optimize import minimize
from short_flights import (
    BRIEF,
    disturbed_flight,
    falling_flight,
    kleopatra,
    kleopatra_flight,
    short_scenario,
)
from summary_names import SUMMARY
from synthetic_log import synthetic_log

from proxops.diagrams.flight.simulation import fly
from proxops.diagrams.logs.columns import NAVIGATION_COLUMNS, VARIABLES
from proxops.diagrams.logs.flight_log import FlightLog, differences, make_dataset
from proxops.diagrams.logs.flight_summary import fallback_steps
from proxops.diagrams.scenario import TruthConfig, dump_scenario, load_scenario, parse_scenario
from proxops.systems import InputError, TransitProgram
from proxops.systems.common.errors import SolverFailure

SIZES = {"component": 6, "axis": 3, "plane": 12, "ray": 360}
# Of flights with kicks or sunlight, with a policy, of a hybrid, with runtime assurance, or with a
# navigation.
RIGID_COLUMNS = (
    "angular_velocity", "inertial_attitude", "reference_attitude", "wheel_momentum", "on_times",
    "centre_of_mass", "failed_thrusters",
)  # fmt: skip
SOMETIMES = (
    "kick", "sun_direction", "policy_time", "policy_status", "estimate", "decision_reason",
    "agreement", "force_difference", "force_angle", "check_clearance", "steps_to_check",
    "decision_time", "intervention", "intervention_reason", "thrust", "mass", "attitude",
    *NAVIGATION_COLUMNS, *RIGID_COLUMNS,
    "navigation_return_use", "assurance_margin", "assurance_position", "assurance_velocity",
    "touch_phase", "touch_abort", "touch_tries", "touch_stopping_height", "touch_by_policy",
    "contact_force", "parts_force", "arm_stroke", "contact_energy",
)  # fmt: skip
AXES = np.array([140e3, 70e3, 65e3])


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("log") / "flight.nc"
    kleopatra_flight().to_netcdf(path)
    return path


# --- schema ---------------------------------------------------------------------------------------


def test_variables() -> None:
    data = kleopatra_flight().dataset
    for name in VARIABLES.keys() - SOMETIMES:
        dimensions, units, long_name, *_ = VARIABLES[name]
        assert data[name].dims == ("time", *dimensions)
        assert data[name].shape[1:] == tuple(SIZES[dimension] for dimension in dimensions)
        own = "units_of_components" if ";" in units else "units"
        assert data[name].attrs[own] == units
        if own != "units":  # The CF conventions have no unit of several parts.
            assert "units" not in data[name].attrs
            assert units.count(";") + 1 == data[name].shape[-1]
        assert data[name].attrs["long_name"] == long_name


def test_global_attributes() -> None:
    log = kleopatra_flight()
    attrs = log.dataset.attrs
    assert parse_scenario(attrs["scenario"]) == load_scenario(on_true_state=True)
    assert attrs["scenario_sha256"] == hashlib.sha256(attrs["scenario"].encode()).hexdigest()
    assert attrs["proxops_version"] == metadata.version("proxops")
    assert attrs["controller"] == "mpc"
    assert (attrs["seed"], attrs["transit"], attrs["noise_seed"]) == (10000, 0, 0)
    digest = hashlib.sha256(log.dataset["mesh_vertices"].values.astype("<f8").tobytes())
    digest.update(log.dataset["mesh_facets"].values.astype("<i8").tobytes())
    assert attrs["shape_sha256"] == digest.hexdigest()


def test_fallbacks_are_logged_and_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    """Failures at steps 0, 1, 5 and 6 of 15."""
    solve, step, solved = TransitProgram.solve, -1, False

    def failing(self, state, target, previous, *arguments):
        nonlocal step, solved
        # Once there is a plan, the second try of a step is the one without it. States do not tell
        # steps apart: a spacecraft that brakes from rest may stay where it is to the last bit.
        if previous is not None or not solved:
            step += 1
        if step in {0, 1, 5, 6}:
            raise SolverFailure(SolutionResult.kIterationLimit)
        solved = True
        return solve(self, state, target, previous, *arguments)

    monkeypatch.setattr(TransitProgram, "solve", failing)
    log = fly(short_scenario(**BRIEF), body=kleopatra())
    status = log.dataset["solve_status"].values
    assert status[:9].tolist() == [2, 2, 0, 0, 0, 1, 1, 0, 0]
    assert log.dataset["solve_reason"].values[:9].tolist() == [7, 7, 1, 0, 0, 7, 7, 2, 0]
    assert fallback_steps(log.dataset) == {
        "braking: solver iteration limit": 2,
        "last plan continued: solver iteration limit": 2,
    }
    assert fallback_steps(kleopatra_flight().dataset) == {}


# --- summary --------------------------------------------------------------------------------------


def test_summary_has_exactly_these_keys() -> None:
    for flight in (kleopatra_flight, disturbed_flight, falling_flight):
        assert list(flight().summary) == SUMMARY


def test_summary_counts() -> None:
    log = kleopatra_flight()
    summary, data = log.summary, log.dataset
    assert summary["steps"] == len(data["time"]) - 1
    assert summary["mpc_solves"] == summary["steps"] + 1  # The last row is a control step.
    assert summary["policy_share"] == 0.0
    assert summary["policy_sha256"] is None
    solve_ms = 1e3 * data["solve_time"].values[1:]  # The first one loads what it calls.
    assert summary["control_ms_median"] == pytest.approx(np.median(solve_ms))
    assert summary["control_ms_p99"] == pytest.approx(np.quantile(solve_ms, 0.99))
    assert summary["control_ms_mean"] == pytest.approx(np.mean(solve_ms))
    assert 0.0 < summary["wall_s"] < 600.0


def test_delta_v() -> None:
    """Integral of |F_x| + |F_y| + |F_z| over the mass, on a fine grid; split at arrival."""
    log = kleopatra_flight()
    data = log.dataset
    times, end = data["time"].values, float(data["time"][-1])
    step = 0.01
    grid = np.arange(0.5 * step, end, step)
    row = np.searchsorted(times, grid, side="right") - 1
    rate = np.abs(data["force"].values[row]).sum(axis=1) / 100.0
    before = grid < log.summary["arrival_time_s"]
    assert log.summary["delta_v_m_s"] == pytest.approx(rate[before].sum() * step, rel=1e-4)
    assert log.summary["hold_delta_v_m_s"] == pytest.approx(rate[~before].sum() * step, rel=1e-3)


@pytest.mark.parametrize("flight", [kleopatra_flight, falling_flight])
def test_least_clearance(flight) -> None:
    """By brute force: every 0.5 s, and the ellipsoid's nearest point by minimisation."""
    log = flight()
    states, times = log.dataset["state"].values, log.dataset["time"].values
    path = CubicHermiteSpline(times, states[:, :3], states[:, 3:])
    points = path(np.append(np.arange(0.0, times[-1], 0.5), times[-1]))
    sign = np.where(np.sum((points / AXES) ** 2, axis=1) < 1.0, -1.0, 1.0)

    def surface(angles: np.ndarray) -> np.ndarray:
        polar, azimuth = angles
        across = np.sin(polar)
        unit = [across * np.cos(azimuth), across * np.sin(azimuth), np.cos(polar)]
        return AXES * np.stack(unit, axis=-1)

    polar, azimuth = np.meshgrid(np.linspace(0, np.pi, 61), np.linspace(-np.pi, np.pi, 121))
    grid = surface(np.stack([polar.ravel(), azimuth.ravel()]))
    rough = sign * np.array([np.linalg.norm(grid - point, axis=1).min() for point in points[::10]
                             ]).repeat(10)[: len(points)]  # fmt: skip
    candidates = np.argsort(rough)[:400:20]
    found = []
    for index in candidates:
        start = grid[np.linalg.norm(grid - points[index], axis=1).argmin()] / AXES
        angles = [np.arccos(np.clip(start[2], -1, 1)), np.arctan2(start[1], start[0])]
        result = minimize(
            lambda at, index=index: np.sum(((surface(at) - points[index]) / 1e4) ** 2),
            angles,
            method="Nelder-Mead",
            options={"xatol": 1e-9, "fatol": 1e-12},
        )
        found.append(sign[index] * 1e4 * np.sqrt(result.fun))
    assert log.summary["min_clearance_m"] == pytest.approx(min(found), abs=50.0)


@pytest.mark.parametrize(
    ("start_km", "goal_km", "line_km"),
    [
        # Through the body along its shortest axis, and past it at right angles to the longest.
        ([0.0, 0.0, 100.0], [0.0, 0.0, -100.0], -65.0),
        ([200.0, 0.0, 100.0], [200.0, 0.0, -100.0], 60.0),
        ([200.0, 0.0, 0.0], [260.0, 0.0, 0.0], 60.0),
    ],
)
def test_what_the_transit_asks_for(
    start_km: list[float], goal_km: list[float], line_km: float
) -> None:
    log = placed([0.0, 0.0])
    data = log.dataset.copy(deep=True)
    data["state"].values[0, :3], data["target"].values[:, :3] = 1e3 * np.array([start_km, goal_km])
    summary = FlightLog(data, log.body).summary
    distance = 1e3 * np.linalg.norm(np.subtract(goal_km, start_km))
    assert summary["transit_distance_m"] == pytest.approx(distance)
    assert summary["transit_line_clearance_m"] == pytest.approx(1e3 * line_km)
    # All of these points are on axes, or their nearest point is found by minimisation.
    for name, point in (("start", start_km), ("goal", goal_km)):
        found = minimize(
            lambda place, point=point: np.sum((place - point) ** 2),
            1e-3 * AXES / np.sqrt(3.0) * np.where(np.array(point) < 0.0, -1.0, 1.0),
            constraints={"type": "eq", "fun": lambda at: np.sum((1e3 * at / AXES) ** 2) - 1.0},
        )
        clearance = 1e3 * np.sqrt(found.fun)
        assert summary[f"transit_{name}_clearance_m"] == pytest.approx(clearance, rel=1e-3)


def placed(distances_km: list[float], dwell: float = 600.0, **arrival: float) -> FlightLog:
    """A log of a spacecraft at rest at these distances from the goal, one every 10 s."""
    changes = {f"arrival.{name}": value for name, value in arrival.items()}
    scenario, body = load_scenario(None, {"arrival.dwell_s": dwell, **changes}), kleopatra()
    count = len(distances_km)
    states, target = np.zeros((count, 6)), np.zeros((count, 6))
    target[:, 0] = 160e3
    states[:, 0] = 160e3 + 1e3 * np.array(distances_km)
    nothing = np.full(count, np.nan)
    columns = {"state": states, "target": target, "force": np.zeros((count, 3))}
    columns |= {"decision": np.zeros(count), "solve_time": nothing}
    attributes = {"controller": "none", "arrival_time_s": np.nan, "collided": 0, "wall_s": 1.0}
    attributes |= {"keep_out_violations": 0}
    times = 10.0 * np.arange(count)
    return FlightLog(make_dataset(columns, times, scenario, body, attributes), body)


@pytest.mark.parametrize(
    ("distances", "success"),
    [
        ([3.0] * 10 + [1.0] * 60 + [3.0] * 5, True),  # From 95 s to 695 s.
        ([3.0] * 10 + [1.0] * 59 + [3.0] * 5, False),
        ([3.0] * 10 + [1.0] * 30 + [3.0] + [1.0] * 30 + [3.0] * 5, False),
        ([3.0] * 5 + [1.0] * 61, True),
        ([3.0] * 5 + [1.0] * 60, False),  # 595 s when the log ends.
        ([3.0] * 722 + [1.0] * 61, False),  # Past the deadline.
        ([3.0] * 100, False),
    ],
)
def test_dwell_at_two_kilometres(distances: list[float], success: bool) -> None:
    assert placed(distances).summary["success_2km"] == success


# --- files ----------------------------------------------------------------------------------------


def test_round_trip(file: Path) -> None:
    log, loaded = kleopatra_flight(), FlightLog.load(file)
    assert loaded.dataset.identical(log.dataset)
    assert differences(loaded, log) == []
    assert loaded.summary == log.summary
    assert loaded.scenario == log.scenario
    assert loaded.body.config == log.body.config
    assert loaded.body.shape.sha256 == log.body.shape.sha256
    for name, variable in log.dataset.variables.items():
        assert loaded.dataset[name].dtype.kind == variable.dtype.kind, name


def test_differences_sees_one_bit() -> None:
    log = synthetic_log(20, ranges=False)
    changed = log.dataset.copy(deep=True)
    changed["force"][7, 1] = np.nextafter(changed["force"][7, 1], np.inf)
    changed["solve_time"] = changed["solve_time"] + 1.0  # A wall time.
    assert differences(log, dc.replace(log, dataset=changed)) == ["force"]
    shorter = log.dataset.isel(time=slice(0, -1))
    assert "state" in differences(log, dc.replace(log, dataset=shorter))
    assert differences(log, dc.replace(log, dataset=log.dataset.drop_vars("target"))) == ["target"]


def other_mesh(data: xr.Dataset) -> xr.Dataset:
    data["mesh_vertices"][3, 1] += 0.5
    return data


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        (lambda data: data.drop_vars("mesh_facets"), "it has no .*mesh_facets"),
        (lambda data: data.drop_vars("state"), "it has no .*state"),
        (lambda data: data.drop_attrs(deep=False), "it has no scenario, body, "),
        (other_mesh, "does not match its hash"),
    ],
)
def test_log_without_a_part_is_refused(tmp_path: Path, change, complaint: str) -> None:
    dataset = change(synthetic_log(5, ranges=False).dataset.copy(deep=True))
    dataset.to_netcdf(tmp_path / "flight.nc", engine="h5netcdf")
    with pytest.raises(InputError, match=complaint):
        FlightLog.load(tmp_path / "flight.nc")


def test_truncated_file_is_refused(file: Path, tmp_path: Path) -> None:
    whole = file.read_bytes()
    for share in (0.0, 0.3, 0.999):
        (tmp_path / "flight.nc").write_bytes(whole[: int(share * len(whole))])
        with pytest.raises(InputError, match=r"flight\.nc"):
            FlightLog.load(tmp_path / "flight.nc")


# h5netcdf's own clean-up of what it could not open fails in its __del__.
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
def test_damaged_file_is_refused_or_reads_the_same_mesh(tmp_path: Path) -> None:
    """Bytes flipped all over: a clear refusal or a log, never another exception."""
    synthetic_log(30, ranges=False).to_netcdf(tmp_path / "flight.nc")
    whole = (tmp_path / "flight.nc").read_bytes()
    random = np.random.default_rng(1)
    for trial in range(4):
        damaged = bytearray(whole)
        start = int(random.integers(len(whole) - 64))
        damaged[start : start + 64] = random.bytes(64)
        path = tmp_path / f"{trial}.nc"
        path.write_bytes(damaged)
        try:
            log = FlightLog.load(path)
        except InputError as error:
            assert path.name in str(error)  # noqa: PT017 (either outcome is right)
        else:
            assert log.body.shape.sha256 == log.dataset.attrs["shape_sha256"]
    gc.collect()  # Now, while the warnings of its leavings are let pass.


def test_folder_in_the_way(tmp_path: Path) -> None:
    (tmp_path / "flight.nc").mkdir()
    with pytest.raises(InputError, match="cannot write"):
        synthetic_log(3, ranges=False).to_netcdf(tmp_path / "flight.nc")
    assert list(tmp_path.iterdir()) == [tmp_path / "flight.nc"]


def test_the_name_of_a_log_is_never_that_of_a_half(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In the midst of writing, the log of before is there, whole: a kill there leaves it so."""
    path, log = tmp_path / "flight.nc", synthetic_log(5, ranges=False)
    log.to_netcdf(path)
    whole, write, seen = path.read_bytes(), Path.write_bytes, []

    def in_halves(name: Path, content: bytes) -> int:
        write(name, content[: len(content) // 2])
        seen.append(path.read_bytes())
        return write(name, content)

    monkeypatch.setattr(Path, "write_bytes", in_halves)
    other = synthetic_log(9, ranges=False)
    other.to_netcdf(path)
    assert seen == [whole]
    assert differences(FlightLog.load(path), other) == []
    assert list(tmp_path.iterdir()) == [path]


def test_the_true_body_is_made_once() -> None:
    """And a copy, by pickling for instance, does not carry it along."""
    plain = synthetic_log(3, ranges=False)
    scenario = dc.replace(plain.scenario, truth=TruthConfig(pole_deg=[3.0, 0.0], spin=1.1))
    data = plain.dataset.assign_attrs(scenario=dump_scenario(scenario))
    log = FlightLog(data, plain.body)
    assert log.true_body is log.true_body
    assert log.differing_body is log.true_body
    assert plain.differing_body is None
    again = pickle.loads(pickle.dumps(log))
    assert vars(again).keys() == {"dataset", "body"}
    assert differences(log, again) == []
    np.testing.assert_array_equal(again.true_body.spin.rate, log.true_body.spin.rate)


def test_a_notebook_shows_figures_not_a_repr() -> None:
    log = kleopatra_flight()
    shown = log._repr_html_()
    assert f"{log.summary['delta_v_m_s']:.4g}" in shown
    assert "flown by the policy" in shown
    body = log.body._repr_html_()
    assert "2.97e+18" in body
    assert load_scenario()._repr_html_().count("<tr>") == 0
    changed = load_scenario(None, {"mpc.fuel_weight": 3.0, "body": "<kleopatra>"})
    assert "mpc.fuel_weight" in changed._repr_html_()
    assert "&lt;kleopatra&gt;" in changed._repr_html_()
