"""The blocks of the diagram: plain numerics, and a thin Drake LeafSystem over each."""

from proxops.systems.agreement_gates import AgreementGate, GateKind
from proxops.systems.backup_braking import (
    AssuranceLimits,
    BackupBraking,
    InterventionReason,
)
from proxops.systems.check_schedule import CheckSchedule, PeriodRule
from proxops.systems.delayed_hold import DelayedHold
from proxops.systems.enabled_value import EnabledValue
from proxops.systems.equilibria import find_equilibria
from proxops.systems.errors import InputError
from proxops.systems.flight_monitor import FlightMonitor
from proxops.systems.force_noise import ForceNoise
from proxops.systems.gravity_field import Gravity, GravityField
from proxops.systems.hybrid_selector import DecisionReason, HybridSelector
from proxops.systems.learned_lidar import LearnedLidar
from proxops.systems.lidar import Lidar, ray_directions
from proxops.systems.lidar_bundle import LidarBundle
from proxops.systems.model_predictive_controller import ModelPredictiveController
from proxops.systems.neural_policy import NeuralPolicy, PolicyStatus
from proxops.systems.plan import Horizon, Plan, PlanReason, PlanStatus, TransitLimits
from proxops.systems.planar_lidar import PlanarLidar
from proxops.systems.point_mass_field import PointMassField
from proxops.systems.policy_bundle import PolicyBundle
from proxops.systems.polyhedral_gravity import PolyhedralGravity, PolyhedralGravity_
from proxops.systems.polyhedron import Polyhedron
from proxops.systems.proportional_derivative import ProportionalDerivative
from proxops.systems.random_walk_disturbance import RandomWalkDisturbance
from proxops.systems.ray_caster import RayCaster, RayFan
from proxops.systems.reach_time import ReachModel
from proxops.systems.runtime_assurance import RuntimeAssurance
from proxops.systems.spacecraft import Spacecraft, Spacecraft_, jacobi_integral
from proxops.systems.state_noise import StateNoise
from proxops.systems.surface_maps import effective_field, plane_cut, surface_map
from proxops.systems.thrusters import Thrusters
from proxops.systems.transit_program import TransitProgram
from proxops.systems.velocity_kicks import VelocityKicks
from proxops.systems.weighted_program import ErrorWeights, WeightedProgram

__all__ = [
    "AgreementGate",
    "AssuranceLimits",
    "BackupBraking",
    "CheckSchedule",
    "DecisionReason",
    "DelayedHold",
    "EnabledValue",
    "ErrorWeights",
    "FlightMonitor",
    "ForceNoise",
    "GateKind",
    "Gravity",
    "GravityField",
    "Horizon",
    "HybridSelector",
    "InputError",
    "InterventionReason",
    "LearnedLidar",
    "Lidar",
    "LidarBundle",
    "ModelPredictiveController",
    "NeuralPolicy",
    "PeriodRule",
    "Plan",
    "PlanReason",
    "PlanStatus",
    "PlanarLidar",
    "PointMassField",
    "PolicyBundle",
    "PolicyStatus",
    "PolyhedralGravity",
    "PolyhedralGravity_",
    "Polyhedron",
    "ProportionalDerivative",
    "RandomWalkDisturbance",
    "RayCaster",
    "RayFan",
    "ReachModel",
    "RuntimeAssurance",
    "Spacecraft",
    "Spacecraft_",
    "StateNoise",
    "Thrusters",
    "TransitLimits",
    "TransitProgram",
    "VelocityKicks",
    "WeightedProgram",
    "effective_field",
    "find_equilibria",
    "jacobi_integral",
    "plane_cut",
    "ray_directions",
    "surface_map",
]
