"""The transit diagram: plant, lidar, controller, thrusters and monitor as one Drake Diagram."""

from __future__ import annotations

import numpy as np
from pydrake.geometry import Meshcat
from pydrake.systems.framework import (
    Diagram,
    DiagramBuilder,
    LeafSystem,
    OutputPort,
    PortDataType,
    System,
)
from pydrake.systems.primitives import ConstantVectorSource, LogVectorOutput, ZeroOrderHold

from proxops.diagrams.flight.command_chain import add_assurance, add_thrusters
from proxops.diagrams.flight.scenario_systems import make_lidar, make_mpc
from proxops.diagrams.flight.wiring import LIDAR_STREAM, Wiring
from proxops.diagrams.flight.world import add_gravity, add_spacecraft, add_thrust
from proxops.diagrams.logs import CONTROLLER_COLUMNS, KEEP_OUT_TOLERANCE, RESERVED_COLUMNS
from proxops.diagrams.meshcat import LiveView, Scene, add_live_view
from proxops.diagrams.scenario import Body, Scenario, load_body, scenario_transit
from proxops.systems import DelayedHold, FlightMonitor, InputError, PlanarLidar
from proxops.systems.common import LoggedPort

# Input ports of a controller that may remain unconnected.
_OPTIONAL_PORTS = {"enable"}

Signals = dict[str, OutputPort]
"""Output ports that feed a controller, by the names of its input ports."""


def make_transit_diagram(
    scenario: Scenario,
    controller: System | None = None,
    meshcat: Meshcat | None = None,
    body: Body | None = None,
) -> Diagram:
    """Wires all systems that a flight needs into one Diagram.

    ```
    target ──► controller ─► disturbance ─► thrusters ─► hold ─► spacecraft ◄─► gravity, kicks
                 ▲  ▲  ▲     force noise                  │           │
                 │  │  └──────── applied_force ◄──────────┘           │
                 │  └─────────── ranges ◄──── lidar ◄─────────────────┤
                 └────────────── state ◄──────────────────────────────┘
    ```

    Runtime assurance, if the scenario has it, is between controller and disturbance.

    Args:
      scenario: the scenario; its transit gives the start and the target.
      controller: any system with an output port `force` (3), in N in K, and any of the input
        ports `state` (6), `target` (6), `position` (3), `velocity` (3), `ranges` and
        `applied_force` (3). It may offer more: see `fly`. None: the MPC.
      meshcat: shows the flight live, with the controller's plan if it has an output port `plan`
        (abstract Plan).
      body: the body; None: the body that the scenario names.

    Returns:
      A Diagram. Its subsystems are named gravity, spacecraft, lidar, target, controller,
      thrusters, hold and monitor; assurance, disturbance, force_noise and kicks, if the scenario
      has them; and log_NAME for every logged port. Its default Context is the start of the
      transit. The hold is a `DelayedHold` if the controller has a delay.

    Raises:
      InputError: the controller's ports do not fit, or the scenario cannot be flown.
    """
    body = body or load_body(scenario.body)
    wiring = Wiring(DiagramBuilder(), scenario, body, scenario_transit(scenario, body))
    builder = wiring.builder
    controller = make_mpc(scenario, body) if controller is None else controller
    delay = float(getattr(controller, "delay", 0.0))

    craft = add_spacecraft(wiring)
    add_gravity(wiring, craft)
    lidar = wiring.add("lidar", make_lidar(scenario, body, wiring.seed(LIDAR_STREAM)))
    builder.Connect(craft.GetOutputPort("position"), lidar.GetInputPort("position"))
    goal = np.concatenate([wiring.transit.goal, np.zeros(3)])
    target = wiring.add("target", ConstantVectorSource(goal))
    hold = wiring.add("hold", _make_hold(scenario.control_period_s, delay))
    add_thrust(wiring, hold.get_output_port(), craft)
    signals = {
        **{name: craft.GetOutputPort(name) for name in ("state", "position", "velocity")},
        "target": target.get_output_port(),
        "ranges": lidar.GetOutputPort("ranges"),
        "applied_force": hold.get_output_port(),
    }
    command = _add_controller(wiring, controller, signals)
    assured = add_assurance(wiring, command, signals["state"], delay)
    applied = add_thrusters(wiring, assured)
    builder.Connect(applied, hold.get_input_port())
    _add_monitor(wiring, signals)
    _add_logs(wiring, controller, signals, {"force": applied, "command": assured})
    if meshcat is not None:
        _add_view(wiring, meshcat, lidar, controller, {**signals, "force": applied})
    diagram = builder.Build()
    diagram.set_name("transit")
    return diagram


def logged_ports(controller: System) -> dict[str, LoggedPort]:
    """Gives the ports that a controller offers to the log, by the names of their columns.

    Raises:
      InputError: a name is not fit for a column, or a port does not have the size of the log's
        column of this name.
    """
    offered = getattr(controller, "logged_ports", None)
    ports: dict[str, LoggedPort] = {} if offered is None else offered()
    for name, logged in ports.items():
        size = CONTROLLER_COLUMNS.get(name)
        if not name.isidentifier() or (size is None and name in RESERVED_COLUMNS):
            raise InputError(
                f"controller {controller.get_name()!r}: no port can be logged as {name!r}; give "
                "another name, of letters, digits and underscores"
            )
        if size is not None and size != logged.port.size():
            raise InputError(
                f"controller {controller.get_name()!r} logs {name!r} with {logged.port.size()} "
                f"components, but the log's column of this name has {size}"
            )
    return ports


def _make_hold(period: float, delay: float) -> LeafSystem:
    return DelayedHold(period, delay, 3) if delay > 0.0 else ZeroOrderHold(period, 3)


def _add_controller(wiring: Wiring, controller: System, signals: Signals) -> OutputPort:
    """Adds the controller and connects its input ports by name; returns its force.

    Raises:
      InputError: the controller has no output `force` (3), or an input port that nothing feeds.
    """
    if not controller.get_name():
        controller.set_name("controller")
    wiring.builder.AddSystem(controller)
    outputs = [controller.get_output_port(i) for i in range(controller.num_output_ports())]
    names = [port.get_name() for port in outputs]
    if "force" not in names or controller.GetOutputPort("force").size() != 3:
        raise InputError(
            f"controller {controller.get_name()!r} needs an output port 'force' of size 3; "
            f"it has {', '.join(names) or 'none'}"
        )
    for i in range(controller.num_input_ports()):
        port = controller.get_input_port(i)
        name = port.get_name()
        if name in signals:
            if port.size() != signals[name].size():
                raise InputError(
                    f"controller {controller.get_name()!r}: input port {name!r} has size "
                    f"{port.size()}, but the signal of this name has size {signals[name].size()}"
                )
            wiring.builder.Connect(signals[name], port)
        elif name not in _OPTIONAL_PORTS:
            raise InputError(
                f"controller {controller.get_name()!r}: nothing feeds input port {name!r}; "
                f"the signals are {', '.join(signals)}"
            )
    return controller.GetOutputPort("force")


def _add_monitor(wiring: Wiring, signals: Signals) -> None:
    """Adds the monitor of arrival, collision and violations of the keep-out ellipsoid."""
    arrival = wiring.scenario.arrival
    monitor = wiring.add(
        "monitor",
        FlightMonitor(
            wiring.body.gravity_field,
            wiring.body.keep_out_semi_axes,
            radius=arrival.radius_m,
            speed=arrival.speed_m_s,
            dwell=arrival.dwell_s,
            tolerance=KEEP_OUT_TOLERANCE,
            period=wiring.scenario.control_period_s,
        ),
    )
    for name in ("state", "target"):
        wiring.builder.Connect(signals[name], monitor.GetInputPort(name))


def _add_logs(wiring: Wiring, controller: System, signals: Signals, forces: Signals) -> None:
    """Adds a log sink for each signal of the log, and for each port that the controller offers.

    The sinks record once a control step. The lidar has no sink: its frames are a function of time
    and position, so they are computed from the log after the flight. The column `force` is the
    force that the hold takes over at this step and holds until the next.
    """
    builder, period = wiring.builder, wiring.scenario.control_period_s
    logged = {"state": signals["state"], "target": signals["target"], **forces}
    for system, port, name in (
        ("assurance", "intervention", "intervention_record"),
        ("kicks", "next_acceleration", "kick"),
    ):
        if builder.HasSubsystemNamed(system):
            logged[name] = builder.GetSubsystemByName(system).GetOutputPort(port)
    logged |= {name: each.port for name, each in logged_ports(controller).items()}
    for name, port in logged.items():
        LogVectorOutput(port, builder, publish_period=period).set_name(f"log_{name}")


def _add_view(
    wiring: Wiring, meshcat: Meshcat, lidar: PlanarLidar, controller: System, signals: Signals
) -> None:
    """Draws the flight live, with the controller's plan if it has one."""
    seen = {name: signals[name] for name in ("position", "ranges", "force")}
    for i in range(controller.num_output_ports()):
        port = controller.get_output_port(i)
        abstract = port.get_data_type() == PortDataType.kAbstractValued
        if port.get_name() == "plan" and abstract:
            seen["plan"] = port
    scenario = wiring.scenario
    scene, limit = Scene(meshcat, wiring.body), scenario.spacecraft.thrust_limit_n
    view = LiveView(scene, lidar, limit, scenario.control_period_s, with_plan="plan" in seen)
    add_live_view(wiring.builder, wiring.transit, view, seen)
