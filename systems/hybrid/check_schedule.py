"""When a hybrid asks its MPC next."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

from proxops.systems.common import InputError
from proxops.systems.hybrid.agreement_gates import Agreement


class PeriodRule(StrEnum):
    """How the period from check to check is chosen."""

    FIXED = "fixed"
    ADAPTIVE = "adaptive"


@dataclass(frozen=True)
class CheckSchedule:
    """The period from one check to the next, in control steps.

    `fixed`: always `check_period`.

    `adaptive`: with d the difference of both forces over the gate's limit, at most 1, the period
    after an agreement is::

        check_period + (1 - d^2) (longest - check_period)

    so that forces that only just agree are checked as often as by the fixed period, and equal ones
    as seldom as may be. Forces may agree by chance, where one crosses the other, so trust is
    earned: no period is more than twice the last one or `check_period`, whichever is longer. After
    a disagreement too it is `check_period`: what the MPC has planned at the check flies. It is
    never longer than `longest`, nor than the steps after which the spacecraft, whatever its
    thrusters do, can still be braked before the keep-out ellipsoid (`reach_time`); only a period of
    one step, the next, is never refused.
    """

    rule: PeriodRule = PeriodRule.FIXED
    check_period: int = 10
    longest: int = 100

    def __post_init__(self) -> None:
        """Raises `InputError` for an unknown rule, or periods below 1."""
        if self.rule not in list(PeriodRule):
            raise InputError(f"a period rule is {', '.join(PeriodRule)}; got {self.rule!r}")
        if not (self.check_period >= 1 and self.longest >= 1):
            raise InputError(
                "checks need check_period and longest to be at least 1, got "
                f"{self.check_period} and {self.longest} steps"
            )

    def next_period(self, last: int, agreement: Agreement, limit: float, steps_in_hand: int) -> int:
        """The period after a check, in steps: at least 1.

        Args:
          last: the period before. limit: of the forces' difference, in N.
          steps_in_hand: after which, whatever the thrusters do, braking is still possible.
        """
        if self.rule == PeriodRule.FIXED:
            return self.check_period
        used = 1.0
        if agreement.agrees and limit > 0.0:
            used = min(agreement.difference / limit, 1.0)
        period = self.check_period + int((1.0 - used**2) * (self.longest - self.check_period))
        trusted = 2 * max(last, self.check_period)
        return max(1, min(period, trusted, self.longest, steps_in_hand))
