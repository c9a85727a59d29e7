"""A transit inside a diagram of one's own flies as alone, and its ports say what they should."""

import runpy
from pathlib import Path

import numpy as np
import pytest
from pydrake.systems.framework import Diagram, DiagramBuilder
from pydrake.systems.primitives import Integrator, LogVectorOutput, VectorLogSink
from short_flights import SHORT, PdController, Scripted, kleopatra, short_scenario

from proxops.diagrams.flight import (
    Flown,
    add_transit,
    fly,
    let_go,
    make_log,
    make_mpc,
    make_simulator,
    make_transit_diagram,
)
from proxops.diagrams.logs import FlightLog
from proxops.diagrams.scenario import Scenario, World, load_scenario
from proxops.systems import LidarNavigation

ROOT = Path(__file__).parents[3]


def nested_flight(scenario: Scenario) -> tuple[FlightLog, dict[str, np.ndarray], float]:
    """The log of a nested flight, what sinks of one's own saw at its ports, and the end's time."""
    builder, mpc = DiagramBuilder(), make_mpc(scenario, kleopatra())
    transit = add_transit(builder, scenario, mpc, body=kleopatra())
    period = scenario.control_period_s
    sinks = {
        name: LogVectorOutput(transit.GetOutputPort(name), builder, publish_period=period)
        for name in ports(transit)
    }
    # A system of one's own with continuous state: the momentum that the thrusters gave.
    impulse = builder.AddSystem(Integrator(3))
    builder.Connect(transit.GetOutputPort("force"), impulse.get_input_port())
    diagram = builder.Build()
    simulator = make_simulator(diagram, scenario)
    simulator.AdvanceTo(scenario.arrival.deadline_s + scenario.arrival.dwell_s)
    context = simulator.get_context()
    flown = Flown(transit, context, World.of(scenario, kleopatra()), mpc, "mpc", None)
    log, seen = make_log(flown, 1.0), {}
    for name, sink in sinks.items():
        assert isinstance(sink, VectorLogSink)
        seen[name] = sink.FindLog(context).data().T.copy()
    own = impulse.GetMyContextFromRoot(context).get_continuous_state_vector().CopyToVector()
    seen["impulse"] = own
    port = transit.GetOutputPort("true_state")
    seen["end"] = port.Eval(transit.GetMyContextFromRoot(context))
    end = context.get_time()
    let_go(diagram, None)
    return log, seen, end


def ports(diagram: Diagram) -> dict[str, int]:
    found = map(diagram.get_output_port, range(diagram.num_output_ports()))
    return {port.get_name(): port.size() for port in found}


def test_it_flies_as_alone_bit_for_bit() -> None:
    """To its arrival, with a navigation and lidar frames that come late."""
    late = {"log_ranges": False, "truth.lidar.latency_steps": 1, "disturbance": {}}
    scenario = load_scenario(None, SHORT | late)
    alone = fly(scenario, body=kleopatra())
    log, seen, end = nested_flight(scenario)
    assert alone.summary["arrival_time_s"] is not None
    assert end == alone.dataset["time"].values[-1]
    np.testing.assert_array_equal(seen["end"], alone.dataset["state"][-1])
    for name in ("state", "force", "navigation_state", "navigation_covariance"):
        np.testing.assert_array_equal(log.dataset[name], alone.dataset[name], err_msg=name)
    for name in ("delta_v_m_s", "arrival_time_s", "min_clearance_m"):
        assert log.summary[name] == alone.summary[name]


def test_ports_say_what_they_are_to_say() -> None:
    scenario = load_scenario(None, SHORT | {"log_ranges": True, "arrival.deadline_s": 100.0})
    alone = fly(scenario, body=kleopatra()).dataset
    _, seen, _ = nested_flight(scenario)
    steps = len(seen["true_state"])
    np.testing.assert_array_equal(seen["true_state"], alone["state"][:steps])
    np.testing.assert_array_equal(seen["state"], alone["navigation_state"][:steps])
    known = alone["navigation_covariance"].values[:steps].reshape(steps, 81)
    np.testing.assert_array_equal(seen["covariance"], known)
    frames = alone["ranges"].values[:steps].reshape(steps, -1)
    np.testing.assert_array_equal(seen["ranges"].astype(np.float32), frames)
    # A sink sees what was held up to its step.
    held = alone["force"].values[: steps - 1]
    np.testing.assert_array_equal(seen["force"], [[0.0, 0.0, 0.0], *held])
    spans = np.diff(alone["time"].values)
    np.testing.assert_allclose(seen["impulse"], spans @ alone["force"].values[:-1], rtol=1e-9)


@pytest.mark.parametrize("controller", ["state", "none"])
def test_without_a_navigation_state_is_the_true_one(controller: str) -> None:
    """With `!TrueState`, and with a controller that reads no state."""
    if controller == "state":
        diagram = make_transit_diagram(short_scenario(), PdController(), body=kleopatra())
    else:
        scenario = load_scenario(None, SHORT)
        diagram = make_transit_diagram(scenario, Scripted(), body=kleopatra())
    assert ports(diagram) == {"true_state": 6, "state": 6, "force": 3, "ranges": 4320}
    context = diagram.CreateDefaultContext()
    for name in ("true_state", "state"):
        state = diagram.GetOutputPort(name).Eval(context)
        np.testing.assert_array_equal(state, [160e3, 0.0, 0.0, 0.0, 0.0, 0.0])


def test_two_in_one_diagram() -> None:
    builder, scenario = DiagramBuilder(), short_scenario()
    first = add_transit(builder, scenario, PdController(), body=kleopatra())
    first.set_name("first")
    add_transit(builder, scenario, PdController(), body=kleopatra())
    diagram = builder.Build()
    assert diagram.HasSubsystemNamed("first")
    assert diagram.HasSubsystemNamed("transit")


def test_the_example(capsys: pytest.CaptureFixture[str]) -> None:
    path = ROOT / "examples" / "11_nested_transit.py"
    assert len(path.read_text().splitlines()) <= 60
    names = runpy.run_path(str(path))
    table = [line.split() for line in capsys.readouterr().out.splitlines()[1:]]
    assert [float(row[0]) for row in table] == [60.0 * minute for minute in range(11)]
    navigation = names["transit"].GetSubsystemByName("navigation")
    assert isinstance(navigation, LidarNavigation)
    # It begins with the error of one frame, and settles within metres.
    assert 20.0 < float(table[0][2]) < 300.0
    assert max(float(row[2]) for row in table[5:]) < 15.0
