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
    PortDataType,
    System,
)
from pydrake.systems.primitives import ConstantVectorSource, VectorLogSink, ZeroOrderHold

from proxops.diagrams.flight.named_controllers import named_controller
from proxops.diagrams.flight.on_board import STATE_PORTS, add_on_board
from proxops.diagrams.flight.rigid_body import add_actuation, add_attitude_sensors
from proxops.diagrams.flight.touching import add_touch, make_touch_controller
from proxops.diagrams.flight.wiring import Signals, Wiring
from proxops.diagrams.flight.world import (
    add_accelerations,
    add_attitude,
    add_lidar,
    add_monitor,
    add_spacecraft,
    add_thrust,
    hold_command,
    received,
    without_moons,
)
from proxops.diagrams.meshcat import (
    LiveView,
    RigidView,
    Scene,
    add_site,
    part_shown,
    prepare_live_view,
)
from proxops.diagrams.scenario import Body, Scenario, TouchAndGoConfig, TrueBody, World
from proxops.systems import DelayedHold, InputError, PlanarLidar, RigidSpacecraft
from proxops.systems.common import offers_of
from proxops.systems.vehicle import FreshHold, Reckoning


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
      builder: of the diagram. Systems of a diagram have different names: give the first transit
        another one (`set_name`) before a second is added.
      scenario, controller, meshcat, body, true_body: as in `make_transit_diagram`.

    Returns:
      The transit diagram.

    Raises:
      UnflyableWorldError: the flight cannot begin in its world.
      InputError: the controller's ports do not fit, the scenario cannot be flown, or there is a
        system of the name `transit`.
    """
    if builder.HasSubsystemNamed("transit"):
        raise InputError(
            'there is a system "transit": give that another name, as transit.set_name("first")'
        )
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
        and `commanded_force` (3); at a rigid spacecraft also `body_attitude` (4). There an output
        port `state` (6), of where the controller itself takes it to be, is what pointing goes by.
        It may offer more: see `fly`. None: the MPC.
      meshcat: shows the flight live, with the controller's plan if it has an output port `plan`
        (abstract Plan).
      body: the body as believed; None: the body that the scenario names.
      true_body: the body as it is; None: it is made from `scenario.truth`.

    Returns:
      A Diagram, named in its parts: gravity, spacecraft, lidar, target, controller (or as it calls
      itself), thrusters, hold, monitor; and, if the flight has them, navigation, navigation_parts,
      command_axes, assurance, disturbance, force_noise, command_limits, command_hold, kicks,
      moons, moon_mask, sunlight, attitude, attitude_hold, actual_thrust, acceleration_hold,
      unexplained_acceleration, accelerations, frame_delay, live_view, and log_NAME for every logged
      port. Its output ports are those that `add_transit` draws. Its default Context is the start of
      the transit.

    Raises:
      UnflyableWorldError: the flight cannot begin in its world.
      InputError: the controller's ports do not fit, or the scenario cannot be flown.
    """
    return diagram_of(World.of(scenario, body, true_body), controller, meshcat)


def diagram_of(
    world: World, controller: System | None = None, meshcat: Meshcat | None = None
) -> Diagram:
    """Wires all systems that the flight of a world needs: see `make_transit_diagram`."""
    if controller is None:
        return diagram_of(world, named_controller("mpc", world.belief, world.body), meshcat)
    wiring, scenario = Wiring(DiagramBuilder(), world), world.scenario
    if not isinstance(controller, System):
        raise InputError(_no_system(controller))
    if not isinstance(meshcat, Meshcat | None):
        raise InputError(
            f"meshcat is {meshcat!r}, not a Meshcat: give pydrake.geometry.StartMeshcat()"
        )
    delay, period = offers_of(controller).delay, scenario.control_period_s
    craft = add_spacecraft(wiring)
    add_accelerations(wiring, craft)
    attitude = add_attitude(wiring, craft)
    lidar = add_lidar(wiring, craft.GetOutputPort("position"), attitude)
    task, touch = scenario.task, None
    touches = isinstance(task, TouchAndGoConfig)
    if touches and task.transit:
        touch = make_touch_controller(world.belief, world.body)
    goal = np.concatenate([world.transit.goal, np.zeros(3)])
    target = wiring.add("target", _Target(goal)).get_output_port()
    aim, flies_touch = target, touch or controller
    if touches and flies_touch.HasOutputPort("target"):
        aim = flies_touch.GetOutputPort("target")  # It goes from phase to phase.
    wiring.logged["target"] = aim
    hold = wiring.add("hold", _make_hold(period, delay))
    command_hold = hold
    if scenario.disturbance is not None or scenario.force_noise is not None:
        command_hold = wiring.add("command_hold", _make_hold(period, delay))
    true = {
        **{name: craft.GetOutputPort(name) for name in STATE_PORTS},
        "target": target,
        "ranges": received(wiring, lidar),
        "commanded_force": command_hold.GetOutputPort("y"),
        **(add_touch(wiring) if touches else {}),
    }
    sensed: Signals = {}
    if isinstance(craft, RigidSpacecraft):
        sensed = add_attitude_sensors(wiring, craft)
        given = ("commanded_force", "commanded_thrust", "force_apart", "force_lead")
        true |= {name: sensed[name] for name in ("body_attitude", *given)}
    else:
        add_thrust(wiring, hold.GetOutputPort("y"), attitude, craft)
    true["ranges"] = without_moons(wiring, true["ranges"], sensed.get("body_attitude"))
    command, known = add_on_board(wiring, controller, true, command_hold, touch)
    hold_command(wiring, command, hold, command_hold)
    if isinstance(craft, RigidSpacecraft):
        acting = hold.GetOutputPort("y") if delay > 0.0 else wiring.logged["force"]
        if touches:  # The arm points along the normal, wherever the spacecraft is.
            place: System = wiring.add("home", ConstantVectorSource(goal[:3]))
        else:  # Frames come at control steps alone, and guidance asks at attitude steps.
            own = controller.HasOutputPort("state")
            state = controller.GetOutputPort("state") if own else known["state"]
            held = wiring.add("state_sample", FreshHold(period, 6), u=state)
            place = wiring.add("reckoning", Reckoning(period), state=held.get_output_port())
        add_actuation(wiring, craft, acting, {**sensed, "position": place.get_output_port()})
        if touches:
            estimator = wiring.builder.GetSubsystemByName("torque_estimator")
            outside = estimator.GetInputPort("outside_force")
            wiring.builder.Connect(true["head_force"], outside)
        if flies_touch.HasInputPort("failed"):
            failed = wiring.logged["failed_thrusters"]
            wiring.builder.Connect(failed, flies_touch.GetInputPort("failed"))
    add_monitor(wiring, true["state"], aim)
    # The lidar has no sink: see `KeptFrames`. The column `force` is the force that the hold takes
    # over at this step and holds until the next.
    for name, port in wiring.logged.items():
        wiring.add(f"log_{name}", VectorLogSink(port.size(), publish_period=period), data=port)
    if meshcat is not None:
        _add_view(wiring, meshcat, lidar, controller, true)
    outputs = {"true_state": true["state"], "force": hold.GetOutputPort("y")}
    outputs |= {name: known[name] for name in ("ranges", "state", "covariance") if name in known}
    for name, port in outputs.items():
        wiring.builder.ExportOutput(port, name)
    diagram = wiring.builder.Build()
    diagram.set_name("transit")
    return diagram


def _no_system(controller: object) -> str:
    """Says what a controller is that is no System, and how one is made."""
    how = "named_controller(name, scenario, load_body(scenario.body)) makes one from a name"
    if isinstance(controller, type):
        how = "make one of this class"
    elif callable(controller):
        how = "call it with what it takes, such as (scenario, load_body(scenario.body))"
    return f"the controller is {controller!r}, not a System: {how}"


def _make_hold(period: float, delay: float) -> LeafSystem:
    return DelayedHold(period, delay, 3) if delay > 0.0 else ZeroOrderHold(period, 3)


def _add_view(
    wiring: Wiring, meshcat: Meshcat, lidar: PlanarLidar, controller: System, true: Signals
) -> None:
    """Draws the flight live, with the controller's plan if it has one."""
    seen = {"position": true["position"], "ranges": true["ranges"], "force": wiring.logged["force"]}
    if controller.HasOutputPort("plan"):
        plan = controller.GetOutputPort("plan")
        if plan.get_data_type() == PortDataType.kAbstractValued:
            seen["plan"] = plan
    navigated = "navigation_state" in wiring.logged
    if navigated:
        navigation = wiring.builder.GetSubsystemByName("navigation")
        for name in ("state", "covariance", "return_use"):
            seen[f"navigation_{name}"] = navigation.GetOutputPort(name)
    world, scenario, rigid = wiring.world, wiring.scenario, None
    scene = Scene(meshcat, world.body, world.true_body, part_shown(scenario))
    if scenario.is_rigid:
        rigid = RigidView(scene, scenario)
        seen |= {name: wiring.logged[name] for name in ("attitude", "on_times")}
    limit, period = scenario.spacecraft.thrust_limit_n, scenario.control_period_s
    view = LiveView(scene, lidar, limit, period, "plan" in seen, navigated, rigid)
    prepare_live_view(view, world.transit)
    add_site(scene, scenario)
    wiring.add("live_view", view, **seen)
