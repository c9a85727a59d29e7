"""The selector alone, with forces of known size: whose force it takes, whom it asks, its record."""

from functools import cache

import numpy as np
import pytest
from one_system import context_of
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder, LeafSystem
from pydrake.systems.primitives import ConstantVectorSource, LogVectorOutput, ZeroOrderHold
from short_flights import kleopatra

from proxops.systems import (
    AgreementGate,
    CheckSchedule,
    DecisionReason,
    EnabledValue,
    GateKind,
    HybridSelector,
    PeriodRule,
    ReachModel,
)

PERIOD = 10.0
FAR = np.array([0.0, 0.0, 165e3, 0.0, 0.0, 0.0])
AGREED, DISAGREED, TRUSTED, GUARDED, _ = DecisionReason


@cache
def reach() -> ReachModel:
    body = kleopatra()
    return ReachModel.of(body.gravity_field, body.keep_out_semi_axes, body.spin_rate, 0.07)


class Force(LeafSystem):
    """A force (3,) that is a function of the step, which counts the steps it is asked for."""

    def __init__(self, along_x):
        super().__init__()
        self.asked: list[int] = []
        self._along_x = along_x
        self.DeclareVectorOutputPort(
            "force", 3, self._calc, prerequisites_of_calc={self.time_ticket()}
        )

    def _calc(self, context, output):
        step = round(context.get_time() / PERIOD)
        self.asked.append(step)
        output.SetFromVector([self._along_x(step), 0.0, 0.0])


def flown(steps: int, mpc, policy, schedule: CheckSchedule, gate=None, state=FAR, **errors):
    """Columns of `steps` steps, and the systems that stand for the MPC and the policy."""
    selector = HybridSelector(
        gate or AgreementGate(GateKind.PAPER), schedule, reach(), PERIOD, **errors
    )
    builder = DiagramBuilder()
    builder.AddSystem(selector)
    experts = builder.AddSystem(Force(mpc))
    planned = builder.AddSystem(Force(lambda k: 100.0 + k))
    learned = builder.AddSystem(Force(policy))
    where = builder.AddSystem(ConstantVectorSource(state))
    hold = builder.AddSystem(ZeroOrderHold(PERIOD, 3))
    asked = builder.AddSystem(EnabledValue(3))
    builder.Connect(experts.get_output_port(), selector.GetInputPort("mpc_force"))
    builder.Connect(planned.get_output_port(), selector.GetInputPort("planned_force"))
    builder.Connect(learned.get_output_port(), selector.GetInputPort("policy_force"))
    builder.Connect(where.get_output_port(), selector.GetInputPort("state"))
    builder.Connect(selector.GetOutputPort("force"), hold.get_input_port())
    builder.Connect(selector.GetOutputPort("mpc_wanted"), asked.GetInputPort("enable"))
    builder.Connect(experts.get_output_port(), asked.GetInputPort("value"))
    names = ("force", "mpc_wanted", "decision", "record")
    ports = {name: selector.GetOutputPort(name) for name in names}
    ports["mpc_force"] = asked.GetOutputPort("value")
    sinks = {
        name: LogVectorOutput(port, builder, publish_period=PERIOD) for name, port in ports.items()
    }
    simulator = Simulator(builder.Build())
    simulator.AdvanceTo((steps - 0.5) * PERIOD)
    context = simulator.get_context()
    columns = {name: sink.FindLog(context).data().T.copy() for name, sink in sinks.items()}
    for name in ("mpc_wanted", "decision"):
        columns[name] = columns[name][:, 0].astype(int)
    return columns, experts, learned


FIXED = CheckSchedule(PeriodRule.FIXED)


def test_after_a_failed_check_the_mpc_flies_until_the_next() -> None:
    """The policy is opposed from step 15 to step 45: checks at 20, 30 and 40 fail."""

    def policy(step: int) -> float:
        return -3.0 if 15 <= step < 45 else 3.0

    columns, experts, _ = flown(80, lambda k: 3.0 + 0.01 * k, policy, FIXED)
    asked = [0, 10, *range(20, 51), 60, 70]
    assert experts.asked == asked
    wanted = np.isin(np.arange(80), asked)
    np.testing.assert_array_equal(columns["mpc_wanted"] == 1, wanted)
    np.testing.assert_array_equal(columns["decision"], np.where(wanted, 1, 2))
    mpc = 3.0 + 0.01 * np.arange(80)
    learned = np.array([policy(k) for k in range(80)])
    np.testing.assert_allclose(columns["force"][:, 0], np.where(wanted, mpc, learned))
    record = columns["record"]
    reasons = np.full(80, int(TRUSTED))
    reasons[[0, 10, 50, 60, 70]] = AGREED
    reasons[20:50] = GUARDED
    reasons[[20, 30, 40]] = DISAGREED
    np.testing.assert_array_equal(record[:, 0], reasons)
    # Compared wherever both forces are there, also between failed checks.
    agrees = np.where(np.arange(80) < 45, np.where(np.arange(80) >= 15, 0.0, 1.0), 1.0)
    np.testing.assert_array_equal(record[:, 1], np.where(wanted, agrees, np.nan))
    np.testing.assert_allclose(record[:, 2], np.where(wanted, np.abs(mpc - learned), np.nan))
    np.testing.assert_allclose(
        record[:, 3], np.where(wanted, np.where(learned < 0.0, np.pi, 0.0), np.nan)
    )
    checks = np.arange(80) % 10 == 0
    np.testing.assert_allclose(record[:, 4], np.where(checks, 100e3, np.nan))
    np.testing.assert_array_equal(record[:, 5], 10 - np.arange(80) % 10)
    assert (record[wanted, 6] > 0.0).all()


def test_adaptive_period() -> None:
    """Equal forces, then some half a limit apart, one that disagrees, and equal ones again."""
    schedule = CheckSchedule(PeriodRule.ADAPTIVE, check_period=4, longest=30)
    policy = {54: 2.5, 77: -2.0}
    columns, experts, _ = flown(120, lambda k: 2.0, lambda k: policy.get(k, 2.0), schedule)
    checks = [0, 8, 24, 54, 77, 81, 89, 105]
    assert np.flatnonzero(np.isfinite(columns["record"][:, 4])).tolist() == checks
    assert experts.asked == np.flatnonzero(columns["mpc_wanted"]).tolist() == checks
    assert columns["record"][checks, 5].tolist() == [8, 16, 30, 23, 4, 8, 16, 30]
    # After the disagreement the MPC flies by its plan, and is not asked.
    assert np.flatnonzero(columns["decision"] == 1).tolist() == sorted([*checks, 78, 79, 80])
    assert columns["force"][77:82, 0].tolist() == [2.0, 178.0, 179.0, 180.0, 2.0]
    np.testing.assert_array_equal(
        columns["record"][78:81, :5], [[DecisionReason.PLAN_CONTINUED, *[np.nan] * 4]] * 3
    )


@pytest.mark.parametrize("height", [3e3, 6e3, 20e3])
def test_adaptive_leaves_room_to_brake(height: float) -> None:
    state = FAR.copy()
    state[2], state[5] = 65e3 + height, -5.0
    schedule = CheckSchedule(PeriodRule.ADAPTIVE, longest=60)
    columns, _, _ = flown(200, lambda k: 2.0, lambda k: 2.0, schedule, state=state)
    periods = columns["record"][np.isfinite(columns["record"][:, 4]), 5]
    in_hand = reach().steps_out_of_reach(state, PERIOD, 60, stopping=True)
    assert periods.max() == max(1, in_hand)
    assert in_hand < reach().steps_out_of_reach(state, PERIOD, 60)
    sure = flown(200, lambda k: 2.0, lambda k: 2.0, schedule, state=state, position_error=2e3)[0]
    allowed = reach().steps_out_of_reach(state, PERIOD, 60, 2e3, stopping=True)
    shorter = sure["record"][np.isfinite(sure["record"][:, 4]), 5]
    assert len(shorter) >= len(periods)
    assert shorter.max() == max(1, allowed)
    assert allowed < in_hand or in_hand == 0


def test_the_period_allows_for_the_covariance() -> None:
    """Four deviations along the longest axis, on top of what is known of the errors."""
    schedule = CheckSchedule(PeriodRule.ADAPTIVE, check_period=60, longest=60)
    selector = HybridSelector(
        AgreementGate(GateKind.PAPER), schedule, reach(), PERIOD, 100.0, 0.1, deviations=4.0
    )
    state = np.array([0.0, 0.0, 85e3, 0.0, 0.0, -5.0])
    turn = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
    covariance = np.zeros((9, 9))
    covariance[:3, :3] = turn @ np.diag([10.0, 50.0, 200.0]) ** 2 @ turn.T
    covariance[3:6, 3:6] = turn @ np.diag([0.01, 0.05, 0.2]) ** 2 @ turn.T
    context = context_of(selector, mpc_force=[2, 0, 0], policy_force=[2, 0, 0], state=state)
    known = selector.GetOutputPort("record").Eval(context)[5]
    selector.GetInputPort("covariance").FixValue(context, covariance.ravel())
    unsure = selector.GetOutputPort("record").Eval(context)[5]
    assert known == reach().steps_out_of_reach(state, PERIOD, 60, 100.0, 0.1, stopping=True)
    assert unsure == reach().steps_out_of_reach(state, PERIOD, 60, 900.0, 0.9, stopping=True)
    assert 1 <= unsure < known
    selector.GetInputPort("covariance").FixValue(context, np.full(81, np.nan))
    assert selector.GetOutputPort("record").Eval(context)[5] == 1.0


@pytest.mark.parametrize("rule", list(PeriodRule))
def test_without_a_state_every_step_is_a_check(rule: PeriodRule) -> None:
    nowhere = np.full(6, np.nan)
    columns, experts, _ = flown(5, lambda k: 2.0, lambda k: 2.0, CheckSchedule(rule), state=nowhere)
    assert experts.asked == list(range(5))
    assert columns["force"][:, 0].tolist() == [2.0] * 5
    assert np.isnan(columns["record"][:, 4]).all()
    assert (columns["record"][:, 5] == 1.0).all()
