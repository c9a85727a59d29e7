"""The spacecraft and what acts on it between a command and its motion.

Start with `Spacecraft`, the equations of motion in K. `Thrusters`, `DelayedHold` and the
disturbances (`RandomWalkDisturbance`, `ForceNoise`, `VelocityKicks`, `StateNoise`) stand between
the command and the plant; `FlightMonitor` finds arrival, collision and keep-out violations as
events. Every random system derives its numbers from its seed and the step alone.
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
