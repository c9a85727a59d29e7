"""When a hybrid asks its MPC next."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

from proxops.systems.agreement_gates import Agreement
from proxops.systems.errors import InputError


class PeriodRule(StrEnum):
    """How the period from check to check is chosen."""

    FIXED = "fixed"
    ADAPTIVE = "adaptive"


@dataclass(frozen=True)
class CheckSchedule:
    """The period from one check to the next, in control steps.

    `fixed`: always `check_period`.

    `adaptive`: it begins with `check_period`. With d the difference of both forces over the gate's
    limit, at most 1, an agreement multiplies it by 2^(1 - 2 d): equal forces double it, forces that
    only just agree halve it. After a disagreement, when the MPC flies until the next check, it is
    `shortest`. It is never longer than `longest`, nor than `reach_share` of the time in which
    the keep-out ellipsoid can't be reached, whatever the thrusters do, from the state at the
    check (`reach_time`); only a period of one step, the next, is never refused.
    """

    rule: PeriodRule = PeriodRule.FIXED
    check_period: int = 10
    shortest: int = 3
    longest: int = 100
    reach_share: float = 1.0

    def __post_init__(self) -> None:
        """Raises `InputError` for an unknown rule, or periods that are not 1 <= ... <= longest."""
        if self.rule not in list(PeriodRule):
            raise InputError(f"a period rule is {', '.join(PeriodRule)}; got {self.rule!r}")
        if not (self.check_period >= 1 and 1 <= self.shortest <= self.longest):
            raise InputError(
                "checks need check_period >= 1 and 1 <= shortest <= longest, got "
                f"{self.check_period}, {self.shortest} and {self.longest} steps"
            )
        if not 0.0 < self.reach_share <= 1.0:
            raise InputError(f"reach_share must be above 0 and up to 1, got {self.reach_share}")

    def next_period(
        self, last: float, agreement: Agreement, limit: float, steps_out_of_reach: int
    ) -> float:
        """The period after a check, in steps: at least 1, and fractions are kept to grow from.

        Args:
          last: the period before. limit: of the forces' difference, in N.
          steps_out_of_reach: in which the keep-out ellipsoid can't be reached.
        """
        if self.rule == PeriodRule.FIXED:
            return float(self.check_period)
        if not agreement.agrees:
            period = float(self.shortest)
        else:
            used = agreement.difference / limit if limit > 0.0 else 1.0
            period = max(last * 2.0 ** (1.0 - 2.0 * min(used, 1.0)), float(self.shortest))
        return max(1.0, min(period, self.longest, self.reach_share * steps_out_of_reach))
