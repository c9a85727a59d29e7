"""Adds the true world of a flight: gravity, the spacecraft and its thrust, accelerations, axes."""

from __future__ import annotations

import math

import numpy as np
from pydrake.systems.framework import OutputPort
from pydrake.systems.primitives import Adder, ZeroOrderHold

from proxops.diagrams.flight.wiring import (
    ACCELERATION_STREAM,
    ATTITUDE_STREAM,
    KICKS_STREAM,
    Wiring,
)
from proxops.diagrams.scenario import TrueThrustersConfig, TruthConfig, turns_the_axes
from proxops.systems import (
    ActualThrust,
    AttitudeError,
    PolyhedralGravity,
    Spacecraft,
    ThrusterErrors,
    UnexplainedAcceleration,
    VelocityKicks,
)


def add_spacecraft(wiring: Wiring) -> Spacecraft:
    """Adds the spacecraft with its true mass and spin, at the start of the transit."""
    scenario, transit, true_body = wiring.scenario, wiring.world.transit, wiring.world.true_body
    mass = scenario.truth.mass * scenario.spacecraft.mass_kg
    start = np.concatenate([transit.start, transit.start_velocity])
    about_z = not (true_body.spin[:2].any() or true_body.axis_point.any())
    craft = Spacecraft(
        mass,
        float(true_body.spin[2]) if about_z else true_body.spin,
        start,
        axis_point=true_body.axis_point,
        burns_propellant=scenario.truth.specific_impulse_s is not None,
    )
    return wiring.add("spacecraft", craft)


def add_accelerations(wiring: Wiring, craft: Spacecraft) -> None:
    """Connects true gravity, kicks and unexplained acceleration, as far as there are any."""
    gravity = wiring.add("gravity", PolyhedralGravity(wiring.world.true_body.gravity_field))
    wiring.builder.Connect(craft.GetOutputPort("position"), gravity.GetInputPort("position"))
    parts = [gravity.GetOutputPort("acceleration")]
    if wiring.scenario.kicks is not None:
        parts.append(_kicks(wiring))
    acceleration = wiring.scenario.truth.acceleration
    if any(acceleration.constant_m_s2) or acceleration.varying_std_m_s2 > 0.0:
        parts.append(_unexplained(wiring))
    total = parts[0]
    if len(parts) > 1:
        adder = wiring.add("accelerations", Adder(len(parts), 3))
        for k, part in enumerate(parts):
            wiring.builder.Connect(part, adder.get_input_port(k))
        total = adder.get_output_port()
    wiring.builder.Connect(total, craft.GetInputPort("gravity"))


def add_attitude(wiring: Wiring) -> OutputPort | None:
    """Adds the rotation of the spacecraft's axes S against K; None if they are the same."""
    truth = wiring.scenario.truth
    if not turns_the_axes(truth):
        return None
    error = AttitudeError(
        constant=np.radians(truth.attitude.constant_deg),
        varying_std=math.radians(truth.attitude.varying_std_deg),
        correlation_time=truth.attitude.correlation_time_s,
        believed_spin=wiring.world.body.spin_rate,
        true_spin=wiring.world.true_body.spin,
        phase=math.radians(truth.phase_deg),
        period=wiring.scenario.control_period_s,
        seed=wiring.seed(ATTITUDE_STREAM),
    )
    return wiring.add("attitude", error).GetOutputPort("attitude")


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
    if attitude is not None or has_thruster_errors(truth):
        period = wiring.scenario.control_period_s
        actual = wiring.add(
            "actual_thrust", ActualThrust(thruster_errors(truth), period, truth.specific_impulse_s)
        )
        wiring.builder.Connect(held, actual.GetInputPort("force"))
        if attitude is not None:
            held_attitude = _held(wiring, attitude, "attitude_hold")
            wiring.builder.Connect(held_attitude, actual.GetInputPort("attitude"))
        if truth.specific_impulse_s is not None:
            flow = actual.GetOutputPort("mass_flow")
            wiring.builder.Connect(flow, craft.GetInputPort("mass_flow"))
        thrust = actual.GetOutputPort("force")
    wiring.builder.Connect(thrust, craft.GetInputPort("force"))


def thruster_errors(truth: TruthConfig) -> ThrusterErrors:
    """Gives the errors of the true thrusters."""
    true = truth.thrusters
    return ThrusterErrors(
        scale=np.array(true.scale),
        direction=np.radians(true.direction_deg),
        least_impulse=true.least_impulse_n_s,
        quantum=true.quantum_n,
        failed_axis=None if true.failed_axis == "none" else "xyz".index(true.failed_axis),
        failure_time=true.failure_time_s,
    )


def has_thruster_errors(truth: TruthConfig) -> bool:
    """Tells whether the true thrusters give another force than is commanded, or use up mass."""
    return truth.thrusters != TrueThrustersConfig() or truth.specific_impulse_s is not None


def _kicks(wiring: Wiring) -> OutputPort:
    settings = wiring.scenario.kicks
    assert settings is not None
    kicks = VelocityKicks(
        velocity_std=settings.velocity_std_m_s,
        mean_interval=settings.mean_interval_s,
        period=wiring.scenario.control_period_s,
        seed=wiring.seed(KICKS_STREAM),
    )
    return wiring.add("kicks", kicks).GetOutputPort("acceleration")


def _unexplained(wiring: Wiring) -> OutputPort:
    true = wiring.scenario.truth.acceleration
    unexplained = UnexplainedAcceleration(
        constant=np.array(true.constant_m_s2),
        std=true.varying_std_m_s2,
        correlation_time=true.correlation_time_s,
        period=wiring.scenario.control_period_s,
        seed=wiring.seed(ACCELERATION_STREAM),
    )
    acceleration = wiring.add("unexplained_acceleration", unexplained)
    return _held(wiring, acceleration.GetOutputPort("acceleration"), "acceleration_hold")


def _held(wiring: Wiring, port: OutputPort, name: str) -> OutputPort:
    """Holds a slow signal over each control period, so that an integrator's steps do not ask."""
    hold = wiring.add(name, ZeroOrderHold(wiring.scenario.control_period_s, port.size()))
    wiring.builder.Connect(port, hold.get_input_port())
    return hold.get_output_port()
