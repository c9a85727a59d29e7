"""Adds a rigid spacecraft, its attitude sensors, what controls its attitude, and its actuators."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from pydrake.systems.framework import OutputPort, System
from pydrake.systems.primitives import Adder

from proxops.diagrams.flight.named_controllers import users_system
from proxops.diagrams.flight.wiring import (
    ATTITUDE_STREAM,
    GYRO_STREAM,
    THRUSTERS_STREAM,
    Signals,
    Wiring,
)
from proxops.diagrams.scenario import (
    RigidBodyConfig,
    SpacecraftModel,
    load_spacecraft,
)
from proxops.systems.attitude import (
    AttitudeControl,
    AttitudeFilter,
    AttitudeGuidance,
    Failure,
    GivenForce,
    Gyro,
    InertialAttitude,
    ReactionWheels,
    StarTracker,
    ThrusterAllocation,
    ThrusterCluster,
    TorqueEstimator,
    WheelFriction,
    shortest_turn,
    true_layout,
)
from proxops.systems.common import (
    InputError,
    Quaternion,
    Vector3,
    quaternion_of,
    quaternion_product,
    vector_of,
)
from proxops.systems.rotation import BodyRotation, SpinModel, TorqueFreeSpin
from proxops.systems.vehicle import (
    FreshHold,
    RigidBodyStart,
    RigidSpacecraft,
    Spacecraft,
    believed_axes,
)


class _Attitude(NamedTuple):
    """What is known on board of the attitude."""

    settings: RigidBodyConfig
    model: SpacecraftModel
    period: float


def add_rigid_spacecraft(wiring: Wiring) -> RigidSpacecraft:
    """Adds the rigid spacecraft as it truly is, at the start of the transit."""
    scenario, world = wiring.scenario, wiring.world
    settings, truth = scenario.spacecraft, scenario.truth
    assert isinstance(settings, RigidBodyConfig)
    model = load_spacecraft(settings.model)
    share = truth.mass * settings.mass
    inertia = share * truth.rigid_body.inertia * model.inertia
    wheels = model.wheels
    craft = RigidSpacecraft(
        share * model.mass,
        inertia,
        steady_rate(world.true_body.spin),
        _start(wiring),
        world.true_body.axis_point,
        None if wheels is None else wheels.axes,
        0.0 if wheels is None else wheels.inertia,
    )
    for name in ("state", "mass", "attitude", "angular_velocity"):
        wiring.logged[name] = craft.GetOutputPort(name)
    if wheels is not None:
        wiring.logged["wheel_momentum"] = craft.GetOutputPort("wheel_momentum")
    return wiring.add("spacecraft", craft, **rotation_of(wiring, craft))


def steady_rate(spin: SpinModel) -> Vector3 | None:
    """What a spacecraft is made with: w (3,) in rad/s if it is constant; None: by its ports."""
    return None if isinstance(spin, TorqueFreeSpin) else spin.rate


def rotation_of(wiring: Wiring, craft: Spacecraft | RigidSpacecraft) -> Signals:
    """Adds how the true body turns, if the spacecraft asks; returns what its ports are to get."""
    if not craft.HasInputPort("spin"):
        return {}
    rotation = wiring.add("body_rotation", BodyRotation(wiring.world.true_body.spin))
    return {
        "spin": rotation.GetOutputPort("angular_velocity"),
        "spin_rate": rotation.GetOutputPort("angular_acceleration"),
    }


def _start(wiring: Wiring) -> RigidBodyStart:
    """The spacecraft at the start: at rest in K as believed, and pointed as it should be."""
    world = wiring.world
    axes = believed_axes(0.0, wiring.spins)
    error = quaternion_of(wiring.scenario.truth.attitude.constant)
    state = np.concatenate([world.transit.start, world.transit.start_velocity])
    attitude = quaternion_product(axes, quaternion_product(_pointed(wiring), error))
    return RigidBodyStart(state, attitude, vector_of(world.body.spin.rate))


def _pointed(wiring: Wiring) -> Quaternion:
    """R_KS as wanted at the start: after an approach the boresight is at the body, if asked for."""
    settings = wiring.scenario.spacecraft
    assert isinstance(settings, RigidBodyConfig)
    if settings.pointing.mode != "body":
        return quaternion_of((0.0, 0.0, 0.0))
    boresight, start = np.array(settings.pointing.boresight), wiring.world.transit.start
    way = np.array(settings.pointing.place_m) - start
    turn = shortest_turn(boresight / np.linalg.norm(boresight), way / np.linalg.norm(way))
    return quaternion_of(vector_of(turn))


def add_attitude_sensors(wiring: Wiring, craft: RigidSpacecraft) -> Signals:
    """Adds star tracker, gyro and the filter on board.

    Returns:
      `attitude` (R_NS) and `angular_velocity` as known on board; `body_attitude` and
      `middle_attitude`, R_KS with the spin as believed, now and half a period later; and
      `commanded_force` and `commanded_thrust`, what the thrusters gave over the last control
      period, as far as is known, together and all added up, `force_apart`, as the root of the sum
      of squares, and `force_lead`, how early.
    """
    scenario, world = wiring.scenario, wiring.world
    settings = scenario.spacecraft
    assert isinstance(settings, RigidBodyConfig)
    model, period = load_spacecraft(settings.model), scenario.attitude_period_s
    attitude = craft.GetOutputPort("attitude")
    inertial = wiring.add("inertial_attitude", InertialAttitude(wiring.spins), attitude=attitude)
    seed = wiring.seed(ATTITUDE_STREAM)
    tracker = StarTracker(model.config.star_tracker, period, seed, scenario.truth.attitude)
    wiring.add(
        "star_tracker",
        tracker,
        attitude=inertial.get_output_port(),
        body_attitude=attitude,
        position=craft.GetOutputPort("position"),
        sun_direction=wiring.logged.get("sun_direction"),
    )
    gyro = Gyro(model.config.gyro, period, wiring.seed(GYRO_STREAM))
    wiring.add("gyro", gyro, angular_velocity=craft.GetOutputPort("angular_velocity"))
    known = wiring.add(
        "attitude_filter",
        AttitudeFilter(model.noise, world.body.spin, period),
        star_tracker=tracker.get_output_port(),
        gyro=gyro.get_output_port(),
    )
    wiring.logged["inertial_attitude"] = inertial.get_output_port()
    given = wiring.add("given_force", GivenForce(period, scenario.attitude_steps))
    names = ("attitude", "angular_velocity", "body_attitude", "middle_attitude")
    return {
        **{name: known.GetOutputPort(name) for name in names},
        "commanded_force": given.GetOutputPort("mean_force"),
        "commanded_thrust": given.GetOutputPort("mean_thrust"),
        "force_apart": given.GetOutputPort("mean_apart"),
        "force_lead": given.GetOutputPort("force_lead"),
    }


def add_actuation(
    wiring: Wiring, craft: RigidSpacecraft, command: OutputPort, known: Signals
) -> None:
    """Adds what turns a commanded force into pulses of thrusters and torques of wheels.

    Args:
      wiring: the diagram.
      craft: the spacecraft.
      command: force (3,) in N along K's axes as believed, of control steps.
      known: see `add_attitude_sensors`, and `position` (3,) in m in K as known on board.
    """
    settings = wiring.scenario.spacecraft
    assert isinstance(settings, RigidBodyConfig)
    own = _Attitude(settings, load_spacecraft(settings.model), wiring.scenario.attitude_period_s)
    fresh = wiring.add("force_sample", FreshHold(wiring.scenario.control_period_s, 3), u=command)
    known = {**known, "force": fresh.get_output_port()}
    torque = _add_control(wiring, own, craft, known)
    layout, wheels = own.model.thrusters, own.model.wheels
    allocation = wiring.add(
        "thruster_allocation",
        ThrusterAllocation(layout, own.period),
        force=known["force"],
        attitude=known["middle_attitude"],
    )
    builder = wiring.builder
    guidance = builder.GetSubsystemByName("attitude_guidance")
    if guidance.HasInputPort("lost"):
        builder.Connect(allocation.GetOutputPort("lost"), guidance.GetInputPort("lost"))
    given = builder.GetSubsystemByName("given_force")
    for name in ("force", "thrust", "apart"):
        builder.Connect(allocation.GetOutputPort(f"given_{name}"), given.GetInputPort(name))
    times = wiring.held("thruster_hold", allocation.GetOutputPort("on_times"), own.period)
    estimator = builder.GetSubsystemByName("torque_estimator")
    builder.Connect(times, estimator.GetInputPort("on_times"))
    for name in ("thruster_torques", "failed"):
        builder.Connect(estimator.GetOutputPort(name), allocation.GetInputPort(name))
    if wheels is None:
        builder.Connect(torque, allocation.GetInputPort("torque"))
    else:
        share = wiring.add(
            "reaction_wheels",
            ReactionWheels(wheels),
            torque=torque,
            wheel_momentum=craft.GetOutputPort("wheel_momentum"),
            given_torque=allocation.GetOutputPort("given_torque"),
        )
        asked = share.GetOutputPort("thruster_torque")
        builder.Connect(asked, allocation.GetInputPort("torque"))
        wheel_torque = wiring.held("wheel_hold", share.GetOutputPort("wheel_torque"), own.period)
        builder.Connect(wheel_torque, estimator.GetInputPort("wheel_torque"))
        _add_wheels(wiring, own, craft, wheel_torque)
    _add_thrusters(wiring, own, craft, times)
    wiring.logged["on_times"] = times


def _add_control(
    wiring: Wiring, own: _Attitude, craft: RigidSpacecraft, known: Signals
) -> OutputPort:
    """Adds guidance, control and what estimates torques; returns the torque on the bus."""
    wheels = own.model.wheels
    axes = None if wheels is None else wheels.axes
    inertia = own.settings.mass * own.model.bus_inertia
    guidance = _add_guidance(wiring, own, known)
    momentum = None if wheels is None else craft.GetOutputPort("wheel_momentum")
    estimator = TorqueEstimator(
        own.model.thrusters, inertia, own.period, own.model.noise.gyro, axes
    )
    wiring.add("torque_estimator", estimator, angular_velocity=known["angular_velocity"])
    control = AttitudeControl(inertia, axes)
    wiring.add(
        "attitude_control",
        control,
        attitude=known["attitude"],
        angular_velocity=known["angular_velocity"],
        reference=guidance.GetOutputPort("reference"),
        reference_rate=guidance.GetOutputPort("reference_rate"),
        disturbance=estimator.GetOutputPort("torque"),
    )
    if momentum is not None:
        for system in (estimator, control):
            wiring.builder.Connect(momentum, system.GetInputPort("wheel_momentum"))
    wiring.logged["reference_attitude"] = guidance.GetOutputPort("reference")
    wiring.logged["centre_of_mass"] = estimator.GetOutputPort("centre_of_mass")
    wiring.logged["failed_thrusters"] = estimator.GetOutputPort("failed")
    return control.get_output_port()


def _add_guidance(wiring: Wiring, own: _Attitude, known: Signals) -> System:
    """Adds what says which attitude is wanted: the law of the settings, or the user's own."""
    settings, world = own.settings.pointing, wiring.world
    if settings.law:
        guidance = users_system(settings.law, world.belief, world.body)
        for name, size in (("reference", 4), ("reference_rate", 3)):
            if not guidance.HasOutputPort(name) or guidance.GetOutputPort(name).size() != size:
                raise InputError(
                    f"spacecraft.pointing.law {settings.law!r} needs an output port {name!r} of "
                    f"{size} numbers"
                )
    else:
        guidance = AttitudeGuidance(settings, world.body.spin, own.period)
    names = ("position", "body_attitude", "force")
    inputs = {name: known[name] for name in names if guidance.HasInputPort(name)}
    return wiring.add("attitude_guidance", guidance, **inputs)


def _add_wheels(wiring: Wiring, own: _Attitude, craft: RigidSpacecraft, torque: OutputPort) -> None:
    """Connects the torque of the wheels' motors, less friction, to the spacecraft."""
    assert own.model.wheels is not None
    friction = wiring.scenario.truth.rigid_body.wheel_friction_per_s
    wheels = wiring.add(
        "wheel_friction",
        WheelFriction(own.model.wheels, friction),
        wheel_torque=torque,
        wheel_momentum=craft.GetOutputPort("wheel_momentum"),
    )
    wiring.builder.Connect(wheels.get_output_port(), craft.GetInputPort("wheel_torque"))


def _add_thrusters(
    wiring: Wiring, own: _Attitude, craft: RigidSpacecraft, times: OutputPort
) -> None:
    """Connects the thrusters as they truly are to the spacecraft."""
    truth = wiring.scenario.truth
    seed = wiring.seed(THRUSTERS_STREAM)
    layout = true_layout(own.model.thrusters, truth.rigid_body, truth.thrusters.errors(), seed)
    failure = None
    if truth.rigid_body.failed_thruster >= 0:
        failure = Failure(truth.rigid_body.failed_thruster, truth.rigid_body.failure_time_s)
    impulse = wiring.scenario.true_specific_impulse_s
    assert impulse is not None
    cluster = ThrusterCluster(layout, own.period, impulse, failure)
    wiring.add("thruster_cluster", cluster, on_times=times)
    for name in ("force", "mass_flow"):
        wiring.builder.Connect(cluster.GetOutputPort(name), craft.GetInputPort(name))
    torque = cluster.GetOutputPort("torque")
    if wiring.scenario.sunlight is not None:
        light = wiring.builder.GetSubsystemByName("sunlight").GetOutputPort("torque")
        torque = wiring.add("torques", Adder(2, 3), u0=torque, u1=light).get_output_port()
    wiring.builder.Connect(torque, craft.GetInputPort("torque"))
