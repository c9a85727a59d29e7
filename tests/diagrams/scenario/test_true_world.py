"""Worlds that differ from what is believed: what flies in them, and what nobody is told."""

import types
import typing
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from pydrake.systems.framework import LeafSystem
from short_flights import BRIEF, PdController, Scripted, kleopatra, short_scenario

from proxops.diagrams.flight import fly, make_transit_diagram, named_controller
from proxops.diagrams.logs.flight_log import FlightLog, differences
from proxops.diagrams.scenario.scenario import load_scenario
from proxops.diagrams.scenario.scenario_config import Scenario, TruthConfig
from proxops.diagrams.scenario.true_body import TrueBody, UnflyableWorldError, make_true_body
from proxops.diagrams.scenario.world import believed
from proxops.systems.common.errors import InputError

EVERYTHING = {
    "truth.gravity": 1.05,
    "truth.density_contrast": 0.1,
    "truth.surface_rms_m": 300.0,
    "truth.size": 1.01,
    "truth.pole_deg": [0.5, -1.0],
    "truth.spin": 1.001,
    "truth.phase_deg": 0.2,
    "truth.attitude.constant_deg": [0.1, 0.2, -0.1],
    "truth.attitude.varying_std_deg": 0.02,
    "truth.lidar.bias_m": 10.0,
    "truth.lidar.dropout": 0.05,
    "truth.lidar.beam_width_rad": 1e-3,
    "truth.lidar.frame_loss": 0.1,
    "truth.lidar.latency_steps": 2,
    "truth.thrusters.scale": [0.97, 1.02, 1.01],
    "truth.thrusters.direction_deg": [0.5, -0.5, 0.3],
    "truth.thrusters.least_impulse_n_s": 0.5,
    "truth.mass": 1.02,
    "truth.specific_impulse_s": 220.0,
    "truth.acceleration.constant_m_s2": [1e-5, 0.0, -1e-5],
    "truth.acceleration.varying_std_m_s2": 1e-5,
}


def script(time: float) -> np.ndarray:
    return np.array([9.0, -0.1 * time, 2.0])


class Listens(LeafSystem):
    """Commands what the script says, and keeps what a port told it at each control step."""

    def __init__(self, port: str, size: int):
        super().__init__()
        self.heard: dict[float, np.ndarray] = {}
        self._port = self.DeclareVectorInputPort(port, size)
        self.DeclareVectorOutputPort("force", 3, self._calc_force)

    def _calc_force(self, context, output):
        time = context.get_time()
        self.heard.setdefault(time, self._port.Eval(context).copy())
        output.SetFromVector(script(time))


# --- nobody on board knows ------------------------------------------------------------------------


def held_by(start: object) -> Iterator[object]:
    """Every object that can be reached from one, through attributes, containers and closures."""
    seen: set[int] = set()
    todo = [start]
    while todo:
        each = todo.pop()
        if id(each) in seen or isinstance(each, type | types.ModuleType | str | bytes):
            continue
        seen.add(id(each))
        yield each
        names = set(vars(each)) if hasattr(each, "__dict__") else set()
        for kind in type(each).__mro__:  # Slots may be unset, and one name is a string by itself.
            slots = vars(kind).get("__slots__", ())
            names |= {slots} if isinstance(slots, str) else set(slots)
        # pydrake keeps a diagram alive through each of its systems; they hold nothing of it.
        todo += [getattr(each, name, None) for name in names if not name.startswith("_pydrake")]
        if isinstance(each, dict):
            todo += [*each.keys(), *each.values()]
        elif isinstance(each, list | tuple | set | frozenset):
            todo += list(each)
        elif isinstance(each, types.FunctionType):
            todo += [cell.cell_contents for cell in each.__closure__ or ()]
            todo += list(each.__defaults__ or ())
        elif isinstance(each, types.MethodType):
            todo += [each.__self__, each.__func__]
        todo += getattr(each, "GetSystems", list)()  # Of a Diagram.


def true_things(found: typing.Iterable[object], true_body: TrueBody) -> list[object]:
    shape = true_body.shape
    things = (true_body, shape, true_body.gravity_field, shape.vertices, shape.normals)
    return [
        each
        for each in found
        if any(each is thing for thing in things)
        or (isinstance(each, TruthConfig) and each != TruthConfig())
        or (isinstance(each, Scenario) and each.truth != TruthConfig())
    ]


class Keeps(PdController):
    """A user's controller that keeps everything that its factory was given."""

    def __init__(self, scenario: Scenario, body: object):
        super().__init__()
        self.scenario, self.body = scenario, body


@cache
def untrue_world() -> tuple[Scenario, TrueBody]:
    """Everything is other than believed."""
    settings = {**EVERYTHING, "assurance": {}, "hybrid.period_rule": "adaptive"}
    scenario = load_scenario(None, settings)
    return scenario, make_true_body(kleopatra(), scenario.truth)


@pytest.mark.parametrize(
    "name", ["mpc", "policy", "hybrid", "pd", "mpc:end-to-end", f"{__name__}:Keeps"]
)
def test_controllers_hold_nothing_true(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(Path(__file__).parents[3])
    (scenario, true_body), body = untrue_world(), kleopatra()
    controller = named_controller(name, believed(scenario), body)
    diagram = make_transit_diagram(scenario, controller, body=body, true_body=true_body)
    on_board = ("assurance", "navigation", "navigation_parts", "command_axes")
    for system in (controller, *map(diagram.GetSubsystemByName, on_board)):
        assert true_things(held_by(system), true_body) == []
    # The same walk finds the truth where it is meant to be.
    for world in ("gravity", "lidar", "monitor"):
        assert true_things(held_by(diagram.GetSubsystemByName(world)), true_body)


def test_fly_gives_a_factory_the_belief(monkeypatch: pytest.MonkeyPatch) -> None:
    given: list[Scenario] = []

    def factory(scenario: Scenario, body: object) -> PdController:
        given.append(scenario)
        return PdController()

    monkeypatch.setattr(f"{__name__}.Keeps", factory)
    fly(short_scenario(dispersions="before_survey", **BRIEF), f"{__name__}:Keeps", body=kleopatra())
    assert given[0].truth == TruthConfig()
    assert given[0].dispersed == []


def test_a_controller_is_told_its_own_command() -> None:
    """Clipped, and without the disturbance that acts."""
    controller = Listens("commanded_force", 3)
    scenario = short_scenario(disturbance={}, force_noise={}, **BRIEF)
    data = fly(scenario, controller, body=kleopatra()).dataset
    assert np.abs(data["disturbance"]).max() > 0.1
    for time, told in controller.heard.items():
        before = np.clip(script(time - 10.0), -7.0, 7.0) if time > 0.0 else np.zeros(3)
        np.testing.assert_array_equal(told, before)
    assert len(controller.heard) >= 10


# --- the world ------------------------------------------------------------------------------------


def test_delta_v_is_that_of_the_propellant() -> None:
    """Tsiolkovsky: Isp g0 ln(m0 / m1), if every axis has thrusters of its own."""
    scenario = short_scenario(truth__specific_impulse_s=20.0, truth__mass=1.1, **BRIEF)
    log = fly(scenario, Scripted(lambda time: np.array([6.0, -3.0, 1.0])), body=kleopatra())
    mass = log.dataset["mass"].values
    assert mass[0] == pytest.approx(110.0)
    spent = log.summary["delta_v_m_s"] + log.summary["hold_delta_v_m_s"]
    assert spent == pytest.approx(20.0 * 9.80665 * np.log(mass[0] / mass[-1]), rel=3e-3)


def test_spin_axis_goes_through_the_centre_of_mass() -> None:
    body = kleopatra()
    true_body = make_true_body(body, TruthConfig(density_contrast=0.1, pole_deg=[3.0, 4.0]))
    assert true_body.axis_point[0] > 5e3
    np.testing.assert_allclose(true_body.axis_point, true_body.gravity_field.centre_of_mass)
    tilt = np.degrees(np.arccos(true_body.spin.rate[2] / np.linalg.norm(true_body.spin.rate)))
    assert tilt == pytest.approx(5.0, rel=1e-3)
    assert np.linalg.norm(true_body.spin.rate) == pytest.approx(body.spin_rate)


def test_another_mesh(tmp_path: Path) -> None:
    """A mesh that was saved turned and moved is registered onto the map."""
    import trimesh

    body = kleopatra()
    mesh = body.shape.to_trimesh("km")
    mesh.apply_transform(trimesh.transformations.rotation_matrix(np.radians(2.0), [1, 2, 3]))
    mesh.export(tmp_path / "flown.obj")
    truth = TruthConfig(mesh=str(tmp_path / "flown.obj"))
    found = make_true_body(body, truth).shape
    np.testing.assert_allclose(found.vertices, body.shape.vertices, atol=5.0)
    truth.mesh_unit = "m"
    with pytest.raises(InputError, match=r"flown.obj is 0.001 times as long as the map"):
        make_true_body(body, truth)
    (tmp_path / "open.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    with pytest.raises(InputError, match=r"open\.obj"):
        make_true_body(body, TruthConfig(mesh=str(tmp_path / "open.obj")))


def test_a_log_repeats_without_the_dispersions(tmp_path: Path) -> None:
    scenario = short_scenario(
        dispersions="before_survey", truth__lidar__latency_steps=2, log_ranges=True, **BRIEF
    )
    log = fly(scenario, "policy", body=kleopatra())
    assert log.scenario.dispersions is None
    assert log.summary["dispersed"]["truth.gravity"] == log.scenario.truth.gravity != 1.0
    log.to_netcdf(tmp_path / "flight.nc")
    loaded = FlightLog.load(tmp_path / "flight.nc")
    assert differences(log, loaded) == []
    again = fly(loaded.scenario, "policy", body=loaded.body, true_body=loaded.true_body)
    assert differences(loaded, again) == []


def test_frames_of_a_log_are_those_that_were_received() -> None:
    scenario = short_scenario(
        **{key.replace(".", "__"): v for key, v in EVERYTHING.items()}, **BRIEF
    )
    scenario.log_ranges = True
    controller = Listens("ranges", 4320)
    data = fly(scenario, controller, body=kleopatra()).dataset
    logged = dict(zip(data["time"].values, data["ranges"].values, strict=True))
    assert len(controller.heard) >= 10
    for time, ranges in controller.heard.items():
        np.testing.assert_array_equal(logged[time].ravel(), ranges.astype(np.float32))
    assert np.isinf(logged[0.0]).all()
    assert sum(np.isfinite(frame).any() for frame in logged.values()) >= 8


# --- worlds that cannot be flown ------------------------------------------------------------------


def test_worlds_that_cannot_be_flown() -> None:
    with pytest.raises(UnflyableWorldError, match=r"hovering at the .* takes .* N along"):
        fly(short_scenario(truth__mass=100.0), "zero", body=kleopatra())
    with pytest.raises(UnflyableWorldError, match="the start is inside the true body"):
        fly(short_scenario(truth__size=3.0), "zero", body=kleopatra())
