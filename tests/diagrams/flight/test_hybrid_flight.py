"""The hybrid flown: how often the MPC solves, what the log says, and the commands that fly it."""

from pathlib import Path

import numpy as np
import pytest
from known_policies import DeadReckoning, write_policy
from pydrake.systems.framework import DiagramBuilder, LeafSystem
from short_flights import Scripted, kleopatra, short_scenario

from proxops.diagrams.flight.hybrid_controller import make_hybrid
from proxops.diagrams.flight.scenario_systems import make_mpc
from proxops.diagrams.flight.simulation import fly
from proxops.diagrams.logs.flight_log import FlightLog, differences
from proxops.diagrams.scenario import Scenario, load_scenario
from proxops.systems import DecisionReason, InputError, ModelPredictiveController, ReachModel
from proxops.systems.shapes.ellipsoid import clearances

# 45 steps, wherever it is then; both forces always agree by `TRUSTING`.
BRIEF = {"arrival__deadline_s": 400.0, "arrival__dwell_s": 50.0, "log_ranges": False}
TRUSTING = {"hybrid__epsilon_magnitude_n": 100.0}
DOUBTING = {"hybrid__epsilon_magnitude_n": 6.0, "hybrid__check_period": 5}
CHECKS = np.arange(0, 45, 10)


@pytest.fixture(scope="module")
def bundle(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_policy(tmp_path_factory.mktemp("policy") / "policy", DeadReckoning())


def brief(bundle: Path, **changes: object) -> Scenario:
    return short_scenario(**(BRIEF | {"policy__bundle": str(bundle)} | changes))


@pytest.fixture(scope="module")
def trusting(bundle: Path) -> FlightLog:
    return fly(brief(bundle, **TRUSTING), "hybrid")


@pytest.fixture(scope="module")
def doubting(bundle: Path) -> FlightLog:
    """By this gate the policy, which knows no gravity, fails some checks."""
    return fly(brief(bundle, **DOUBTING, disturbance={}, noise_seed=3), "hybrid")


# --- how often the MPC solves ---------------------------------------------------------------------


class Solves:
    """Counts the times at which a plan is made: none twice, none that was not asked for."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch):
        self.times: list[float] = []
        now = [0.0]
        solve = ModelPredictiveController._solve
        recall = ModelPredictiveController._recall

        def counted(controller, *given):
            self.times.append(now[0])
            return solve(controller, *given)

        def recalled(controller, context):
            now[0] = context.get_time()
            return recall(controller, context)

        monkeypatch.setattr(ModelPredictiveController, "_solve", counted)
        monkeypatch.setattr(ModelPredictiveController, "_recall", recalled)


@pytest.mark.parametrize("rule", ["fixed", "adaptive"])
def test_no_step_solves_that_the_record_does_not_want(
    bundle: Path, rule: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    solves = Solves(monkeypatch)
    settings = DOUBTING | {"hybrid__period_rule": rule}
    log = fly(brief(bundle, **settings, disturbance={}, noise_seed=4), "hybrid")
    by_mpc = log.dataset["decision"].values == 1
    assert 0 < by_mpc.sum() < len(by_mpc)
    asked = by_mpc & (log.dataset["decision_reason"].values != DecisionReason.PLAN_CONTINUED)
    assert (by_mpc == asked).all() == (rule == "fixed")
    assert solves.times == log.dataset["time"].values[asked].tolist()
    assert log.summary["mpc_solves"] == asked.sum()


def test_policy_that_is_the_expert(monkeypatch: pytest.MonkeyPatch) -> None:
    """It always agrees, the flight is the expert's, and old plans settle in few iterations."""
    scenario = short_scenario(**BRIEF)
    expert = fly(scenario, "mpc").dataset
    hybrid = make_hybrid(scenario, kleopatra(), make_mpc(scenario, kleopatra()))
    program = hybrid.GetSubsystemByName("mpc").program  # type: ignore[attr-defined]
    calls: list[int] = []
    solve = program.solve

    def counted(state, target, previous, age, iterations, *task):
        calls.append(iterations)
        return solve(state, target, previous, age, iterations, *task)

    monkeypatch.setattr(program, "solve", counted)
    data = fly(scenario, hybrid).dataset
    assert data["solve_reason"].values[CHECKS].tolist() == [1.0, 2.0, 2.0, 2.0, 2.0]
    assert calls[0] == 10
    assert set(calls[1:]) == {1}
    assert 4 <= len(calls) - 1 <= 4 * 5
    assert (data["agreement"].values[CHECKS] == 1.0).all()
    np.testing.assert_allclose(data["force"], expert["force"], atol=0.02)
    np.testing.assert_allclose(data["state"], expert["state"], atol=1.0)


# --- the log --------------------------------------------------------------------------------------


def test_record_is_that_of_both_forces(doubting: FlightLog) -> None:
    """Gate and clearance again, from the forces and states in the log."""
    data = doubting.dataset.isel(time=slice(0, -1))
    reasons = data["decision_reason"].values
    assert set(reasons) == set(DecisionReason) - {DecisionReason.PLAN_CONTINUED}
    mpc, policy = data["mpc_force"].values, data["policy_force"].values
    known = np.isfinite(mpc).all(axis=1)
    apart = np.linalg.norm(mpc - policy, axis=1)
    np.testing.assert_allclose(data["force_difference"], apart)
    cosine = np.sum(mpc * policy, axis=1)
    sizes = np.linalg.norm(mpc, axis=1), np.linalg.norm(policy, axis=1)
    angle = np.arccos(np.clip(cosine / sizes[0] / sizes[1], -1.0, 1.0))
    np.testing.assert_allclose(data["force_angle"], angle, atol=1e-6)
    strict = (apart < 6.0) | ((angle < np.radians(10.0)) & (np.abs(sizes[0] - sizes[1]) < 6.0))
    np.testing.assert_array_equal(data["agreement"], np.where(known, strict, np.nan))
    checks = np.isin(reasons, [DecisionReason.CHECK_AGREED, DecisionReason.CHECK_DISAGREED])
    np.testing.assert_array_equal(checks, np.arange(len(reasons)) % 5 == 0)
    above = clearances(doubting.body.keep_out_semi_axes, data["state"].values[:, :3])
    np.testing.assert_allclose(data["check_clearance"], np.where(checks, above, np.nan))
    np.testing.assert_array_equal(data["steps_to_check"], 5 - np.arange(len(reasons)) % 5)
    # After a check that failed the MPC flies on, else the policy.
    failed = np.repeat(strict[checks] == 0, 5)[: len(reasons)]
    np.testing.assert_array_equal(data["decision"], np.where(checks | failed, 1, 2))
    meanings = data["decision_reason"].attrs["flag_meanings"].split()
    assert meanings == [reason.name.lower() for reason in DecisionReason]


# --- a state that is known with errors ------------------------------------------------------------


def test_noisy_state_is_the_expert_s_alone(bundle: Path, trusting: FlightLog) -> None:
    noisy = TRUSTING | {
        "hybrid__state_noise_position_m": 200.0,
        "hybrid__state_noise_velocity_m_s": 0.3,
    }
    log = fly(brief(bundle, **noisy), "hybrid")
    first, exact = log.dataset["mpc_force"].values[0], trusting.dataset["mpc_force"].values[0]
    assert np.abs(first - exact).max() > 0.01
    np.testing.assert_array_equal(
        log.dataset["policy_force"].values[0], trusting.dataset["policy_force"].values[0]
    )
    above = clearances(log.body.keep_out_semi_axes, log.dataset["state"].values[CHECKS, :3])
    off = log.dataset["check_clearance"].values[CHECKS] - above
    assert (np.abs(off) > 0.1).all()
    assert np.abs(off).max() < 1e3
    assert differences(log, fly(log.scenario, "hybrid")) == []
    other = fly(brief(bundle, noise_seed=1, **noisy), "hybrid")
    assert "mpc_force" in differences(log, other)


def test_a_policy_with_a_delay_is_refused() -> None:
    """What else does not fit is refused as in a flight alone: see `test_transit_diagram`."""
    late = Scripted()
    late.delay = 5.0
    with pytest.raises(InputError, match="with a delay of 5 s: the MPC's command has none"):
        make_hybrid(short_scenario(), kleopatra(), late)


# --- a whole flight -------------------------------------------------------------------------------


class Blurred(LeafSystem):
    """A state with slow errors of some 50 m and 0.1 m/s."""

    def __init__(self):
        super().__init__()
        self._state_port = self.DeclareVectorInputPort("state", 6)
        self.DeclareVectorOutputPort("state", 6, self._calc)

    def _calc(self, context, output):
        error = np.sin(context.get_time() / np.array([170.0, 310.0, 70.0, 90.0, 130.0, 210.0]))
        output.SetFromVector(self._state_port.Eval(context) + error * np.repeat([70.0, 0.14], 3))


@pytest.mark.slow
def test_adaptive_saves_what_fixed_cannot() -> None:
    """A policy as good as an expert that knows its state to 50 m and 0.1 m/s."""
    scenario = load_scenario(
        None, {"transit.seed": 50, "transit.index": 3, "hybrid.period_rule": "adaptive",
               "log_ranges": False},
    )  # fmt: skip
    builder = DiagramBuilder()
    blurred = builder.AddSystem(Blurred())
    expert = builder.AddSystem(make_mpc(scenario, kleopatra()))
    builder.Connect(blurred.get_output_port(), expert.GetInputPort("state"))
    builder.ExportInput(blurred.get_input_port(), "state")
    builder.ExportInput(expert.GetInputPort("target"), "target")
    builder.ExportOutput(expert.GetOutputPort("force"), "force")
    log = fly(scenario, make_hybrid(scenario, kleopatra(), builder.Build()))
    summary, alone = log.summary, fly(scenario, "mpc").summary
    assert summary["success"]
    assert summary["mpc_solves"] <= 0.03 * summary["steps"]
    assert summary["policy_share"] >= 0.97
    assert summary["delta_v_m_s"] <= 1.05 * alone["delta_v_m_s"]
    # No period was longer than there was room to brake, from the state at its check.
    body = kleopatra()
    reach = ReachModel.of(body.gravity_field, body.keep_out_semi_axes, body.spin_rate, 0.07)
    data = log.dataset.isel(time=slice(0, -1))
    checks = np.flatnonzero(np.isfinite(data["check_clearance"].values))
    periods = data["steps_to_check"].values[checks]
    np.testing.assert_array_equal(np.diff(checks), periods[:-1])
    assert periods.max() > 50
    for check, period in zip(checks, periods, strict=True):
        state = data["state"].values[check]
        assert period <= max(1, reach.steps_out_of_reach(state, 10.0, 100, stopping=True))


class AtTheBody(LeafSystem):
    """Full thrust towards the body's centre."""

    def __init__(self):
        super().__init__()
        self._state_port = self.DeclareVectorInputPort("state", 6)
        self.DeclareVectorOutputPort("force", 3, self._calc)

    def _calc(self, context, output):
        position = self._state_port.Eval(context)[:3]
        output.SetFromVector(-7.0 * position / np.abs(position).max())


@pytest.mark.slow
def test_adaptive_keeps_out_a_policy_that_means_harm() -> None:
    """By this gate it agrees at every check: only the period keeps it out; a fixed one does not."""

    def clearance(**rule: object) -> float:
        settings = {f"hybrid.{name}": value for name, value in rule.items()} | {
            "hybrid.epsilon_magnitude_n": 1e3, "log_ranges": False, "transit.seed": 61,
            "transit.index": 0, "arrival.deadline_s": 3000.0,
        }  # fmt: skip
        scenario = load_scenario(None, settings)
        log = fly(scenario, make_hybrid(scenario, kleopatra(), AtTheBody()))
        assert (log.dataset["agreement"].values[:-1] != 0.0).all()
        assert (log.dataset["decision"].values[:-1] == 2).mean() > 0.3
        return log.summary["min_clearance_m"]

    assert clearance(period_rule="adaptive") > 0.0
    assert clearance(check_period=30) < 0.0
