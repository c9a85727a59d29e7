"""The paper's arithmetic, by its own numbers, and costs of flights whose times are known."""

from typing import Any

import pytest

from proxops.studies.figures import Result
from proxops.studies.reproduction.costs import (
    CPU_W,
    GPU_W,
    MPC_S,
    POLICY_CPU_S,
    POLICY_GPU_S,
    blind_flights,
    checks_passed,
    costs,
    energy_share,
    gain,
)


def row(**changes: Any) -> dict[str, Any]:
    nothing = {"policy_s": 0.0, "policy_s_median": None, "decision_s": 0.0}
    mpc = {"steps": 99, "mpc_solves": 100, "solve_s": 1.0, "solve_s_median": 0.009}
    return {**mpc, **nothing, "blind_steps": 0, "checks": 0, "agreed": 0, **changes}


HYBRID = row(
    mpc_solves=20, solve_s=0.3, policy_s=0.1, policy_s_median=0.0009, decision_s=0.1,
    checks=10, agreed=9,
)  # fmt: skip


def test_the_paper_s_energy() -> None:
    assert energy_share(POLICY_GPU_S, GPU_W, MPC_S, CPU_W) == pytest.approx(0.216, abs=0.001)
    assert energy_share(POLICY_CPU_S, CPU_W, MPC_S, CPU_W) == pytest.approx(0.292, abs=0.001)


def test_gain_of_the_policy_alone_and_of_none() -> None:
    assert gain(1.0, 0.138, 0.473) == pytest.approx(0.473 / 0.138)
    assert gain(0.0, 0.0, 0.473) == 1.0
    # 100 steps of 1 s by the MPC; 30 of them, and 100 of 0.2 s by the network, are 50 s.
    assert gain(0.7, 0.2, 1.0) == pytest.approx(100.0 / 50.0)


def test_costs_of_known_times() -> None:
    results = {
        "mpc": Result(flights=[row(), row(steps=299, mpc_solves=300, solve_s=3.0)]),
        "hybrid": Result(flights=[HYBRID]),
    }
    found = costs(results, "hybrid")
    assert found.saved == pytest.approx(0.8)
    assert found.solve_s == pytest.approx(0.015)
    assert found.step_s == pytest.approx(0.005)
    assert found.gain_measured == pytest.approx(2.0)
    assert found.gain_arithmetic == pytest.approx(1.0 / 0.3)
    own = costs(results, "mpc")
    assert (own.gain_measured, own.saved, own.policy_s) == (1.0, 0.0, None)


def test_what_asks_nobody_costs_nothing() -> None:
    idle = row(mpc_solves=0, solve_s=0.0, solve_s_median=None)
    found = costs({"mpc": Result(flights=[row()]), "zero": Result(flights=[idle])}, "zero")
    assert found.step_s is found.gain_measured is found.saved is None


def test_counts() -> None:
    assert blind_flights(Result(flights=[row(), row(blind_steps=3), row(blind_steps=None)])) == 1
    assert checks_passed(Result(flights=[HYBRID, row(checks=10, agreed=0)])) == pytest.approx(0.45)
    assert checks_passed(Result(flights=[row()])) is None
