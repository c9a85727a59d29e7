"""The wiring: world, sensor, controller, disturbance, hold and plant as one Drake Diagram."""

from __future__ import annotations

import numpy as np
from pydrake.geometry import Meshcat
from pydrake.systems.framework import Diagram, DiagramBuilder, PortDataType, System
from pydrake.systems.primitives import (
    Adder,
    ConstantVectorSource,
    LogVectorOutput,
    MatrixGain,
    ZeroOrderHold,
)

from proxops.diagrams.flight.estimate_feedback import EstimateFeedback
from proxops.diagrams.flight.hybrid_controller import HybridController
from proxops.diagrams.flight.scenario_systems import make_backup, make_lidar, make_mpc
from proxops.diagrams.logs import KEEP_OUT_TOLERANCE
from proxops.diagrams.meshcat import LiveView, Scene, add_live_view
from proxops.diagrams.scenario import Body, Scenario, load_body, scenario_transit
from proxops.systems import (
    DelayedHold,
    FlightMonitor,
    ForceNoise,
    GravityField,
    InputError,
    ModelPredictiveController,
    NeuralPolicy,
    PolyhedralGravity,
    RandomWalkDisturbance,
    RuntimeAssurance,
    Spacecraft,
    VelocityKicks,
)
from proxops.systems.common import derived_seed
from proxops.systems.vehicle import Thrusters

# Streams of derived seeds.
_LIDAR_STREAM, _DISTURBANCE_STREAM, _NOISE_STREAM, _KICKS_STREAM = range(4)
# Input ports of a controller that may stay unconnected.
_OPTIONAL_PORTS = {"enable"}


def make_transit_diagram(
    scenario: Scenario,
    controller: System | None = None,
    meshcat: Meshcat | None = None,
    body: Body | None = None,
) -> Diagram:
    """Everything that a flight needs, wired: set nothing, simulate.

    ```
    target ──► controller ─► disturbance ─► thrusters ─► hold ─► spacecraft ◄─► gravity, kicks
                 ▲  ▲  ▲     force noise                  │           │
                 │  │  └──────── applied_force ◄──────────┘           │
                 │  └─────────── ranges ◄──── lidar ◄─────────────────┤
                 └────────────── state ◄──────────────────────────────┘
    ```

    Runtime assurance, if the scenario has it, stands between controller and disturbance.

    Args:
      scenario: what is flown; its transit sets the start and the target.
      controller: any system with an output port `force` (3), in N in K, and any of the input
        ports `state` (6), `target` (6), `position` (3), `velocity` (3), `ranges` and
        `applied_force` (3). None: the expert.
      meshcat: draws the flight live, with the controller's plan if it has an output port `plan`
        (abstract Plan).
      body: None: the one that the scenario names.

    Returns:
      A Diagram whose subsystems are named gravity, spacecraft, lidar, target, controller,
      assurance, disturbance, force_noise and kicks (those there are), thrusters, hold, monitor, and
      log_NAME for every logged port.
      The Context that it makes by default starts the scenario's transit. The hold is a
      `DelayedHold` where the expert flies with a delay.

    Raises:
      InputError: the controller's ports do not fit, or the scenario cannot be flown.
    """
    body = body or load_body(scenario.body)
    transit = scenario_transit(scenario, body)
    pilot: System = make_mpc(scenario, body) if controller is None else controller
    if not pilot.get_name():
        pilot.set_name("controller")
    period = scenario.control_period_s
    seeds = (scenario.noise_seed, transit.seed, transit.index)
    builder = DiagramBuilder()

    def add(name: str, system: System):
        return builder.AddNamedSystem(name, system)

    true = scenario.mismatch
    true_field = body.gravity_field
    if true.gravity != 1.0:
        true_field = GravityField(body.shape, mass=true.gravity * true_field.mass)
    gravity = add("gravity", PolyhedralGravity(true_field))
    start = np.concatenate([transit.start, transit.start_velocity])
    mass = true.mass * scenario.spacecraft.mass_kg
    craft = add("spacecraft", Spacecraft(mass, body.spin_rate, start))
    craft_ports = {port: craft.GetOutputPort(port) for port in ("state", "position", "velocity")}
    lidar = add("lidar", make_lidar(scenario, body, derived_seed(*seeds, _LIDAR_STREAM)))
    target = add("target", ConstantVectorSource(np.concatenate([transit.goal, np.zeros(3)])))
    delay = pilot.delay if isinstance(pilot, ModelPredictiveController) else 0.0
    hold = add("hold", DelayedHold(period, delay, 3) if delay > 0.0 else ZeroOrderHold(period, 3))
    builder.AddSystem(pilot)

    builder.Connect(craft_ports["position"], gravity.GetInputPort("position"))
    pull = gravity.GetOutputPort("acceleration")
    kicks = None
    if scenario.kicks is not None:
        kicks = add(
            "kicks",
            VelocityKicks(
                velocity_std=scenario.kicks.velocity_std_m_s,
                mean_interval=scenario.kicks.mean_interval_s,
                period=period,
                seed=derived_seed(*seeds, _KICKS_STREAM),
            ),
        )
        kicked = add("gravity_and_kicks", Adder(2, 3))
        builder.Connect(pull, kicked.get_input_port(0))
        builder.Connect(kicks.GetOutputPort("acceleration"), kicked.get_input_port(1))
        pull = kicked.get_output_port()
    builder.Connect(pull, craft.GetInputPort("gravity"))
    thrust = hold
    if true.thrust != 1.0:
        thrust = add("thrust_mismatch", MatrixGain(true.thrust * np.eye(3)))
        builder.Connect(hold.get_output_port(), thrust.get_input_port())
    builder.Connect(thrust.get_output_port(), craft.GetInputPort("force"))
    builder.Connect(craft_ports["position"], lidar.GetInputPort("position"))

    sources = {
        **craft_ports,
        "target": target.get_output_port(),
        "ranges": lidar.GetOutputPort("ranges"),
        "applied_force": hold.get_output_port(),
    }
    _connect_controller(builder, pilot, sources)
    command = assured = pilot.GetOutputPort("force")
    assurance = None
    if scenario.assurance is not None:
        if delay > 0.0:
            raise InputError(
                "runtime assurance can't fly with mpc.solve_delay_s: it changes a command for the "
                "period from now on, and this one would act later; set either to its default"
            )
        backup = make_backup(scenario, body, scenario.assurance)
        assurance = add("assurance", RuntimeAssurance(backup))
        builder.Connect(craft_ports["state"], assurance.GetInputPort("state"))
        builder.Connect(command, assurance.GetInputPort("force"))
        assured = assurance.GetOutputPort("force")
    applied = assured
    if scenario.disturbance is not None:
        settings = scenario.disturbance
        disturbance = add(
            "disturbance",
            RandomWalkDisturbance(
                thrust_limit=scenario.spacecraft.thrust_limit_n,
                reset_period=settings.reset_period_s,
                max_relative_magnitude=settings.max_relative_magnitude,
                increment_std=settings.increment_std_n,
                period=period,
                seed=derived_seed(*seeds, _DISTURBANCE_STREAM),
            ),
        )
        builder.Connect(assured, disturbance.GetInputPort("force"))
        applied = disturbance.GetOutputPort("force")
    if scenario.force_noise is not None:
        noise = add(
            "force_noise",
            ForceNoise(
                thrust_limit=scenario.spacecraft.thrust_limit_n,
                std=scenario.force_noise.std_n,
                correlation_time=scenario.force_noise.correlation_time_s,
                period=period,
                seed=derived_seed(*seeds, _NOISE_STREAM),
            ),
        )
        builder.Connect(applied, noise.GetInputPort("force"))
        applied = noise.GetOutputPort("force")
    thrusters = add("thrusters", Thrusters(scenario.spacecraft.thrust_limit_n))
    builder.Connect(applied, thrusters.GetInputPort("force"))
    applied = thrusters.GetOutputPort("force")
    builder.Connect(applied, hold.get_input_port())

    monitor = add(
        "monitor",
        FlightMonitor(
            body.gravity_field,
            body.keep_out_semi_axes,
            radius=scenario.arrival.radius_m,
            speed=scenario.arrival.speed_m_s,
            dwell=scenario.arrival.dwell_s,
            tolerance=KEEP_OUT_TOLERANCE,
            period=period,
        ),
    )
    builder.Connect(craft_ports["state"], monitor.GetInputPort("state"))
    builder.Connect(target.get_output_port(), monitor.GetInputPort("target"))

    # The lidar is not logged: its frames are a function of time and position, so they are made
    # from the log when the flight is over. At a control step the hold has not yet taken the new
    # command: what is logged as `force` is what it is about to hold.
    logged = {
        "state": craft_ports["state"],
        "target": target.get_output_port(),
        "force": applied,
        "command": assured,
    }
    if assurance is not None:
        logged["intervention_record"] = assurance.GetOutputPort("intervention")
    if kicks is not None:
        logged["kick"] = kicks.GetOutputPort("next_acceleration")
    if isinstance(pilot, ModelPredictiveController):
        logged["mpc_force"] = command
        logged["mpc_record"] = pilot.GetOutputPort("record")
    if isinstance(pilot, NeuralPolicy):
        logged["policy_force"] = command
        logged["policy_record"] = pilot.GetOutputPort("record")
        if pilot.bundle.estimates:
            logged["estimate"] = pilot.GetOutputPort("estimate")
    if isinstance(pilot, EstimateFeedback):
        logged["policy_record"] = pilot.GetOutputPort("record")
        logged["estimate"] = pilot.GetOutputPort("estimate")
    if isinstance(pilot, HybridController):
        logged |= pilot.logged_ports()
    for name, port in logged.items():
        LogVectorOutput(port, builder, publish_period=period).set_name(f"log_{name}")
    if meshcat is not None:
        seen = {name: sources[name] for name in ("position", "ranges")}
        seen["force"] = applied
        if _has_plan(pilot):
            seen["plan"] = pilot.GetOutputPort("plan")
        limit = scenario.spacecraft.thrust_limit_n
        view = LiveView(Scene(meshcat, body), lidar, limit, period, with_plan="plan" in seen)
        add_live_view(builder, transit, view, seen)
    diagram = builder.Build()
    diagram.set_name("transit")
    return diagram


def _has_plan(controller: System) -> bool:
    """Whether it has an abstract output port `plan`."""
    ports = [controller.get_output_port(i) for i in range(controller.num_output_ports())]
    return any(
        port.get_name() == "plan" and port.get_data_type() == PortDataType.kAbstractValued
        for port in ports
    )


def _connect_controller(builder: DiagramBuilder, controller: System, sources: dict) -> None:
    """Connects the controller's input ports by name; refuses ports that nothing feeds."""
    names = [controller.get_output_port(i).get_name() for i in range(controller.num_output_ports())]
    if "force" not in names or controller.GetOutputPort("force").size() != 3:
        raise InputError(
            f"controller {controller.get_name()!r} needs an output port 'force' of size 3; "
            f"it has {', '.join(names) or 'none'}"
        )
    for i in range(controller.num_input_ports()):
        port = controller.get_input_port(i)
        name = port.get_name()
        if name in sources:
            if port.size() != sources[name].size():
                raise InputError(
                    f"controller {controller.get_name()!r}: input port {name!r} has size "
                    f"{port.size()}, but {sources[name].size()} is what feeds it"
                )
            builder.Connect(sources[name], port)
        elif name not in _OPTIONAL_PORTS:
            raise InputError(
                f"controller {controller.get_name()!r}: nothing feeds input port {name!r}; "
                f"what there is: {', '.join(sources)}"
            )
