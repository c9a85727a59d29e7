"""The wiring: any controller of the right ports flies, and everything is where it says it is."""

from pathlib import Path

import numpy as np
import pytest
from pydrake.systems.framework import Diagram, System
from short_flights import (
    BRIEF,
    PdController,
    Scripted,
    kleopatra,
    short_scenario,
)

from proxops.diagrams.flight import fly, make_simulator, make_transit_diagram
from proxops.diagrams.logs.flight_log import FlightLog
from proxops.diagrams.meshcat.replay import write_replay
from proxops.systems import InputError, LegendEntry, Lidar, LoggedPort


def build(controller: System | None = None, **changes: object) -> Diagram:
    return make_transit_diagram(short_scenario(**changes), controller, body=kleopatra())


# --- a user's own controller ----------------------------------------------------------------------


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


def offering(**offers: object) -> Scripted:
    """A controller that offers these, as attributes."""
    made = Scripted(ports=[("state", 6)])
    for name, value in offers.items():
        setattr(made, name, value)
    return made


@pytest.mark.parametrize(
    ("controller", "complaint"),
    [
        (Scripted(output="thrust"), "needs an output port 'force' of size 3; it has 'thrust' of"),
        (Scripted(ports=[("state", 3)]), "input port 'state' has size 3, but the signal .* size 6"),
        (
            Scripted(ports=[("sate", 6)]),
            "nothing feeds input port 'sate'; .* are state, .*covariance",
        ),
        (Talkative("state"), "'state'"),
        (Talkative("two words"), "'two words'"),
        (offering(delay=-1.0), "needs delay from 0"),
        (offering(logged_ports=lambda: {"mine": 3}), "needs a LoggedPort as 'mine', got a int"),
        (offering(logged_ports=list), "needs a dict as logged_ports, got a list"),
        (offering(bundle="out/policy"), "its bundle, a str, has no hash `sha256`"),
        (offering(legend_entry="red"), "needs a LegendEntry as legend_entry"),
    ],
)
def test_controllers_that_do_not_fit_are_refused(controller: System, complaint: str) -> None:
    controller.set_name("mine")
    with pytest.raises(InputError, match=complaint) as caught:
        build(controller)
    assert "controller 'mine'" in str(caught.value)
    controller.set_name("lidar")
    with pytest.raises(InputError):
        build(controller)


def test_force_that_is_no_number_refused() -> None:
    """An integrator would look for a step that copes with it, for ever."""
    controller = Scripted(lambda time: np.array([0.0, np.nan if time >= 50.0 else 0.0, 0.0]))
    with pytest.raises(InputError, match=r"commands .* N at 50 s; a force must be finite"):
        fly(short_scenario(), controller, body=kleopatra())
