"""The hybrid: the policy flies, and the MPC checks it now and then.

Start with `HybridSelector`, the system that decides by whom a step is flown (`FlownBy`).
`AgreementGate` compares the two forces, `CheckSchedule` chooses the step of the next check, and
`ReachModel` bounds the time until the spacecraft could reach the keep-out ellipsoid, whatever its
thrusters do. These three are plain objects that can be tried alone. A new gate is a new `GateKind`,
a new schedule a new `PeriodRule`; the numbers in `FlownBy` and `DecisionReason` are in logs and
stay.
"""

from proxops.systems.hybrid.agreement_gates import AgreementGate, GateKind
from proxops.systems.hybrid.check_schedule import CheckSchedule, PeriodRule
from proxops.systems.hybrid.enabled_value import EnabledValue
from proxops.systems.hybrid.hybrid_selector import (
    DecisionReason,
    FlownBy,
    HybridConfig,
    HybridSelector,
)
from proxops.systems.hybrid.reach_time import ReachModel

__all__ = [
    "AgreementGate",
    "CheckSchedule",
    "DecisionReason",
    "EnabledValue",
    "FlownBy",
    "GateKind",
    "HybridConfig",
    "HybridSelector",
    "PeriodRule",
    "ReachModel",
]
