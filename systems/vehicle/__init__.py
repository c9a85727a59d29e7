"""The spacecraft, its thrusters, what disturbs it, and the monitor of its flight.

Start with `Spacecraft`, the equations of motion in K. `RandomWalkDisturbance` and `ForceNoise`
disturb the commanded force, `Thrusters` limits it and `DelayedHold` delays it. `VelocityKicks`
accelerates the spacecraft at random, and `StateNoise` adds errors to a state. `FlightMonitor` finds
arrival, collision and keep-out violations as events. `state_prediction` has plain functions that
predict the motion. A new disturbance is a `SeededSystem` with a force in and a force out. Its
random numbers must depend on its seed and the control step alone.
"""

from proxops.systems.vehicle.delayed_hold import DelayedHold
from proxops.systems.vehicle.flight_monitor import (
    COLLIDED,
    ENTERED_GOAL,
    NEVER,
    VIOLATIONS,
    FlightMonitor,
)
from proxops.systems.vehicle.force_noise import ForceNoise
from proxops.systems.vehicle.random_walk_disturbance import RandomWalkDisturbance
from proxops.systems.vehicle.spacecraft import Spacecraft, Spacecraft_, jacobi_integral
from proxops.systems.vehicle.state_noise import StateNoise
from proxops.systems.vehicle.state_prediction import (
    moved_by,
    predicted_state,
    unexplained_acceleration,
)
from proxops.systems.vehicle.thrusters import Thrusters
from proxops.systems.vehicle.velocity_kicks import VelocityKicks

__all__ = [
    "COLLIDED",
    "ENTERED_GOAL",
    "NEVER",
    "VIOLATIONS",
    "DelayedHold",
    "FlightMonitor",
    "ForceNoise",
    "RandomWalkDisturbance",
    "Spacecraft",
    "Spacecraft_",
    "StateNoise",
    "Thrusters",
    "VelocityKicks",
    "jacobi_integral",
    "moved_by",
    "predicted_state",
    "unexplained_acceleration",
]
