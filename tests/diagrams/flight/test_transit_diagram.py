"""The wiring: any controller of the right ports flies, and everything is where it says it is."""

import dataclasses as dc
from pathlib import Path

import numpy as np
import pytest
from pydrake.geometry import Meshcat
from pydrake.systems.framework import Diagram, System
from short_flights import (
    BRIEF,
    PdController,
    Scripted,
    disturbed_flight,
    kleopatra,
    short_scenario,
)

from proxops.diagrams.flight.simulation import fly, make_simulator
from proxops.diagrams.flight.transit_diagram import make_transit_diagram
from proxops.diagrams.logs.flight_log import FlightLog
from proxops.diagrams.meshcat.replay import write_replay
from proxops.diagrams.scenario import LidarNavigationConfig
from proxops.diagrams.scenario.scenario import load_scenario
from proxops.systems import (
    InputError,
    LegendEntry,
    Lidar,
    LoggedPort,
    TransitProgram,
)


def build(controller: System | None = None, **changes: object) -> Diagram:
    return make_transit_diagram(short_scenario(**changes), controller, body=kleopatra())


def output(diagram: Diagram, context, system: str, port: str) -> np.ndarray:
    subsystem = diagram.GetSubsystemByName(system)
    return subsystem.GetOutputPort(port).Eval(subsystem.GetMyContextFromRoot(context))


def test_starts_at_rest_at_the_start() -> None:
    diagram = build()
    context = diagram.CreateDefaultContext()
    state = output(diagram, context, "spacecraft", "state")
    np.testing.assert_array_equal(state, [160e3, 0, 0, 0, 0, 0])
    target = diagram.GetSubsystemByName("target").get_output_port()
    target = target.Eval(diagram.GetSubsystemByName("target").GetMyContextFromRoot(context))
    np.testing.assert_array_equal(target, [160e3, 8e3, 0, 0, 0, 0])


# --- a user's own controller ----------------------------------------------------------------------


def test_own_controller_flies() -> None:
    log = fly(short_scenario(), PdController(), body=kleopatra())
    assert log.summary["success"]
    assert log.summary["controller"] == "PdController"
    assert log.summary["mpc_solves"] == 0
    assert np.isnan(log.dataset["mpc_force"]).all()
    assert (log.dataset["decision"] == 0).all()


def test_every_port_there_is() -> None:
    """Each input gets what its name says."""
    ports = [("state", 6), ("target", 6), ("position", 3), ("velocity", 3), ("ranges", 4320)]
    controller = Scripted(lambda time: np.array([1.0, 2.0, 3.0]), [*ports, ("commanded_force", 3)])
    diagram = build(controller)
    simulator = make_simulator(diagram, short_scenario())
    simulator.AdvanceTo(25.0)
    context = controller.GetMyContextFromRoot(simulator.get_context())
    seen = {name: controller.GetInputPort(name).Eval(context) for name, _ in ports}
    np.testing.assert_array_equal(seen["state"], [*seen["position"], *seen["velocity"]])
    np.testing.assert_array_equal(seen["target"], [160e3, 8e3, 0, 0, 0, 0])
    np.testing.assert_array_equal(
        controller.GetInputPort("commanded_force").Eval(context), [1, 2, 3]
    )
    lidar = diagram.GetSubsystemByName("lidar")
    assert isinstance(lidar, Lidar)
    assert 0 < np.isfinite(seen["ranges"]).sum() < 4320


class Talkative(PdController):
    """A controller that the core has never heard of, with ports and a name of its own to show."""

    legend_entry = LegendEntry("my PD <b>", (0.9, 0.1, 0.2))

    def __init__(self, column: str = "distance_left"):
        super().__init__()
        self._column = column
        self.DeclareVectorOutputPort(
            "distance", 1, lambda context, output: output.SetFromVector([self._error(context)[1]])
        )
        self.DeclareVectorOutputPort(
            "error", 3, lambda context, output: output.SetFromVector(self._error(context)[0])
        )

    def _error(self, context):
        state, target = (self.GetInputPort(name).Eval(context) for name in ("state", "target"))
        return target[:3] - state[:3], np.linalg.norm(target[:3] - state[:3])

    def logged_ports(self) -> dict[str, LoggedPort]:
        return {
            self._column: LoggedPort(self.GetOutputPort("distance"), "m", "distance to the goal"),
            "own_error": LoggedPort(self.GetOutputPort("error"), "m", "goal less position in K"),
        }


def test_a_new_controller_logs_its_ports_and_names_itself(tmp_path: Path) -> None:
    log = fly(short_scenario(**BRIEF), Talkative(), body=kleopatra())
    log.to_netcdf(tmp_path / "flight.nc")
    read = FlightLog.load(tmp_path / "flight.nc")
    data = read.dataset
    error = (data["target"] - data["state"]).values[:-1, :3]
    np.testing.assert_allclose(data["own_error"].values[:-1], error, atol=1e-9)
    np.testing.assert_allclose(data["distance_left"].values[:-1], np.linalg.norm(error, axis=1))
    assert data["distance_left"].attrs == {"units": "m", "long_name": "distance to the goal"}
    write_replay(read, tmp_path / "replay.html")
    page = (tmp_path / "replay.html").read_text()
    assert "flown by my PD &lt;b&gt;" in page
    assert "#e61a33" in page  # Its colour.
    assert "<b>" not in page.split('id="legend"')[1].split("</div>")[0]


@pytest.mark.parametrize("column", ["state", "two words"])
def test_a_column_of_the_log_s_own_is_refused(column: str) -> None:
    with pytest.raises(InputError, match=f"'{column}'"):
        build(Talkative(column))


@pytest.mark.parametrize(
    ("controller", "complaint"),
    [
        (
            Scripted(output="thrust"),
            "needs an output port 'force' of size 3; it has 'thrust' of size 3",
        ),
        (Scripted(force=lambda time: np.zeros(2), size=2), "needs an output port 'force' of size"),
        (
            Scripted(ports=[("state", 3)]),
            "input port 'state' has size 3, but the signal of this name has size 6",
        ),
        (
            Scripted(ports=[("velocity", 6)]),
            "input port 'velocity' has size 6, but the signal of this name has size 3",
        ),
        (Scripted(ports=[("sate", 6)]), "nothing feeds input port 'sate'; the signals are state"),
    ],
)
def test_wrong_ports_refused(controller: System, complaint: str) -> None:
    controller.set_name("mine")
    with pytest.raises(InputError, match=complaint) as caught:
        build(controller)
    assert "controller 'mine'" in str(caught.value)


@pytest.mark.parametrize("name", ["lidar", "live_view"])
def test_a_part_s_name_is_refused(name: str) -> None:
    """Of a part before it, and of one after it."""
    controller = Scripted(ports=[("state", 6)])
    controller.set_name(name)
    scenario = dc.replace(load_scenario(), navigation=LidarNavigationConfig())
    with pytest.raises(InputError, match="a part of the diagram is called so"):
        make_transit_diagram(scenario, controller, Meshcat(), kleopatra())


def test_offers_that_cannot_be_are_refused() -> None:
    late, talking = Scripted(), Scripted()
    late.delay = -1.0
    with pytest.raises(InputError, match=r"controller '.*' needs delay from 0"):
        build(late)
    talking.logged_ports = lambda: {"mine": talking.GetOutputPort("force")}
    with pytest.raises(InputError, match="needs a LoggedPort as 'mine', got a LeafOutputPort"):
        build(talking)
    talking.logged_ports = lambda: [talking.GetOutputPort("force")]
    with pytest.raises(InputError, match="needs a dict as logged_ports, got a list"):
        build(talking)
    packed, painted = Scripted(), Scripted()
    packed.bundle = "out/policy"
    with pytest.raises(InputError, match="its bundle, a str, has no hash `sha256`"):
        build(packed)
    painted.legend_entry = "red"
    with pytest.raises(InputError, match="needs a LegendEntry as legend_entry"):
        build(painted)


@pytest.mark.parametrize("value", [np.nan])
def test_force_that_is_no_number_refused(value: float) -> None:
    """An integrator would look for a step that copes with it, for ever."""
    controller = Scripted(lambda time: np.array([0.0, value if time >= 50.0 else 0.0, 0.0]))
    with pytest.raises(InputError, match=r"commands .* N at 50 s; a force must be finite"):
        fly(short_scenario(), controller, body=kleopatra())


def test_thrusters_clip_what_anybody_commands() -> None:
    controller = Scripted(lambda time: np.array([100.0, -0.5, -8.0]))
    data = fly(short_scenario(**BRIEF), controller, body=kleopatra()).dataset
    assert (data["force"] == [7.0, -0.5, -7.0]).all()
    assert (data["disturbance"] == [-93.0, 0.0, 1.0]).all()


# --- evaluation order -----------------------------------------------------------------------------


def test_one_solve_a_step(monkeypatch: pytest.MonkeyPatch) -> None:
    """With logs, lidar and disturbance reading what they read."""
    times = []
    solve = TransitProgram.solve

    def counted(self, *arguments, **options):
        times.append(1)
        return solve(self, *arguments, **options)

    monkeypatch.setattr(TransitProgram, "solve", counted)
    diagram = build(disturbance={})
    simulator = make_simulator(diagram, short_scenario(disturbance={}))
    for step in range(12):
        simulator.AdvanceTo(10.0 * step + 5.0)  # Within each step, after its solve.
        assert len(times) == step + 1


def test_disturbance_is_in_the_chain() -> None:
    data = disturbed_flight().dataset
    applied, commanded = data["force"].values, data["mpc_force"].values
    walk = data["disturbance"].values
    asked = np.isfinite(commanded).all(axis=1)
    np.testing.assert_allclose(applied[asked], (commanded + walk)[asked], atol=1e-12)
    assert np.abs(walk).max() > 0.1
    assert np.abs(applied).max() <= 7.0
    # No more than twice the command; the clipping only shortens it.
    excess = np.linalg.norm(walk, axis=1) - 2.0 * np.linalg.norm(commanded, axis=1)
    assert excess[asked].max() <= 1e-9
