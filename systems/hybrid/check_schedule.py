"""`CheckSchedule`: when a hybrid checks its policy next."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

from proxops.systems.common import InputError
from proxops.systems.hybrid.agreement_gates import Agreement

_MOST_STEPS = 1_000_000


class PeriodRule(StrEnum):
    """Rule that chooses the period from one check to the next."""

    FIXED = "fixed"
    ADAPTIVE = "adaptive"


@dataclass(frozen=True)
class CheckSchedule:
    """The period from one check to the next, in control steps.

    `fixed`: always `check_period`.

    `adaptive`: with d the difference of both forces over the gate's limit, at most 1, the period
    after an agreement is::

        check_period + (1 - d^2) (longest - check_period)

    So forces that barely agree are checked as often as by the fixed rule, and equal forces after
    the longest period. Forces may agree by chance, where one crosses the other, so the period grows
    slowly: it is at most twice the last period or twice `check_period`, whichever is longer. After
    a disagreement it is `check_period`, and until then the MPC's plan of the check is continued.
    The period never exceeds `longest`, nor the number of steps after which the spacecraft, whatever
    its thrusters do, should still have room to brake before the keep-out ellipsoid (`ReachModel`).
    It is at least one step.
    """

    rule: PeriodRule = PeriodRule.FIXED
    check_period: int = 10
    longest: int = 100

    def __post_init__(self) -> None:
        """Raises `InputError` for an unknown rule, or periods outside 1 to a million steps."""
        if self.rule not in list(PeriodRule):
            raise InputError(f"a period rule is {', '.join(PeriodRule)}; got {self.rule!r}")
        if not (1 <= self.check_period <= _MOST_STEPS and 1 <= self.longest <= _MOST_STEPS):
            raise InputError(
                "checks need check_period and longest to be at least 1 and at most a million, got "
                f"{self.check_period} and {self.longest} steps"
            )

    def next_period(self, last: int, agreement: Agreement, limit: float, steps_in_hand: int) -> int:
        """The period after a check, in steps: at least 1.

        Args:
          last: the period before, in steps.
          agreement: the result of the check.
          limit: the gate's limit of the forces' difference, in N.
          steps_in_hand: number of steps after which braking is still possible, whatever the
            thrusters do.
        """
        if self.rule == PeriodRule.FIXED:
            return self.check_period
        used = 1.0
        if agreement.agrees and limit > 0.0:
            used = min(agreement.difference / limit, 1.0)
        period = self.check_period + int((1.0 - used**2) * (self.longest - self.check_period))
        trusted = 2 * max(last, self.check_period)
        return max(1, min(period, trusted, self.longest, steps_in_hand))
