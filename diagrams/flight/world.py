"""Adds the true world of a flight: the spacecraft and what moves it, lidar, thrusters, monitor."""

from __future__ import annotations

import numpy as np
from pydrake.systems.framework import LeafSystem, OutputPort
from pydrake.systems.primitives import Adder

from proxops.diagrams.flight.rigid_body import add_rigid_spacecraft, rotation_of, steady_rate
from proxops.diagrams.flight.scenario_systems import make_events, make_lidar
from proxops.diagrams.flight.wiring import (
    ACCELERATION_STREAM,
    ATTITUDE_STREAM,
    DISTURBANCE_STREAM,
    KICKS_STREAM,
    LIDAR_STREAM,
    NOISE_STREAM,
    Wiring,
)
from proxops.diagrams.scenario import (
    LidarConfig,
    RigidBodyConfig,
    Scenario,
    TrueThrustersConfig,
    facets_of,
    load_spacecraft,
    turns_the_axes,
)
from proxops.systems import (
    ActualThrust,
    AttitudeError,
    FlightMonitor,
    ForceNoise,
    FrameDelay,
    PlanarLidar,
    PolyhedralGravity,
    RandomWalkDisturbance,
    RigidSpacecraft,
    Spacecraft,
    Sunlight,
    UnexplainedAcceleration,
    VelocityKicks,
)
from proxops.systems.gravity import Moons
from proxops.systems.lidar import MoonMask
from proxops.systems.vehicle import Thrusters

# The body's greatest radius for the mask of moons, over that of its map: the true surface differs.
_SPARE = 1.05


def add_spacecraft(wiring: Wiring) -> Spacecraft | RigidSpacecraft:
    """Adds the spacecraft as it truly is, at the start of the transit."""
    if wiring.scenario.is_rigid:
        return add_rigid_spacecraft(wiring)
    scenario, transit, true_body = wiring.scenario, wiring.world.transit, wiring.world.true_body
    rate = steady_rate(true_body.spin)
    if rate is not None and true_body.spin.about_z and not true_body.axis_point.any():
        rate = float(rate[2])
    craft = Spacecraft(
        scenario.truth.mass * scenario.spacecraft.mass_kg,
        rate,
        np.concatenate([transit.start, transit.start_velocity]),
        axis_point=true_body.axis_point,
        burns_propellant=scenario.truth.specific_impulse_s is not None,
    )
    wiring.logged["state"] = craft.GetOutputPort("state")
    if craft.HasOutputPort("mass"):
        wiring.logged["mass"] = craft.GetOutputPort("mass")
    return wiring.add("spacecraft", craft, **rotation_of(wiring, craft))


def add_accelerations(wiring: Wiring, craft: Spacecraft | RigidSpacecraft) -> None:
    """Connects true gravity and, as far as there are any, kicks, sunlight and the unexplained."""
    field = wiring.world.true_body.gravity_field
    position = craft.GetOutputPort("position")
    gravity = wiring.add("gravity", PolyhedralGravity(field), position=position)
    if craft.HasInputPort("gravity_gradient"):
        gradient = gravity.GetOutputPort("gradient")
        wiring.builder.Connect(gradient, craft.GetInputPort("gravity_gradient"))
    parts = [gravity.GetOutputPort("acceleration")]
    if wiring.scenario.kicks is not None:
        parts.append(_kicks(wiring))
    if moons := wiring.world.body.config.moons:
        system = wiring.add("moons", Moons(moons, wiring.world.true_body.spin), position=position)
        parts.append(system.GetOutputPort("acceleration"))
    if wiring.scenario.sunlight is not None:
        parts.append(_sunlight(wiring, craft))
    acceleration = wiring.scenario.truth.acceleration
    if any(acceleration.constant_m_s2) or acceleration.varying_std_m_s2 > 0.0:
        parts.append(_unexplained(wiring))
    total = parts[0]
    if len(parts) > 1:
        each = {f"u{k}": part for k, part in enumerate(parts)}
        total = wiring.add("accelerations", Adder(len(parts), 3), **each).get_output_port()
    wiring.builder.Connect(total, craft.GetInputPort("gravity"))


def _kicks(wiring: Wiring) -> OutputPort:
    settings = wiring.scenario.kicks
    assert settings is not None
    kicks = VelocityKicks(
        velocity_std=settings.velocity_std_m_s,
        mean_interval=settings.mean_interval_s,
        period=wiring.scenario.control_period_s,
        seed=wiring.seed(KICKS_STREAM),
    )
    wiring.logged["kick"] = kicks.GetOutputPort("next_acceleration")
    return wiring.add("kicks", kicks).GetOutputPort("acceleration")


def _sunlight(wiring: Wiring, craft: Spacecraft | RigidSpacecraft) -> OutputPort:
    settings, true_body = wiring.scenario.sunlight, wiring.world.true_body
    assert settings is not None
    mass = craft.GetOutputPort("mass") if craft.HasOutputPort("mass") else None
    attitude = craft.GetOutputPort("attitude") if craft.HasOutputPort("attitude") else None
    facets = None
    if isinstance(rigid := wiring.scenario.spacecraft, RigidBodyConfig):
        centre = np.array(wiring.scenario.truth.rigid_body.centre_of_mass_m)
        facets = facets_of(load_spacecraft(rigid.model), centre)
    sunlight = Sunlight(
        settings,
        true_body.shape,
        true_body.spin,
        craft.mass if mass is None else None,
        true_body.axis_point,
        wiring.scenario.control_period_s,
        facets,
    )
    place = craft.GetOutputPort("position")
    wiring.add("sunlight", sunlight, position=place, mass=mass, attitude=attitude)
    wiring.logged["sun_direction"] = sunlight.GetOutputPort("direction")
    return sunlight.GetOutputPort("acceleration")


def _unexplained(wiring: Wiring) -> OutputPort:
    true = wiring.scenario.truth.acceleration
    unexplained = UnexplainedAcceleration(
        constant=np.array(true.constant_m_s2),
        std=true.varying_std_m_s2,
        correlation_time=true.correlation_time_s,
        period=wiring.scenario.control_period_s,
        seed=wiring.seed(ACCELERATION_STREAM),
    )
    wiring.add("unexplained_acceleration", unexplained)
    period = wiring.scenario.control_period_s
    return wiring.held("acceleration_hold", unexplained.GetOutputPort("acceleration"), period)


def add_attitude(wiring: Wiring, craft: Spacecraft | RigidSpacecraft) -> OutputPort | None:
    """Adds the rotation of the spacecraft's axes S against K; None if they are the same."""
    truth = wiring.scenario.truth
    if craft.HasOutputPort("attitude"):
        return craft.GetOutputPort("attitude")
    if not turns_the_axes(truth, wiring.world.body, wiring.world.true_body):
        return None
    error = AttitudeError(
        wiring.spins,
        truth.attitude,
        wiring.scenario.control_period_s,
        wiring.seed(ATTITUDE_STREAM),
    )
    wiring.logged["attitude"] = error.GetOutputPort("attitude")
    return wiring.add("attitude", error).GetOutputPort("attitude")


def add_lidar(wiring: Wiring, position: OutputPort, attitude: OutputPort | None) -> PlanarLidar:
    """Adds the true lidar."""
    true_body, seed = wiring.world.true_body, wiring.seed(LIDAR_STREAM)
    moons = wiring.world.body.moons
    lidar = make_lidar(wiring.scenario, true_body.shape, seed, moons, true_body.spin)
    return wiring.add("lidar", lidar, position=position, attitude=attitude)


def received(wiring: Wiring, lidar: PlanarLidar) -> OutputPort:
    """Gives the ranges as they are received: some steps late, if the lidar has a latency."""
    ranges, steps = lidar.GetOutputPort("ranges"), wiring.scenario.truth.lidar.latency_steps
    if steps == 0:
        return ranges
    delay = FrameDelay(ranges.size(), steps, wiring.scenario.control_period_s)
    return wiring.add("frame_delay", delay, ranges=ranges).GetOutputPort("ranges")


def without_moons(wiring: Wiring, ranges: OutputPort, attitude: OutputPort | None) -> OutputPort:
    """Gives the ranges without the returns of moons, if there are any that the lidar sees.

    `attitude` is R_KS as known on board; None: S has the axes of K.
    """
    body, scenario = wiring.world.body, wiring.scenario
    if not body.moons or not isinstance(scenario.lidar, LidarConfig):
        return ranges
    reach = float(np.linalg.norm(body.shape.vertices, axis=1).max())
    moons = [moon.config for moon in body.moons]
    mask = MoonMask(scenario.lidar_geometry, moons, body.spin, _SPARE * reach)
    wiring.add("moon_mask", mask, ranges=ranges, attitude=attitude)
    return mask.get_output_port()


def add_thrust(
    wiring: Wiring, held: OutputPort, attitude: OutputPort | None, craft: Spacecraft
) -> None:
    """Connects the held force, through the thrusters' errors if there are any, to the spacecraft.

    Args:
      wiring: the diagram.
      held: the force (3,) in N in S that the thrusters are to give.
      attitude: the rotation of S against K; None: they are the same.
      craft: the spacecraft.
    """
    truth, thrust = wiring.scenario.truth, held
    if attitude is not None or has_thruster_errors(wiring.scenario):
        period = wiring.scenario.control_period_s
        actual = ActualThrust(truth.thrusters.errors(), period, truth.specific_impulse_s)
        wiring.add("actual_thrust", actual, force=held)
        if attitude is not None:
            attitude = wiring.held("attitude_hold", attitude, period)
            wiring.builder.Connect(attitude, actual.GetInputPort("attitude"))
        if truth.specific_impulse_s is not None:
            flow = actual.GetOutputPort("mass_flow")
            wiring.builder.Connect(flow, craft.GetInputPort("mass_flow"))
        thrust = actual.GetOutputPort("force")
    wiring.builder.Connect(thrust, craft.GetInputPort("force"))


def has_thruster_errors(scenario: Scenario) -> bool:
    """Tells whether a point's thrusters give another force than is commanded, or use up mass."""
    truth = scenario.truth
    if scenario.is_rigid:
        return False  # It has thrusters of its own.
    return truth.thrusters != TrueThrustersConfig() or truth.specific_impulse_s is not None


def hold_command(
    wiring: Wiring, command: OutputPort, hold: LeafSystem, command_hold: LeafSystem
) -> None:
    """Connects a command to the hold of the thrusters, and to that of what is known on board.

    The thrusters are to give the command, disturbed and limited.
    """
    wiring.logged["command"] = command
    force = _limited(wiring, _disturbed(wiring, command), "thrusters")
    wiring.logged["force"] = force
    wiring.builder.Connect(force, hold.get_input_port())
    if command_hold is not hold:
        wiring.builder.Connect(
            _limited(wiring, command, "command_limits"), command_hold.get_input_port()
        )


def _disturbed(wiring: Wiring, force: OutputPort) -> OutputPort:
    """Adds the scenario's disturbance and noise of the force, if any; returns the force."""
    scenario = wiring.scenario
    limit, period = scenario.spacecraft.thrust_limit_n, scenario.control_period_s
    if scenario.disturbance is not None:
        disturbance = RandomWalkDisturbance(
            thrust_limit=limit,
            reset_period=scenario.disturbance.reset_period_s,
            max_relative_magnitude=scenario.disturbance.max_relative_magnitude,
            increment_std=scenario.disturbance.increment_std_n,
            period=period,
            seed=wiring.seed(DISTURBANCE_STREAM),
        )
        force = wiring.add("disturbance", disturbance, force=force).GetOutputPort("force")
    if scenario.force_noise is not None:
        noise = ForceNoise(
            thrust_limit=limit,
            std=scenario.force_noise.std_n,
            correlation_time=scenario.force_noise.correlation_time_s,
            period=period,
            seed=wiring.seed(NOISE_STREAM),
        )
        force = wiring.add("force_noise", noise, force=force).GetOutputPort("force")
    return force


def _limited(wiring: Wiring, force: OutputPort, name: str) -> OutputPort:
    """Adds the thrust limit as a system of this name; returns the limited force."""
    limit = Thrusters(wiring.scenario.spacecraft.thrust_limit_n)
    return wiring.add(name, limit, force=force).GetOutputPort("force")


def add_monitor(wiring: Wiring, state: OutputPort, target: OutputPort) -> None:
    """Adds the monitor of arrival, collision and violations of the keep-out ellipsoid."""
    scenario, world = wiring.scenario, wiring.world
    true_body = world.true_body
    events = make_events(scenario, world.body, true_body.gravity_field, true_body.spin)
    monitor = FlightMonitor(events, scenario.control_period_s)
    wiring.add("monitor", monitor, state=state, target=target)
