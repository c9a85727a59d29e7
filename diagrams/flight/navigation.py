"""Adds the navigation: what is known on board of the spacecraft's own motion, from the lidar."""

from __future__ import annotations

import typing

from pydrake.systems.framework import Context, Diagram, OutputPort, System
from pydrake.systems.primitives import Demultiplexer

from proxops.diagrams.flight.scenario_systems import make_navigation
from proxops.diagrams.flight.wiring import Wiring
from proxops.diagrams.scenario import LidarNavigationConfig, Scenario
from proxops.systems import CommandAxes, InputError, LidarNavigation, MendedMap

STATE_PORTS = ("state", "position", "velocity")
"""Ports of a controller that tell it its own motion."""


def needs_navigation(scenario: Scenario, controller: System) -> bool:
    """Tells whether a flight has a navigation: whether anything on board reads what it gives.

    A controller that reads none of `STATE_PORTS`, such as a learned policy, flies without one, and
    takes the spacecraft's axes for K's. Runtime assurance always needs a state.
    """
    if not isinstance(scenario.navigation, LidarNavigationConfig):
        return False
    return scenario.assurance is not None or any(map(controller.HasInputPort, STATE_PORTS))


def add_navigation(wiring: Wiring, ranges: OutputPort, command: OutputPort) -> LidarNavigation:
    """Adds the navigation, made from belief alone.

    Args:
      wiring: the diagram.
      ranges: the lidar's frame as it is received.
      command: the command (3,) in N in S, its mean over the last control period.
    """
    world = wiring.world
    navigation = make_navigation(world.belief, world.body, world.filter_tuning)
    wiring.add("navigation", navigation)
    wiring.builder.Connect(ranges, navigation.GetInputPort("ranges"))
    wiring.builder.Connect(command, navigation.GetInputPort("commanded_force"))
    return navigation


def known_motion(wiring: Wiring, navigation: System) -> dict[str, OutputPort]:
    """Gives state, position and velocity as the navigation knows them, and its covariance."""
    state = navigation.GetOutputPort("state")
    parts = wiring.add("navigation_parts", Demultiplexer([3, 3]))
    wiring.builder.Connect(state, parts.get_input_port())
    known = (state, parts.get_output_port(0), parts.get_output_port(1))
    covariance = {"covariance": navigation.GetOutputPort("covariance")}
    return dict(zip(STATE_PORTS, known, strict=True)) | covariance


def add_command_axes(wiring: Wiring, command: OutputPort, navigation: System) -> OutputPort:
    """Turns a command in K into S as the navigation believes it to be; returns it, clipped."""
    axes = wiring.add("command_axes", CommandAxes(wiring.scenario.spacecraft.thrust_limit_n))
    wiring.builder.Connect(command, axes.GetInputPort("force"))
    wiring.builder.Connect(navigation.GetOutputPort("attitude"), axes.GetInputPort("attitude"))
    return axes.GetOutputPort("force")


def navigation_ports(navigation: System) -> dict[str, OutputPort]:
    """Gives the ports that the navigation offers to the log, by the names of their columns."""
    offered = typing.cast(LidarNavigation, navigation).logged_ports()
    return {name: each.port for name, each in offered.items()}


def mended_map_of_flight(diagram: Diagram, context: Context) -> MendedMap:
    """Gives the map with what the navigation of a flight learned of it.

    Args:
      diagram: a transit diagram. context: its Context after the flight.

    Raises:
      InputError: the flight had no navigation, or it learned nothing of the map.
    """
    navigation = None
    if diagram.HasSubsystemNamed("navigation"):
        navigation = diagram.GetSubsystemByName("navigation")
    if not isinstance(navigation, LidarNavigation):
        raise InputError(
            "the map is not mended: this flight was told its true state, or its controller needs "
            "none; set navigation to !LidarNavigation {}"
        )
    return navigation.mended_map(navigation.GetMyContextFromRoot(context))
