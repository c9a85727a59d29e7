"""The expert: a model predictive controller built on Drake's MathematicalProgram.

Start with `ModelPredictiveController`, the system. At each step it solves a convex program,
`TransitProgram`, whose solution is a `Plan`. Both programs are built on `LinearisedTransit`: the
linearised motion (`condensed_motion`), the limits along the path (`path_limits`) and the solver.
`WeightedProgram` has the paper's cost. A new cost is a new `PlanProgram`. Changes here change every
recorded flight and the policy's training data: they raise the version.
"""

from proxops.systems.expert.condensing import Reference, condensed_motion
from proxops.systems.expert.linearised_transit import KEEP_OUT_PRICE, SLACK_PRICE
from proxops.systems.expert.model_predictive_controller import ModelPredictiveController, MpcConfig
from proxops.systems.expert.plan import Horizon, Plan, PlanProgram, PlanReason, PlanStatus
from proxops.systems.expert.transit_program import TransitProgram
from proxops.systems.expert.weighted_program import (
    ErrorWeights,
    WeightedCostConfig,
    WeightedProgram,
)

__all__ = [
    "KEEP_OUT_PRICE",
    "SLACK_PRICE",
    "ErrorWeights",
    "Horizon",
    "ModelPredictiveController",
    "MpcConfig",
    "Plan",
    "PlanProgram",
    "PlanReason",
    "PlanStatus",
    "Reference",
    "TransitProgram",
    "WeightedCostConfig",
    "WeightedProgram",
    "condensed_motion",
]
