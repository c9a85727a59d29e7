"""The expert: a model predictive controller built on Drake's MathematicalProgram.

Start with `ModelPredictiveController`, the system, then `TransitProgram`, the convex program that
it solves at each step, and `Plan`, what comes out. `linearised_transit` and `condensed_motion` are
the arithmetic in between; `WeightedProgram` is the paper's cost. A new cost is a new `PlanProgram`.
"""

from proxops.systems.expert.linearised_transit import KEEP_OUT_PRICE, SLACK_PRICE
from proxops.systems.expert.model_predictive_controller import ModelPredictiveController
from proxops.systems.expert.plan import (
    Horizon,
    Plan,
    PlanProgram,
    PlanReason,
    PlanStatus,
    TransitLimits,
)
from proxops.systems.expert.transit_program import TransitProgram
from proxops.systems.expert.weighted_program import ErrorWeights, WeightedProgram

__all__ = [
    "KEEP_OUT_PRICE",
    "SLACK_PRICE",
    "ErrorWeights",
    "Horizon",
    "ModelPredictiveController",
    "Plan",
    "PlanProgram",
    "PlanReason",
    "PlanStatus",
    "TransitLimits",
    "TransitProgram",
    "WeightedProgram",
]
