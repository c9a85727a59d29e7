"""`HybridSelector`: flies a policy and checks it against the MPC now and then."""

from __future__ import annotations

import math
import time
from enum import IntEnum
from typing import NamedTuple

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import BasicVector, LeafSystem, ValueProducer

from proxops.systems.common import (
    FAR,
    Vector3,
    check_not_negative,
    check_positive,
    config,
    error_bounds,
    number,
    one_of,
)
from proxops.systems.hybrid.agreement_gates import Agreement, AgreementGate, GateKind
from proxops.systems.hybrid.check_schedule import CheckSchedule, PeriodRule
from proxops.systems.hybrid.reach_time import ReachModel
from proxops.systems.shapes import clearances


@config
class HybridConfig:
    """The hybrid: the policy flies, and the MPC checks it; see `proxops.systems.HybridSelector`."""

    # The rule by which the two forces are compared: strict, paper or printed; see
    # `proxops.systems.AgreementGate`.
    gate: str = one_of("strict", list(GateKind))
    # The forces agree if their difference is below epsilon_magnitude_n, or if the angle between
    # them is below epsilon_angle_deg. With `strict` the second test also needs sizes that differ
    # by less than epsilon_magnitude_n.
    epsilon_magnitude_n: float = number(1.0, at_least=0.0, at_most=1e7, unit="N")
    epsilon_angle_deg: float = number(10.0, at_least=0.0, at_most=1e3, unit="degrees")
    # For the gate `strict`: two forces below this size agree, and the direction of a force below it
    # is not compared.
    dead_band_n: float = number(0.2, at_least=0.0, at_most=1e7, unit="N")
    # Whether the time between two checks is fixed or adaptive; see `proxops.systems.CheckSchedule`.
    period_rule: str = one_of("fixed", list(PeriodRule))
    # Control steps from one check to the next. With the adaptive rule, this is the period
    # after two forces that disagree or that barely agree.
    check_period: int = number(10, at_least=1, at_most=1000000)
    # The longest period of the adaptive rule, after equal forces. Every period ends early enough
    # that the spacecraft should be able to stop before the keep-out ellipsoid, whatever acted.
    longest_period: int = number(100, at_least=1, at_most=1000000)
    # Standard deviations, per axis, of the errors of the state that the MPC gets.
    state_noise_position_m: float = number(0.0, at_least=0.0, at_most=FAR, unit="m")
    state_noise_velocity_m_s: float = number(0.0, at_least=0.0, at_most=1e5, unit="m/s")

    def agreement_gate(self) -> AgreementGate:
        """The gate with these limits."""
        kind, angle = GateKind(self.gate), math.radians(self.epsilon_angle_deg)
        return AgreementGate(kind, self.epsilon_magnitude_n, angle, self.dead_band_n)


class FlownBy(IntEnum):
    """Whose force acts at a control step; the numbers are those of a log's `decision`."""

    CONTROLLER = 0
    """The controller by which the flight is named: it is no hybrid."""
    MPC = 1
    POLICY = 2
    SAFETY_FILTER = 3
    """Runtime assurance changed the command. A log's `decision` does not hold this value: it is
    derived from `intervention`."""
    TOUCH = 4
    """The mission of a touch-and-go. It is derived from `touch_phase`."""
    SURVEY = 5
    """The survey of a mission, in its replay."""


class DecisionReason(IntEnum):
    """Why the MPC or the policy flies a step."""

    CHECK_AGREED = 0
    """The MPC flies, because it was asked. The policy agrees and flies until the next check."""
    CHECK_DISAGREED = 1
    """The MPC flies, because it was asked. The policy disagrees: the MPC flies until the next
    check."""
    POLICY_AGREED_BEFORE = 2
    """The policy flies, because it agreed at the last check."""
    POLICY_DISAGREED_BEFORE = 3
    """The MPC is asked and flies, because the policy disagreed at the last check."""
    PLAN_CONTINUED = 4
    """The policy disagreed at the last check. The MPC's plan of that check is continued; the MPC
    is not asked."""


class Decision(NamedTuple):
    """What the selector decides at one step."""

    force: Vector3
    """(3,) in N in K."""
    reason: DecisionReason
    left: int
    """Steps from this one to the next check."""
    until_check: FlownBy
    """Which of the two flies from the next step to the next check."""
    period: int
    """Steps from the last check to the next."""
    agreement: Agreement | None = None
    """None where the MPC was not asked."""
    clearance: float = np.nan
    """Distance to the keep-out ellipsoid in m at a check, NaN at other steps."""
    wall_time: float = 0.0
    """Time in s that the decision took, without the MPC's and the policy's own."""


class HybridSelector(LeafSystem):
    """Passes the policy's force on while it agrees with the MPC's, and asks the MPC seldom.

    ```
                        ┌────────────────┐
    mpc_force (3) ─────►│                ├─► force (3), N
    planned_force (3) ─►│ HybridSelector ├─► mpc_wanted (1): 1 if the MPC is asked at this step
    policy_force (3) ──►│                ├─► decision (1): 1 the MPC flies, 2 the policy
    state (6) ─────────►│                ├─► record (7)
    covariance (81) ───►│                │
                        └────────────────┘
    ```

    Vectors are in K, in m, m/s and N. The first step is a check; the `CheckSchedule` chooses the
    next one. At a check the `AgreementGate` compares both forces, and the MPC's force acts. If they
    agree, the policy flies until the next check. If not, the MPC flies until then: by the fixed
    rule it is asked at every step; by the adaptive rule it is not asked, and `planned_force`, the
    force of its last plan for the present time, acts. Where the state is not finite, because the
    navigation has none, the MPC has nothing to check with: the next step is a check again.

    `mpc_wanted` depends on this system's own discrete state alone: the steps left to the next
    check, by whom they are flown, and the period. Connect it to the MPC's `enable`. `mpc_force` is
    evaluated only at steps where `mpc_wanted` is 1, and `state` only at checks. So the MPC solves
    at no other step, whatever reads the outputs.

    `record` holds, for each step: the `DecisionReason`; 1 if the forces agree, 0 if not; their
    difference in N; the gate's angle in rad; the distance to the keep-out ellipsoid in m at a
    check; the steps to the next check; the wall time of the decision in s. What is unknown without
    asking the MPC is NaN.
    """

    def __init__(
        self,
        gate: AgreementGate,
        schedule: CheckSchedule,
        reach: ReachModel,
        period: float = 10.0,
        position_error: float = 0.0,
        velocity_error: float = 0.0,
        deviations: float = 0.0,
    ):
        """Takes the parts of the decision.

        Args:
          gate: compares the two forces.
          schedule: chooses the steps of the checks.
          reach: bounds the motion near the keep-out ellipsoid.
          period: control period in s.
          position_error, velocity_error: bounds, in m and m/s, of the errors of `state`.
          deviations: number of standard deviations of `covariance` (9, 9), that of
            `LidarNavigation`, added to these bounds if that port is connected.
        """
        super().__init__()
        check_positive("HybridSelector", period=period)
        check_not_negative(
            "HybridSelector",
            position_error=position_error,
            velocity_error=velocity_error,
            deviations=deviations,
        )
        self.gate, self.schedule, self.reach, self.period = gate, schedule, reach, period
        self.position_error, self.velocity_error = position_error, velocity_error
        self.deviations = deviations
        self._mpc_port = self.DeclareVectorInputPort("mpc_force", 3)
        self._planned_port = self.DeclareVectorInputPort("planned_force", 3)
        self._policy_port = self.DeclareVectorInputPort("policy_force", 3)
        self._state_port = self.DeclareVectorInputPort("state", 6)
        self._covariance_port = self.DeclareVectorInputPort("covariance", 81)
        # Steps to the next check, by whom they are flown, and the period.
        self._memory = self.DeclareDiscreteState(BasicVector([0.0, FlownBy.MPC, 0.0]))
        blank = Decision(np.zeros(3), DecisionReason.CHECK_AGREED, 0, FlownBy.MPC, 0)
        # One cache entry for all outputs and the update, so that each step is decided once.
        self._choice = self.DeclareCacheEntry(
            "decision",
            ValueProducer(allocate=lambda: AbstractValue.Make(blank), calc=self._calc_choice),
            {self.all_input_ports_ticket(), self.xd_ticket()},
        )
        depends = {self._choice.ticket()}
        own = {self.xd_ticket()}
        for name, size, calc, prerequisites in (
            ("force", 3, self._calc_force, depends),
            ("mpc_wanted", 1, self._calc_wanted, own),
            ("decision", 1, self._calc_decision, own),
            ("record", 7, self._calc_record, depends),
        ):
            self.DeclareVectorOutputPort(name, size, calc, prerequisites)
        # The update is discrete, not unrestricted: all discrete updates at one time see the state
        # before it. So the MPC, the policy and the hold read the cached decision.
        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._remember)

    def _calc_choice(self, context, value):
        left, until_check, period = map(int, context.get_discrete_state(self._memory).value())
        policy_force = self._policy_port.Eval(context)
        if left > 0 and until_check == FlownBy.POLICY:
            reason = DecisionReason.POLICY_AGREED_BEFORE
            choice = Decision(policy_force, reason, left, FlownBy.POLICY, period)
        elif not self._wanted(left, until_check):
            reason, force = DecisionReason.PLAN_CONTINUED, self._planned_port.Eval(context)
            choice = Decision(force, reason, left, FlownBy.MPC, period)
        else:
            force = self._mpc_port.Eval(context)
            state = self._state_port.Eval(context) if left == 0 else None
            started = time.perf_counter()
            agreement = self.gate.compare(force, policy_force)
            if state is None:
                reason = DecisionReason.POLICY_DISAGREED_BEFORE
                choice = Decision(force, reason, left, FlownBy.MPC, period, agreement)
            else:
                choice = self._check(context, force, agreement, state, period)
            choice = choice._replace(wall_time=time.perf_counter() - started)
        value.set_value(choice)

    def _errors(self, context) -> tuple[float, float]:
        """Bounds of the errors of position and velocity at a check, in m and m/s."""
        if self.deviations == 0.0 or not self._covariance_port.HasValue(context):
            return self.position_error, self.velocity_error
        covariance = self._covariance_port.Eval(context)
        return error_bounds(covariance, self.deviations, self.position_error, self.velocity_error)

    def _wanted(self, left: float, until_check: float) -> bool:
        """Whether the MPC is asked at a step."""
        fixed = self.schedule.rule == PeriodRule.FIXED
        return left == 0 or (until_check == FlownBy.MPC and fixed)

    def _check(
        self, context, mpc_force: np.ndarray, agreement: Agreement, state: np.ndarray, last: int
    ) -> Decision:
        """The decision at a check, `last` steps after the one before."""
        steps = 0
        if self.schedule.rule == PeriodRule.ADAPTIVE:
            errors = self._errors(context)
            steps = self.reach.steps_out_of_reach(
                state, self.period, self.schedule.longest, *errors, stopping=True
            )
        period = self.schedule.next_period(last, agreement, self.gate.magnitude, steps)
        if not np.isfinite(state).all():
            period = 1
        agrees = agreement.agrees
        return Decision(
            force=mpc_force,
            reason=DecisionReason.CHECK_AGREED if agrees else DecisionReason.CHECK_DISAGREED,
            left=period,
            until_check=FlownBy.POLICY if agrees else FlownBy.MPC,
            period=period,
            agreement=agreement,
            clearance=float(clearances(self.reach.semi_axes, state[None, :3])[0]),
        )

    def _calc_force(self, context, output):
        output.SetFromVector(self._choice.Eval(context).force)

    def _calc_wanted(self, context, output):
        left, until_check, _ = context.get_discrete_state(self._memory).value()
        output.SetFromVector([float(self._wanted(left, until_check))])

    def _calc_decision(self, context, output):
        left, until_check, _ = context.get_discrete_state(self._memory).value()
        output.SetFromVector([float(FlownBy.MPC if left == 0 else until_check)])

    def _calc_record(self, context, output):
        choice = self._choice.Eval(context)
        agrees, difference, angle = choice.agreement or (np.nan, np.nan, np.nan)
        output.SetFromVector(
            [
                choice.reason, agrees, difference, angle, choice.clearance, choice.left,
                choice.wall_time,
            ]
        )  # fmt: skip

    def _remember(self, context, discrete_state):
        choice = self._choice.Eval(context)
        memory = [choice.left - 1.0, choice.until_check, choice.period]
        discrete_state.set_value(self._memory, memory)
