"""Adds the systems between controller and hold: assurance, disturbances and thrusters."""

from __future__ import annotations

from pydrake.systems.framework import OutputPort, System

from proxops.diagrams.flight.scenario_systems import bounded_backup
from proxops.diagrams.flight.wiring import DISTURBANCE_STREAM, NOISE_STREAM, Wiring
from proxops.systems import ForceNoise, InputError, RandomWalkDisturbance, RuntimeAssurance
from proxops.systems.vehicle import Thrusters


def add_assurance(
    wiring: Wiring, command: OutputPort, known: dict[str, OutputPort], delay: float
) -> OutputPort:
    """Adds runtime assurance, if the scenario has it.

    Args:
      wiring: the diagram.
      command: the controller's force (3,) in N in K.
      known: `state` (6,) as it is known on board, in K, in m and m/s, and the `covariance` (81) of
        a navigation, if there is one.
      delay: time in s from a control step to the moment at which its force acts.

    Returns:
      The port of the force that runtime assurance permits.

    Raises:
      InputError: commands act later than the bounds of runtime assurance say.
    """
    settings = wiring.scenario.assurance
    if settings is None:
        return command
    world = wiring.world
    backup = bounded_backup(world.belief, world.body, world.uncertainty_set)
    if delay > backup.bounds.delay_s:
        raise InputError(
            f"runtime assurance cannot fly with mpc.solve_delay_s {delay:g}: it checks a command "
            "for the period that begins now, but a delayed command acts later; declare this delay "
            "in assurance.bounds.delay_s, or leave out one of them"
        )
    assurance = RuntimeAssurance(backup, settings.deviations)
    told = {name: known[name] for name in ("state", "covariance") if name in known}
    return _inserted(wiring, "assurance", assurance, command, **told)


def add_disturbances(wiring: Wiring, force: OutputPort) -> OutputPort:
    """Adds the scenario's disturbance and noise of the force, if any; returns the force."""
    scenario = wiring.scenario
    limit, period = scenario.spacecraft.thrust_limit_n, scenario.control_period_s
    if scenario.disturbance is not None:
        settings = scenario.disturbance
        disturbance = RandomWalkDisturbance(
            thrust_limit=limit,
            reset_period=settings.reset_period_s,
            max_relative_magnitude=settings.max_relative_magnitude,
            increment_std=settings.increment_std_n,
            period=period,
            seed=wiring.seed(DISTURBANCE_STREAM),
        )
        force = _inserted(wiring, "disturbance", disturbance, force)
    if scenario.force_noise is not None:
        noise = ForceNoise(
            thrust_limit=limit,
            std=scenario.force_noise.std_n,
            correlation_time=scenario.force_noise.correlation_time_s,
            period=period,
            seed=wiring.seed(NOISE_STREAM),
        )
        force = _inserted(wiring, "force_noise", noise, force)
    return force


def add_thrusters(wiring: Wiring, force: OutputPort, name: str) -> OutputPort:
    """Adds the thrust limit as a system of this name; returns the limited force."""
    limit = wiring.scenario.spacecraft.thrust_limit_n
    return _inserted(wiring, name, Thrusters(limit), force)


def _inserted(
    wiring: Wiring, name: str, system: System, force: OutputPort, **others: OutputPort
) -> OutputPort:
    """Adds a system that reads a force, and `others` by port name; returns its output `force`."""
    wiring.add(name, system)
    for port, source in {"force": force, **others}.items():
        wiring.builder.Connect(source, system.GetInputPort(port))
    return system.GetOutputPort("force")
