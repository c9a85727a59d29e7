"""The spacecraft, its thrusters, what disturbs it, and the monitor of its flight.

Start with `Spacecraft`, the equations of motion in K; `RigidSpacecraft` turns, too.
`RandomWalkDisturbance` and `ForceNoise` disturb the commanded force, `Thrusters` limits it and
`DelayedHold` delays it; `FreshHold` holds without delay, and `Reckoning` moves on from it.
`ActualThrust` makes of the held command what thrusters with errors give. `AttitudeError` is how the
spacecraft's axes S are turned against K, and `CommandAxes` turns a command into S as the attitude
is believed.
`VelocityKicks`, `Sunlight` and `UnexplainedAcceleration` push the spacecraft from outside, and
`StateNoise` adds errors to a state. `FlightMonitor` finds arrival, collision and keep-out
violations as events; `FlightEvents` says what a path does to them. `FlightLimits` are what plans
and runtime assurance keep within.
`state_prediction` has plain functions that predict the motion, and `gauss_markov_at` is the process
behind errors that vary slowly. A new disturbance of the force is a `ForceDisturbance`, which says
what it adds. Its random numbers must depend on its seed and on time alone.
"""

from proxops.systems.vehicle.actual_thrust import (
    STANDARD_GRAVITY,
    ActualThrust,
    ThrusterErrors,
    TrueThrustersConfig,
    thrust_given,
)
from proxops.systems.vehicle.attitude_error import (
    AttitudeError,
    SpinKnowledge,
    TrueAttitudeConfig,
    believed_axes,
)
from proxops.systems.vehicle.command_axes import CommandAxes
from proxops.systems.vehicle.delayed_hold import DelayedHold
from proxops.systems.vehicle.disturbance_acceleration import (
    TrueAccelerationConfig,
    UnexplainedAcceleration,
)
from proxops.systems.vehicle.facets import Facets, light_on_facets
from proxops.systems.vehicle.flight_events import (
    COLLIDED,
    ENTERED_GOAL,
    FINISHED,
    NEVER,
    VIOLATIONS,
    ArrivalConfig,
    FlightEvents,
    FlownPath,
    hermite_curve,
)
from proxops.systems.vehicle.flight_limits import FlightLimits
from proxops.systems.vehicle.flight_monitor import FlightMonitor
from proxops.systems.vehicle.force_noise import ForceNoise, ForceNoiseConfig
from proxops.systems.vehicle.fresh_hold import FreshHold, Reckoning
from proxops.systems.vehicle.gauss_markov import SlowVector, gauss_markov_at, white_noise_at
from proxops.systems.vehicle.random_walk_disturbance import (
    RandomWalkDisturbance,
    RandomWalkDisturbanceConfig,
)
from proxops.systems.vehicle.rigid_spacecraft import (
    RigidBodyStart,
    RigidSpacecraft,
    RigidSpacecraft_,
)
from proxops.systems.vehicle.spacecraft import (
    PointMassConfig,
    Spacecraft,
    Spacecraft_,
    rotating_frame_acceleration,
)
from proxops.systems.vehicle.state_noise import StateNoise
from proxops.systems.vehicle.state_prediction import (
    believed_acceleration,
    moved_by,
    predicted_state,
    runge_kutta_step,
    unexplained_acceleration,
)
from proxops.systems.vehicle.sunlight import (
    Sunlight,
    SunlightConfig,
    at_its_distance,
    greatest_sunlight,
    light_acceleration,
    light_pressure,
    sun_direction,
)
from proxops.systems.vehicle.thrusters import Thrusters
from proxops.systems.vehicle.velocity_kicks import KicksConfig, VelocityKicks

__all__ = [
    "COLLIDED",
    "ENTERED_GOAL",
    "FINISHED",
    "NEVER",
    "STANDARD_GRAVITY",
    "VIOLATIONS",
    "ActualThrust",
    "ArrivalConfig",
    "AttitudeError",
    "CommandAxes",
    "DelayedHold",
    "Facets",
    "FlightEvents",
    "FlightLimits",
    "FlightMonitor",
    "FlownPath",
    "ForceNoise",
    "ForceNoiseConfig",
    "FreshHold",
    "KicksConfig",
    "PointMassConfig",
    "RandomWalkDisturbance",
    "RandomWalkDisturbanceConfig",
    "Reckoning",
    "RigidBodyStart",
    "RigidSpacecraft",
    "RigidSpacecraft_",
    "SlowVector",
    "Spacecraft",
    "Spacecraft_",
    "SpinKnowledge",
    "StateNoise",
    "Sunlight",
    "SunlightConfig",
    "ThrusterErrors",
    "Thrusters",
    "TrueAccelerationConfig",
    "TrueAttitudeConfig",
    "TrueThrustersConfig",
    "UnexplainedAcceleration",
    "VelocityKicks",
    "at_its_distance",
    "believed_acceleration",
    "believed_axes",
    "gauss_markov_at",
    "greatest_sunlight",
    "hermite_curve",
    "light_acceleration",
    "light_on_facets",
    "light_pressure",
    "moved_by",
    "predicted_state",
    "rotating_frame_acceleration",
    "runge_kutta_step",
    "sun_direction",
    "thrust_given",
    "unexplained_acceleration",
    "white_noise_at",
]
