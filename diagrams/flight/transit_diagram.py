"""The transit diagram: plant, lidar, controller, thrusters and monitor as one Drake Diagram."""

from __future__ import annotations

import numpy as np
from pydrake.geometry import Meshcat
from pydrake.systems.framework import (
    BasicVector,
    Diagram,
    DiagramBuilder,
    LeafSystem,
    NumericParameterIndex,
    OutputPort,
    PortDataType,
    System,
)
from pydrake.systems.primitives import LogVectorOutput, ZeroOrderHold

from proxops.diagrams.flight.command_chain import add_assurance, add_disturbances, add_thrusters
from proxops.diagrams.flight.navigation import (
    STATE_PORTS,
    add_command_axes,
    add_navigation,
    known_motion,
    navigation_ports,
    needs_navigation,
)
from proxops.diagrams.flight.scenario_systems import make_events, make_lidar, make_mpc
from proxops.diagrams.flight.wiring import LIDAR_STREAM, Wiring
from proxops.diagrams.flight.world import (
    add_accelerations,
    add_attitude,
    add_spacecraft,
    add_thrust,
)
from proxops.diagrams.logs import CONTROLLER_COLUMNS, RESERVED_COLUMNS
from proxops.diagrams.meshcat import LiveView, Scene, add_live_view
from proxops.diagrams.scenario import (
    Body,
    Scenario,
    TrueBody,
    World,
)
from proxops.systems import DelayedHold, FlightMonitor, FrameDelay, InputError, PlanarLidar
from proxops.systems.common import LoggedPort, check_port_size, force_port, offers_of

# Input ports of a controller that may remain unconnected.
_OPTIONAL_PORTS = {"enable", "covariance"}
PARTS = (
    "acceleration_hold", "accelerations", "actual_thrust", "assurance", "attitude",
    "attitude_hold", "command_axes", "command_hold", "command_limits", "disturbance",
    "force_noise", "frame_delay", "gravity", "hold", "kicks", "lidar", "live_view", "monitor",
    "navigation", "navigation_parts", "spacecraft", "target", "thrusters",
    "unexplained_acceleration",
)  # fmt: skip
"""Names of all parts that a diagram may have beside the controller and the log sinks."""

Signals = dict[str, OutputPort]
"""Output ports that feed a controller, by the names of its input ports."""


class _Target(LeafSystem):
    """The goal (6,), a parameter of the Context.

    Drake's `ConstantVectorSource` counts as changed when time passes, and so does all that is
    cached for a goal. The output port is named as there.
    """

    def __init__(self, goal: np.ndarray):
        super().__init__()
        index = NumericParameterIndex(self.DeclareNumericParameter(BasicVector(goal)))
        self.DeclareVectorOutputPort(
            name="y0",
            size=goal.size,
            calc=lambda context, output: output.SetFromVector(
                context.get_numeric_parameter(index).value()
            ),
            prerequisites_of_calc={self.numeric_parameter_ticket(index)},
        )


def add_transit(
    builder: DiagramBuilder,
    scenario: Scenario,
    controller: System | None = None,
    meshcat: Meshcat | None = None,
    body: Body | None = None,
    true_body: TrueBody | None = None,
) -> Diagram:
    """Adds a transit to a diagram of one's own: `make_transit_diagram`, under the name `transit`.

    ```
    ┌─────────┐
    │         ├─► true_state (6), m and m/s, K
    │         ├─► state (6), as known on board; NaN: unknown
    │ transit ├─► force (3), N, S
    │         ├─► ranges (planes * rays), m; +inf: no return
    └─────────┴─► covariance (81)
    ```

    `state` is what controllers are told: the navigation's estimate, or the true state where there
    is no navigation. Then `covariance`, the navigation's, is missing too. Both are of a control
    step: read them at whole multiples of the period. `force` is the command that is held now; at a
    control step a log sink still sees the last one. `ranges` are the frame as it is received.

    The transit flies as with `fly`, and its monitor ends the simulation of the whole diagram. It
    flies so bit for bit in a Simulator that `make_simulator(diagram, scenario)` makes for the whole
    diagram, if nothing else in that has events between control steps, which cut the steps of the
    integration. `let_go(diagram, None)` gives the memory back.

    Args:
      builder: of the diagram. Systems of a diagram have different names: give a second transit
        another one (`set_name`).
      scenario, controller, meshcat, body, true_body: as in `make_transit_diagram`.

    Returns:
      The transit diagram.

    Raises:
      UnflyableWorldError: the flight cannot begin in its world.
      InputError: the controller's ports do not fit, or the scenario cannot be flown.
    """
    return builder.AddSystem(make_transit_diagram(scenario, controller, meshcat, body, true_body))


def make_transit_diagram(
    scenario: Scenario,
    controller: System | None = None,
    meshcat: Meshcat | None = None,
    body: Body | None = None,
    true_body: TrueBody | None = None,
) -> Diagram:
    """Wires all systems that a flight needs into one Diagram.

    ```
    target ─► controller ─► command axes ─► disturbance ─► thrusters ─► hold ─► actual thrust
               ▲    ▲          ▲            force noise               │           │
               │    │          │ attitude                             │           ▼
               │  state ◄─ navigation ◄────────── commanded_force ◄───┘       spacecraft ◄─ gravity
               │               ▲                                                  │      and others
               └── ranges ◄────┴───────── frame delay ◄── lidar ◄─────────────────┘
    ```

    The navigation knows ranges and commands alone; `state`, `position` and `velocity` of controller
    and runtime assurance are what it makes of them. With `navigation: !TrueState {}` they are the
    true ones; then, and where nothing on board reads them, navigation and command axes are missing.
    Runtime assurance, if the scenario has it, follows the controller. The controller is told its
    own command after assurance and thrust limit, in S, not what disturbs it. Delay, actual thrust,
    the attitude that turns it and the lidar, and accelerations are there only if truth needs them.

    Args:
      scenario: the scenario; its transit gives the start and the target. If it has dispersions, the
        world of its transit is drawn from them.
      controller: any system with an output port `force` (3), in N in K, and any of the input
        ports `state` (6), `target` (6), `position` (3), `velocity` (3), `ranges`, `covariance` (81)
        and `commanded_force` (3). It may offer more: see `fly`. None: the MPC.
      meshcat: shows the flight live, with the controller's plan if it has an output port `plan`
        (abstract Plan).
      body: the body as believed; None: the body that the scenario names.
      true_body: the body as it is; None: it is made from `scenario.truth`.

    Returns:
      A Diagram, named in its parts: gravity, spacecraft, lidar, target, controller (or as it calls
      itself), thrusters, hold, monitor; and, if the flight has them, navigation, navigation_parts,
      command_axes, assurance, disturbance, force_noise, command_limits, command_hold, kicks,
      attitude, attitude_hold, actual_thrust, unexplained_acceleration, acceleration_hold,
      accelerations, frame_delay, live_view, and log_NAME for every logged port. Its output ports
      are those that `add_transit` draws. Its default Context is the start of the transit.

    Raises:
      UnflyableWorldError: the flight cannot begin in its world.
      InputError: the controller's ports do not fit, or the scenario cannot be flown.
    """
    return diagram_of(World.of(scenario, body, true_body), controller, meshcat)


def diagram_of(
    world: World, controller: System | None = None, meshcat: Meshcat | None = None
) -> Diagram:
    """Wires all systems that the flight of a world needs: see `make_transit_diagram`."""
    wiring = Wiring(DiagramBuilder(), world)
    scenario = world.scenario
    controller = _controller(controller, wiring)
    delay = offers_of(controller).delay
    craft = add_spacecraft(wiring)
    add_accelerations(wiring, craft)
    attitude = add_attitude(wiring)
    lidar = _add_lidar(wiring, craft.GetOutputPort("position"), attitude)
    goal = np.concatenate([world.transit.goal, np.zeros(3)])
    target = wiring.add("target", _Target(goal))
    hold = wiring.add("hold", _make_hold(scenario.control_period_s, delay))
    add_thrust(wiring, hold.GetOutputPort("y"), attitude, craft)
    told = hold
    if scenario.disturbance is not None or scenario.force_noise is not None:
        told = wiring.add("command_hold", _make_hold(scenario.control_period_s, delay))
    signals = {
        **{name: craft.GetOutputPort(name) for name in STATE_PORTS},
        "target": target.get_output_port(),
        "ranges": _received(wiring, lidar),
        "commanded_force": told.GetOutputPort("y"),
    }
    command = _add_on_board(wiring, controller, signals, told)
    forces = {"command": command, "force": _hold_command(wiring, command, hold, told)}
    _add_monitor(wiring, signals)
    true = {} if attitude is None else {"attitude": attitude}
    true |= {"mass": craft.GetOutputPort("mass")} if craft.HasOutputPort("mass") else {}
    _add_logs(wiring, controller, signals, forces | true)
    if meshcat is not None:
        _add_view(wiring, meshcat, lidar, controller, signals | forces)
    return _built(wiring, signals, hold)


def _controller(given: System | None, wiring: Wiring) -> System:
    """The controller that is given, or the MPC; raises `InputError` if it is no System."""
    if given is None:
        return make_mpc(wiring.world.belief, wiring.world.body)
    if not isinstance(given, System):
        raise InputError(
            f"the controller is a {type(given).__name__}, not a System; named_controller(name, "
            "scenario, body) makes one from a name"
        )
    return given


def logged_ports(controller: System) -> dict[str, LoggedPort]:
    """Gives the ports that a controller offers to the log, by the names of their columns.

    Raises:
      InputError: a name is not fit for a column, or a port does not have the size of the log's
        column of this name.
    """
    ports = offers_of(controller).logged_ports
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


def _add_on_board(
    wiring: Wiring, controller: System, signals: Signals, told: LeafSystem
) -> OutputPort:
    """Adds controller and runtime assurance, and the navigation if they need one.

    Args:
      wiring: the diagram.
      controller: the controller.
      signals: what feeds it, with the true motion.
      told: the hold of the command that the controller is told.

    Returns:
      The command (3,) in N in S.
    """
    delay = told.delay if isinstance(told, DelayedHold) else 0.0
    if not needs_navigation(wiring.scenario, controller):
        command = _add_controller(wiring, controller, signals)
        return add_assurance(wiring, command, signals, delay)
    # A command that acts late acts over a part of two periods.
    acted = told.GetOutputPort("mean" if delay > 0.0 else "y")
    navigation = add_navigation(wiring, signals["ranges"], acted)
    known = signals | known_motion(wiring, navigation)
    command = _add_controller(wiring, controller, known)
    command = add_assurance(wiring, command, known, delay)
    return add_command_axes(wiring, command, navigation)


def _hold_command(
    wiring: Wiring, command: OutputPort, hold: LeafSystem, told: LeafSystem
) -> OutputPort:
    """Connects a command to the hold of the thrusters and to that of what the controller is told.

    Returns:
      The force that the thrusters are to give: the command, disturbed and limited.
    """
    force = add_thrusters(wiring, add_disturbances(wiring, command), "thrusters")
    wiring.builder.Connect(force, hold.get_input_port())
    if told is not hold:
        limited = add_thrusters(wiring, command, "command_limits")
        wiring.builder.Connect(limited, told.get_input_port())
    return force


def _add_lidar(wiring: Wiring, position: OutputPort, attitude: OutputPort | None) -> PlanarLidar:
    """Adds the true lidar."""
    seed = wiring.seed(LIDAR_STREAM)
    lidar = wiring.add("lidar", make_lidar(wiring.scenario, wiring.world.true_body.shape, seed))
    wiring.builder.Connect(position, lidar.GetInputPort("position"))
    if attitude is not None:
        wiring.builder.Connect(attitude, lidar.GetInputPort("attitude"))
    return lidar


def _received(wiring: Wiring, lidar: PlanarLidar) -> OutputPort:
    """Gives the ranges as they are received: some steps late, if the lidar has a latency."""
    ranges, steps = lidar.GetOutputPort("ranges"), wiring.scenario.truth.lidar.latency_steps
    if steps == 0:
        return ranges
    delay = wiring.add(
        "frame_delay", FrameDelay(ranges.size(), steps, wiring.scenario.control_period_s)
    )
    wiring.builder.Connect(ranges, delay.GetInputPort("ranges"))
    return delay.GetOutputPort("ranges")


def _make_hold(period: float, delay: float) -> LeafSystem:
    return DelayedHold(period, delay, 3) if delay > 0.0 else ZeroOrderHold(period, 3)


def _add_controller(wiring: Wiring, controller: System, signals: Signals) -> OutputPort:
    """Adds the controller and connects its input ports by name; returns its force.

    Raises:
      InputError: the controller is called as a part of the diagram is, or has no output `force`
        (3), or an input port that nothing feeds.
    """
    if not controller.get_name():
        controller.set_name("controller")
    if controller.get_name() in PARTS or controller.get_name().startswith("log_"):
        raise InputError(
            f"controller {controller.get_name()!r}: a part of the diagram is called so; give the "
            "controller another name"
        )
    wiring.builder.AddSystem(controller)
    force = force_port(controller)
    for i in range(controller.num_input_ports()):
        port = controller.get_input_port(i)
        name = port.get_name()
        if name in signals:
            check_port_size(controller, port, signals[name].size())
            wiring.builder.Connect(signals[name], port)
        elif name not in _OPTIONAL_PORTS:
            raise InputError(
                f"controller {controller.get_name()!r}: nothing feeds input port {name!r}; "
                f"the signals are {', '.join(signals)}"
            )
    return force


def _add_monitor(wiring: Wiring, signals: Signals) -> None:
    """Adds the monitor of arrival, collision and violations of the keep-out ellipsoid."""
    scenario = wiring.scenario
    events = make_events(scenario, wiring.world.body, wiring.world.true_body.gravity_field)
    monitor = wiring.add("monitor", FlightMonitor(events, scenario.control_period_s))
    for name in ("state", "target"):
        wiring.builder.Connect(signals[name], monitor.GetInputPort(name))


def _add_logs(wiring: Wiring, controller: System, signals: Signals, forces: Signals) -> None:
    """Adds a log sink for each signal of the log, and for each port that the controller offers.

    The sinks record once a control step. The lidar has no sink: see `KeptFrames`. The column
    `force` is the force that the hold takes over at this step and holds until the next.
    """
    builder, period = wiring.builder, wiring.scenario.control_period_s
    logged = {"state": signals["state"], "target": signals["target"], **forces}
    for system, port, name in (
        ("assurance", "intervention", "intervention_record"),
        ("assurance", "margin", "assurance_record"),
        ("kicks", "next_acceleration", "kick"),
    ):
        if builder.HasSubsystemNamed(system):
            logged[name] = builder.GetSubsystemByName(system).GetOutputPort(port)
    if builder.HasSubsystemNamed("navigation"):
        logged |= navigation_ports(builder.GetSubsystemByName("navigation"))
    logged |= {name: each.port for name, each in logged_ports(controller).items()}
    for name, port in logged.items():
        LogVectorOutput(port, builder, publish_period=period).set_name(f"log_{name}")


def _built(wiring: Wiring, signals: Signals, hold: LeafSystem) -> Diagram:
    """Builds the diagram, with the output ports that `add_transit` draws."""
    known = {"state": signals["state"]}
    if wiring.builder.HasSubsystemNamed("navigation"):
        navigation = wiring.builder.GetSubsystemByName("navigation")
        known = {name: navigation.GetOutputPort(name) for name in ("state", "covariance")}
    told = {"force": hold.GetOutputPort("y"), "ranges": signals["ranges"]}
    for name, port in ({"true_state": signals["state"]} | told | known).items():
        wiring.builder.ExportOutput(port, name)
    diagram = wiring.builder.Build()
    diagram.set_name("transit")
    return diagram


def _add_view(
    wiring: Wiring, meshcat: Meshcat, lidar: PlanarLidar, controller: System, signals: Signals
) -> None:
    """Draws the flight live, with the controller's plan if it has one."""
    seen = {name: signals[name] for name in ("position", "ranges", "force")}
    if controller.HasOutputPort("plan"):
        plan = controller.GetOutputPort("plan")
        if plan.get_data_type() == PortDataType.kAbstractValued:
            seen["plan"] = plan
    navigated = wiring.builder.HasSubsystemNamed("navigation")
    if navigated:
        navigation = wiring.builder.GetSubsystemByName("navigation")
        for name in ("state", "covariance", "return_use"):
            seen[f"navigation_{name}"] = navigation.GetOutputPort(name)
    scenario = wiring.scenario
    scene = Scene(meshcat, wiring.world.body, wiring.world.true_body)
    limit = scenario.spacecraft.thrust_limit_n
    view = LiveView(
        scene, lidar, limit, scenario.control_period_s, "plan" in seen, with_navigation=navigated
    )
    add_live_view(wiring.builder, wiring.world.transit, view, seen)
