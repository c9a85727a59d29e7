"""What turns a rigid spacecraft and knows how it is turned: sensors, filter, control, actuators.

`StarTracker` and `Gyro` measure, `AttitudeFilter` makes attitude and angular velocity of that.
`AttitudeGuidance` says what the attitude should be, and `AttitudeControl` which torque brings it
there. `ReactionWheels` and `ThrusterAllocation` give torque and force: wheels what they can,
thrusters the rest and what unloads the wheels. `TorqueEstimator` learns the centre of mass, the
thrusters and what else turns the spacecraft from how it turns, and finds a thruster that has
failed. `ThrusterCluster` and `WheelFriction` are what thrusters and wheels truly give.

The spacecraft itself is `RigidSpacecraft` of `systems/vehicle`. What is on board is made from
the data sheet (`ThrusterLayout`, `WheelArray`, inertia), what is true from `true_layout` and
`TrueRigidBodyConfig`. Everything here runs at attitude steps, usually each second. Start with
`attitude_control`.
"""

from proxops.systems.attitude.attitude_control import (
    AttitudeControl,
    attitude_error,
    control_torque,
    pointing_error,
)
from proxops.systems.attitude.attitude_filter import (
    AttitudeFilter,
    AttitudeNoise,
    settled_noise,
)
from proxops.systems.attitude.attitude_guidance import (
    AttitudeGuidance,
    AttitudeGuidanceConfig,
    shortest_turn,
)
from proxops.systems.attitude.given_force import GivenForce
from proxops.systems.attitude.gyro import Gyro, GyroConfig
from proxops.systems.attitude.reaction_wheels import ReactionWheels, WheelArray, WheelFriction
from proxops.systems.attitude.star_tracker import InertialAttitude, StarTracker, StarTrackerConfig
from proxops.systems.attitude.thruster_allocation import AllocationProgram, ThrusterAllocation
from proxops.systems.attitude.thruster_cluster import (
    Failure,
    ThrusterCluster,
    TrueRigidBodyConfig,
    true_layout,
)
from proxops.systems.attitude.thruster_layout import ThrusterLayout, lost_directions
from proxops.systems.attitude.torque_estimator import TorqueEstimator

__all__ = [
    "AllocationProgram",
    "AttitudeControl",
    "AttitudeFilter",
    "AttitudeGuidance",
    "AttitudeGuidanceConfig",
    "AttitudeNoise",
    "Failure",
    "GivenForce",
    "Gyro",
    "GyroConfig",
    "InertialAttitude",
    "ReactionWheels",
    "StarTracker",
    "StarTrackerConfig",
    "ThrusterAllocation",
    "ThrusterCluster",
    "ThrusterLayout",
    "TorqueEstimator",
    "TrueRigidBodyConfig",
    "WheelArray",
    "WheelFriction",
    "attitude_error",
    "control_torque",
    "lost_directions",
    "pointing_error",
    "settled_noise",
    "shortest_turn",
    "true_layout",
]
