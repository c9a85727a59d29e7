"""Adds the plant of a flight: gravity, kicks, and the spacecraft with its true thrust."""

from __future__ import annotations

import numpy as np
from pydrake.systems.framework import OutputPort
from pydrake.systems.primitives import Adder, MatrixGain

from proxops.diagrams.flight.wiring import KICKS_STREAM, Wiring
from proxops.systems import GravityField, PolyhedralGravity, Spacecraft, VelocityKicks


def add_spacecraft(wiring: Wiring) -> Spacecraft:
    """Adds the spacecraft with its true mass, at the start of the transit."""
    scenario, transit = wiring.scenario, wiring.transit
    mass = scenario.mismatch.mass * scenario.spacecraft.mass_kg
    start = np.concatenate([transit.start, transit.start_velocity])
    return wiring.add("spacecraft", Spacecraft(mass, wiring.body.spin_rate, start))


def add_gravity(wiring: Wiring, craft: Spacecraft) -> None:
    """Adds the true gravity and the kicks, if any, and connects them to the spacecraft."""
    field, scale = wiring.body.gravity_field, wiring.scenario.mismatch.gravity
    if scale != 1.0:
        field = GravityField(wiring.body.shape, mass=scale * field.mass)
    gravity = wiring.add("gravity", PolyhedralGravity(field))
    wiring.builder.Connect(craft.GetOutputPort("position"), gravity.GetInputPort("position"))
    acceleration = gravity.GetOutputPort("acceleration")
    if wiring.scenario.kicks is not None:
        acceleration = _with_kicks(wiring, acceleration)
    wiring.builder.Connect(acceleration, craft.GetInputPort("gravity"))


def add_thrust(wiring: Wiring, commanded: OutputPort, craft: Spacecraft) -> None:
    """Connects the commanded force, scaled by `mismatch.thrust`, to the spacecraft."""
    thrust, scale = commanded, wiring.scenario.mismatch.thrust
    if scale != 1.0:
        gain = wiring.add("thrust_mismatch", MatrixGain(scale * np.eye(3)))
        wiring.builder.Connect(commanded, gain.get_input_port())
        thrust = gain.get_output_port()
    wiring.builder.Connect(thrust, craft.GetInputPort("force"))


def _with_kicks(wiring: Wiring, acceleration: OutputPort) -> OutputPort:
    settings = wiring.scenario.kicks
    assert settings is not None
    kicks = wiring.add(
        "kicks",
        VelocityKicks(
            velocity_std=settings.velocity_std_m_s,
            mean_interval=settings.mean_interval_s,
            period=wiring.scenario.control_period_s,
            seed=wiring.seed(KICKS_STREAM),
        ),
    )
    both = wiring.add("gravity_and_kicks", Adder(2, 3))
    wiring.builder.Connect(acceleration, both.get_input_port(0))
    wiring.builder.Connect(kicks.GetOutputPort("acceleration"), both.get_input_port(1))
    return both.get_output_port()
