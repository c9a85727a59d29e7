"""The hybrid's decision: who flies this step, and when the expert is asked again.

Start with `HybridSelector`. `AgreementGate` compares two forces, `CheckSchedule` says when the next
check is due, and `ReachModel` bounds how long the spacecraft stays out of reach of the keep-out
ellipsoid whatever the thrusters do. Each is a plain object that can be tried alone.
"""

from proxops.systems.hybrid.agreement_gates import AgreementGate, GateKind
from proxops.systems.hybrid.check_schedule import CheckSchedule, PeriodRule
from proxops.systems.hybrid.enabled_value import EnabledValue
from proxops.systems.hybrid.flown_by import FlownBy
from proxops.systems.hybrid.hybrid_selector import DecisionReason, HybridSelector
from proxops.systems.hybrid.reach_time import ReachModel

__all__ = [
    "AgreementGate",
    "CheckSchedule",
    "DecisionReason",
    "EnabledValue",
    "FlownBy",
    "GateKind",
    "HybridSelector",
    "PeriodRule",
    "ReachModel",
]
