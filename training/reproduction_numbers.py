"""The paper's numbers, and the arithmetic that makes ours comparable with them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from proxops.training.evaluation import EXPERT

MPC_S, POLICY_GPU_S, POLICY_CPU_S = 0.473, 0.053, 0.138
"""Time of a step: the MPC's solve, and the network's on each of the paper's machines (s)."""
CPU_W, GPU_W = 155.0, 300.0
"""Thermal design power (TDP) of the paper's processors."""
POLICY_SHARE = 0.70
"""The paper's hybrid flew its policy up to this share of the time."""
PAPER_ENERGY_GPU, PAPER_ENERGY_CPU = 0.216, 0.292
"""The energy of a step of the policy over one of the MPC, as the paper gives it."""

Costs = dict[str, float | None]


def energy_share(policy_s: float, policy_w: float, mpc_s: float, mpc_w: float) -> float:
    """The paper's arithmetic: time times TDP of a step of the policy over one of the MPC."""
    return policy_s * policy_w / (mpc_s * mpc_w)


def gain(saved: float, policy_s: float, mpc_s: float) -> float:
    """How many times less a hybrid takes than the MPC alone: 1 / ((1 - saved) + t_policy / t_mpc).

    The policy runs at every step, and the MPC at those that are not saved.
    """
    return 1.0 / ((1.0 - saved) + policy_s / mpc_s)


def costs(results: Mapping[str, Mapping[str, Any]], name: str) -> Costs:
    """What a controller's steps cost, against the expert's on the same transits.

    Returns:
      saved: share of steps at which the MPC was not asked. mpc_step_s: mean time of a solve in the
      expert's own flights; hybrid_solve_s: in this controller's, whose solves come after pauses and
      take longer; policy_step_s, decision_step_s: of a step. gain_arithmetic: by `gain`, from the
      expert's solves. gain_measured: the expert's time of a step over this controller's, with all
      that its solves, its network and its decisions really took. Figures of what it doesn't do are
      None.
    """
    flights, best = results[name]["flights"], results[EXPERT]["flights"]

    def total(rows: list[dict[str, Any]], key: str) -> float:
        return float(sum(row[key] for row in rows))

    steps, solves = total(flights, "steps"), total(flights, "mpc_solves")
    mpc_s = total(best, "solve_s") / total(best, "mpc_solves")
    policy_s = total(flights, "policy_s") / steps
    decision_s = total(flights, "decision_s") / steps
    whole = total(flights, "solve_s") / steps + policy_s + decision_s
    saved = 1.0 - solves / steps
    asked = policy_s > 0.0 or solves > 0.0
    return {
        "saved": saved if asked else None,
        "mpc_step_s": mpc_s,
        "hybrid_solve_s": total(flights, "solve_s") / solves if solves else None,
        "policy_step_s": policy_s or None,
        "decision_step_s": decision_s or None,
        "whole_step_s": whole if asked else None,
        "gain_arithmetic": gain(saved, policy_s, mpc_s) if asked else None,
        "gain_measured": total(best, "solve_s") / total(best, "steps") / whole if asked else None,
    }


def blind_flights(result: Mapping[str, Any]) -> int:
    """Flights with a step at which no ray returned: they have lost the body from lidar range."""
    return sum(bool(row["blind_steps"]) for row in result["flights"])


def checks_passed(result: Mapping[str, Any]) -> float | None:
    """Share of a hybrid's checks at which both forces agreed."""
    checks = sum(row["checks"] for row in result["flights"])
    return sum(row["agreed"] for row in result["flights"]) / checks if checks else None
