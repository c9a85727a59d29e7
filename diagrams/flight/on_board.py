"""Adds what is on board, made from belief alone: navigation, controller and runtime assurance."""

from __future__ import annotations

from pydrake.systems.framework import Context, Diagram, LeafSystem, OutputPort, System
from pydrake.systems.primitives import Demultiplexer

from proxops.diagrams.flight.scenario_systems import bounded_backup, make_navigation
from proxops.diagrams.flight.wiring import Signals, Wiring
from proxops.diagrams.logs import CONTROLLER_COLUMNS, RESERVED_COLUMNS, column_size
from proxops.diagrams.scenario import LidarNavigationConfig
from proxops.systems import (
    CommandAxes,
    DelayedHold,
    EnabledValue,
    InputError,
    LidarNavigation,
    MendedMap,
    RuntimeAssurance,
)
from proxops.systems.common import check_port_size, force_port, offers_of
from proxops.systems.touch import TouchController

STATE_PORTS = ("state", "position", "velocity")
"""Ports of a controller that tell it its own motion."""
# Input ports of a controller that may remain unconnected.
_OPTIONAL_PORTS = {"enable", "covariance", "failed", "body_attitude", "given_force"}


def add_on_board(
    wiring: Wiring,
    controller: System,
    signals: Signals,
    command_hold: LeafSystem,
    touch: TouchController | None = None,
) -> tuple[OutputPort, Signals]:
    """Adds controller and runtime assurance, and the navigation if anything reads what it gives.

    A controller that reads none of `STATE_PORTS`, such as a learned policy, flies without one, and
    takes the spacecraft's axes for K's. Runtime assurance always needs a state.

    Args:
      wiring: the diagram.
      controller: the controller.
      signals: what feeds it, with the true motion.
      command_hold: holds the command that controller and navigation know.
      touch: flies what follows the transit of `controller`; None: nothing follows.

    Returns:
      The command (3,) in N in S, and the signals as they are known on board: with a navigation,
      `STATE_PORTS` are its own, and there is its `covariance` (81).

    Raises:
      InputError: the controller does not fit, or acts later than runtime assurance allows for.
    """
    delay = command_hold.delay if isinstance(command_hold, DelayedHold) else 0.0
    assured = wiring.scenario.assurance is not None
    navigated = isinstance(wiring.scenario.navigation, LidarNavigationConfig)
    if not navigated or not (assured or any(map(controller.HasInputPort, STATE_PORTS))):
        return _commanded(wiring, controller, signals, delay, touch), signals
    # A command that acts late acts over a part of two periods.
    # A rigid spacecraft knows what its thrusters gave.
    mean = delay > 0.0 and "body_attitude" not in signals
    acted = command_hold.GetOutputPort("mean") if mean else signals["commanded_force"]
    world = wiring.world
    navigation = make_navigation(world.belief, world.body, world.filter_tuning)
    body_attitude = signals.get("body_attitude")
    wiring.add(
        "navigation",
        navigation,
        ranges=signals["ranges"],
        commanded_force=acted,
        commanded_thrust=signals.get("commanded_thrust"),
        force_apart=signals.get("force_apart"),
        force_lead=signals.get("force_lead"),
        body_attitude=body_attitude,
        outside_force=signals.get("head_force"),
    )
    wiring.logged.update({name: each.port for name, each in navigation.logged_ports().items()})
    state = navigation.GetOutputPort("state")
    parts = wiring.add("navigation_parts", Demultiplexer([3, 3]), u0=state)
    known = signals | {
        "state": state,
        "position": parts.get_output_port(0),
        "velocity": parts.get_output_port(1),
        "covariance": navigation.GetOutputPort("covariance"),
    }
    command = _commanded(wiring, controller, known, delay, touch)
    # From K into S as the navigation believes it to be.
    axes = CommandAxes(wiring.scenario.spacecraft.thrust_limit_n)
    attitude = navigation.GetOutputPort("attitude")
    wiring.add("command_axes", axes, force=command, attitude=attitude, body_attitude=body_attitude)
    return axes.GetOutputPort("force"), known


def _commanded(
    wiring: Wiring,
    controller: System,
    known: Signals,
    delay: float,
    touch: TouchController | None,
) -> OutputPort:
    """Adds controller and runtime assurance, and what follows their transit; returns the force.

    Once the transit is over, they are told no state, as if the navigation had none.
    """
    if touch is None:
        return _assured(wiring, _add_controller(wiring, controller, known), known, delay)
    builder = wiring.builder
    in_transit = builder.AddNamedSystem("touch", touch).GetOutputPort("in_transit")
    gated = dict(known)
    for name in (*STATE_PORTS, "covariance"):
        if name in known:
            gate = EnabledValue(known[name].size())
            wiring.add(f"transit_{name}", gate, enable=in_transit, value=known[name])
            gated[name] = gate.GetOutputPort("value")
    force = _assured(wiring, _add_controller(wiring, controller, gated), gated, delay)
    return _connect_controller(wiring, touch, known | {"transit_force": force})


def _add_controller(wiring: Wiring, controller: System, signals: Signals) -> OutputPort:
    """Adds the controller and connects its input ports by name; returns its force.

    Raises:
      InputError: it has no output `force` (3), or an input port that nothing feeds, or offers
        columns that the log cannot have.
    """
    if not controller.get_name():
        controller.set_name("controller")
    wiring.add(controller.get_name(), controller)
    return _connect_controller(wiring, controller, signals)


def _connect_controller(wiring: Wiring, controller: System, signals: Signals) -> OutputPort:
    """Connects a controller's ports: see `_add_controller`."""
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
                f"the signals are {', '.join(dict.fromkeys([*signals, 'covariance']))}"
            )
    for name, logged in offers_of(controller).logged_ports.items():
        known = name in CONTROLLER_COLUMNS
        if not name.isidentifier() or (name in RESERVED_COLUMNS and not known):
            raise InputError(
                f"controller {controller.get_name()!r}: no port can be logged as {name!r}; give "
                "another name, of letters, digits and underscores"
            )
        if known and logged.port.size() != column_size(name):
            raise InputError(
                f"controller {controller.get_name()!r} logs {name!r} with {logged.port.size()} "
                f"components, but the log's column of this name has {column_size(name)}"
            )
        wiring.logged[name] = logged.port
    return force


def _assured(wiring: Wiring, command: OutputPort, known: Signals, delay: float) -> OutputPort:
    """Adds runtime assurance, if the scenario has it; returns the force that is permitted.

    Args:
      wiring: the diagram.
      command: the controller's force (3,) in N in K.
      known: `state` (6,) as it is known on board, in K, in m and m/s, and the `covariance` (81) of
        a navigation, if there is one.
      delay: time in s from a control step to the moment at which its force acts.
    """
    settings, world = wiring.scenario.assurance, wiring.world
    if settings is None:
        return command
    backup = bounded_backup(world.belief, world.body, world.uncertainty_set)
    if delay > backup.bounds.delay_s:
        raise InputError(
            f"runtime assurance cannot fly with mpc.solve_delay_s {delay:g}: it checks a command "
            "for the period that begins now, but a delayed command acts later; declare this delay "
            "in assurance.bounds.delay_s, or leave out one of them"
        )
    assurance = RuntimeAssurance(backup, settings.deviations)
    covariance = known.get("covariance")
    wiring.add("assurance", assurance, force=command, state=known["state"], covariance=covariance)
    wiring.logged["intervention_record"] = assurance.GetOutputPort("intervention")
    wiring.logged["assurance_record"] = assurance.GetOutputPort("margin")
    return assurance.GetOutputPort("force")


def mended_map_of_flight(diagram: Diagram, context: Context) -> MendedMap:
    """Gives the map with what the navigation of a flight learned of it.

    Args:
      diagram: a transit diagram. context: its Context after the flight.

    Raises:
      InputError: the flight had no navigation, or it learned nothing of the map.
    """
    found = [each for each in diagram.GetSystems() if isinstance(each, LidarNavigation)]
    if not found:
        raise InputError(
            "the map is not mended: this flight was told its true state, or its controller needs "
            "none; set navigation to !LidarNavigation {}"
        )
    return found[0].mended_map(found[0].GetMyContextFromRoot(context))
