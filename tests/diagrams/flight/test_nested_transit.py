"""A transit inside a diagram of one's own flies as alone, and its ports say what they should."""

import numpy as np
from pydrake.systems.framework import Diagram, DiagramBuilder
from pydrake.systems.primitives import Integrator, LogVectorOutput, VectorLogSink
from short_flights import NEAR, kleopatra

from proxops.diagrams.flight import (
    Flown,
    add_transit,
    fly,
    let_go,
    make_log,
    make_mpc,
    make_simulator,
)
from proxops.diagrams.logs import FlightLog
from proxops.diagrams.scenario import Scenario, World, load_scenario


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
    scenario = load_scenario(None, NEAR | late)
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
    scenario = load_scenario(None, NEAR | {"log_ranges": True, "arrival.deadline_s": 50.0})
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
