"""Flying: a scenario and a controller in, a `FlightLog` out."""

from __future__ import annotations

import hashlib
import math
import time
from importlib import metadata

import numpy as np
from pydrake.geometry import Meshcat
from pydrake.systems.analysis import ResetIntegratorFromFlags, Simulator, SimulatorStatus
from pydrake.systems.framework import Context, Diagram, EventStatus, System
from pydrake.systems.primitives import VectorLogSink

from proxops.diagrams.flight.estimate_feedback import EstimateFeedback
from proxops.diagrams.flight.hybrid_controller import HybridController
from proxops.diagrams.flight.named_controllers import named_controller
from proxops.diagrams.flight.transit_diagram import make_transit_diagram
from proxops.diagrams.logs import DECISION_VARIABLES, FlightLog, make_dataset
from proxops.diagrams.meshcat import PLAYBACK_SPEED, add_flight
from proxops.diagrams.scenario import Body, Scenario, dump_scenario, load_body
from proxops.systems.common import Progress, silent
from proxops.systems.lidar import LearnedLidar, PlanarLidar
from proxops.systems.policy import NeuralPolicy
from proxops.systems.vehicle import COLLIDED, ENTERED_GOAL, NEVER, VIOLATIONS, DelayedHold

# Relative accuracy to which events are found.
_EVENT_ACCURACY = 1e-6
# Longest step of the integration (s): gravity changes over some 100 s.
_LONGEST_STEP = 10.0
# What a controller is asked at control steps only.
_ASKED = (
    "mpc_force", "mpc_record", "policy_force", "policy_record", "estimate", "decision",
    "decision_record", "intervention_record",
)  # fmt: skip


def fly(
    scenario: Scenario,
    controller: str | System = "mpc",
    meshcat: Meshcat | None = None,
    progress: Progress = silent,
    body: Body | None = None,
) -> FlightLog:
    """Flies a scenario's transit from start to arrival, collision or the deadline.

    Args:
      controller: a name that `named_controller` knows, or a System.
      meshcat: draws the flight live, at the replay's speed, and holds the replay afterwards.
      progress: is called at every step with the share of the longest time that has passed.
      body: None: the one that the scenario names.

    Returns:
      The log. The same scenario and controller give the same log, bit for bit, on one machine,
      but for wall times.

    Raises:
      InputError: the scenario cannot be flown or the controller does not fit.
    """
    body = body or load_body(scenario.body)
    name = controller if isinstance(controller, str) else type(controller).__name__
    if isinstance(controller, str):
        controller = named_controller(controller, scenario, body)
    diagram = make_transit_diagram(scenario, controller, meshcat, body)
    simulator = make_simulator(diagram, scenario)
    if meshcat is not None:
        simulator.set_target_realtime_rate(PLAYBACK_SPEED)  # Slow enough to be watched.
    latest = scenario.arrival.deadline_s + scenario.arrival.dwell_s
    if progress is not silent:

        def monitor(context: Context) -> EventStatus:
            progress(context.get_time() / latest, f"{context.get_time():.0f} s")
            return EventStatus.DidNothing()

        simulator.set_monitor(monitor)
    started = time.perf_counter()
    status = simulator.AdvanceTo(latest)
    if status.reason() == SimulatorStatus.ReturnReason.kEventHandlerFailed:
        raise RuntimeError(status.FormatMessage())
    log = _collect_log(diagram, simulator.get_context(), scenario, body, name, started)
    if meshcat is not None:
        add_flight(meshcat, log)  # To be played again.
    return log


def make_simulator(diagram: Diagram, scenario: Scenario) -> Simulator:
    """A Simulator of a transit diagram: RK5 in equal steps, ready to advance."""
    simulator = Simulator(diagram)
    # Without an accuracy in the Context, events fire at the end of their step.
    simulator.get_mutable_context().SetAccuracy(_EVENT_ACCURACY)
    steps = math.ceil(scenario.control_period_s / _LONGEST_STEP)
    integrator = ResetIntegratorFromFlags(
        simulator, scheme="runge_kutta5", max_step_size=scenario.control_period_s / steps
    )
    # The choice of an adaptive step is no part of the Context: with it, a flight that is gone on
    # with from a cloned Context would differ in its last bits.
    integrator.set_fixed_step_mode(True)
    simulator.Initialize()
    return simulator


def _collect_log(
    diagram: Diagram,
    context: Context,
    scenario: Scenario,
    body: Body,
    controller: str,
    started: float,
) -> FlightLog:
    """Columns of the log from the diagram's log sinks, and the final state as the last row."""

    def column(name: str) -> np.ndarray:
        sink = diagram.GetSubsystemByName(f"log_{name}")
        assert isinstance(sink, VectorLogSink)
        return sink.FindLog(context).data().T

    sink = diagram.GetSubsystemByName("log_state")
    assert isinstance(sink, VectorLogSink)
    times = sink.FindLog(context).sample_times()
    names = {system.get_name() for system in diagram.GetSystems()}
    columns = {name: column(name) for name in ("state", "target", "force", "command")}
    for name in (*_ASKED, "kick"):
        if f"log_{name}" in names:
            columns[name] = column(name)

    end = context.get_time()
    if end > times[-1]:
        # The flight ended between two control steps: its end state, with what was held then.
        times = np.append(times, end)
        columns = {key: np.concatenate([value, value[-1:]]) for key, value in columns.items()}
        craft = diagram.GetSubsystemByName("spacecraft")
        state = craft.GetOutputPort("state").Eval(craft.GetMyContextFromRoot(context))
        columns["state"][-1] = state
        for name in _ASKED:
            if name in columns and name != "decision":
                columns[name][-1] = np.nan

    blank = np.full((len(times), 3), np.nan)
    record = columns.pop("mpc_record", blank.copy())
    columns["disturbance"] = columns["force"] - columns.pop("command")
    columns |= dict(zip(("solve_time", "solve_status", "solve_reason"), record.T, strict=True))
    if "policy_record" in columns:
        record = columns.pop("policy_record")
        columns |= dict(zip(("policy_time", "policy_status"), record.T, strict=True))
    if "intervention_record" in columns:
        record = columns.pop("intervention_record")
        columns |= dict(zip(("intervention", "intervention_reason"), record.T, strict=True))
    if "decision_record" in columns:
        record = columns.pop("decision_record")
        columns |= dict(zip(DECISION_VARIABLES, record.T, strict=True))
        columns["decision"] = columns["decision"][:, 0].astype(np.int8)
    else:
        pilot = 1 if "mpc_force" in columns else 2 if "policy_force" in columns else 0
        columns["decision"] = np.full(len(times), pilot, dtype=np.int8)
    lidar = diagram.GetSubsystemByName("lidar")
    assert isinstance(lidar, PlanarLidar)
    if scenario.log_ranges:
        columns["ranges"] = lidar.frames(times, columns["state"][:, :3], lidar.seed)
    columns = {"mpc_force": blank, "policy_force": blank.copy(), **columns}

    monitor = diagram.GetSubsystemByName("monitor")
    outcome = monitor.GetOutputPort("outcome").Eval(monitor.GetMyContextFromRoot(context))
    # In the goal region at the end, but not for long enough, is no arrival.
    entered = outcome[ENTERED_GOAL]
    dwelt = entered < NEVER and end - entered >= scenario.arrival.dwell_s * (1.0 - 1e-9)
    hold = diagram.GetSubsystemByName("hold")
    attributes = {
        "proxops_version": metadata.version("proxops"),
        "controller": controller,
        "scenario_sha256": hashlib.sha256(dump_scenario(scenario).encode()).hexdigest(),
        "seed": scenario.transit.seed,
        "transit": scenario.transit.index,
        "noise_seed": scenario.noise_seed,
        "force_delay_s": hold.delay if isinstance(hold, DelayedHold) else 0.0,
        "arrival_time_s": float(entered) if dwelt else np.nan,
        "collided": int(outcome[COLLIDED]),
        "keep_out_violations": int(outcome[VIOLATIONS]),
        "wall_s": time.perf_counter() - started,
    }
    if isinstance(lidar, LearnedLidar):
        attributes["lidar_sha256"] = lidar.bundle.sha256
    for system in diagram.GetSystems():
        flying = isinstance(system, NeuralPolicy | EstimateFeedback | HybridController)
        if flying and system.bundle is not None:
            attributes["policy_sha256"] = system.bundle.sha256
    return FlightLog(make_dataset(columns, times, scenario, body, attributes), body)
