"""The paper's computing times, and the arithmetic that makes ours comparable with them."""

from __future__ import annotations

import dataclasses as dc
import statistics
from collections.abc import Sequence

from proxops.diagrams.flight import Row
from proxops.studies.figures import EXPERT, Result, Results, command_count

MPC_S, POLICY_GPU_S, POLICY_CPU_S = 0.473, 0.053, 0.138
"""Time of a step: the MPC's solve, and the network's on each of the paper's machines (s)."""
CPU_W, GPU_W = 155.0, 300.0
"""Thermal design power (TDP) of the paper's processors."""
POLICY_SHARE = 0.70
"""The paper's hybrid flew its policy up to this share of the time."""
PAPER_ENERGY_GPU, PAPER_ENERGY_CPU = 0.216, 0.292
"""The energy of a step of the policy over one of the MPC, as the paper gives it."""


@dc.dataclass(frozen=True)
class Costs:
    """Times of a controller's steps beside the expert's; what it does not have is None."""

    saved: float | None = None
    """Share of steps without a solve of the MPC."""
    mpc_s: float | None = None
    """Median time in s of a solve in the expert's own flights."""
    policy_s: float | None = None
    """Median time in s of the controller's network."""
    solve_s: float | None = None
    """Mean time in s of the controller's solves; those of a hybrid come after pauses and take
    longer."""
    step_s: float | None = None
    """Mean time in s of a step with its solves, network and decisions."""
    gain_arithmetic: float | None = None
    """`gain` of the medians."""
    gain_measured: float | None = None
    """The expert's mean time of a step over `step_s`."""


def energy_share(policy_s: float, policy_w: float, mpc_s: float, mpc_w: float) -> float:
    """The energy of a policy's step over that of an MPC's step, each time multiplied by TDP."""
    return policy_s * policy_w / (mpc_s * mpc_w)


def gain(saved: float, policy_s: float, mpc_s: float) -> float:
    """The factor by which a hybrid computes less than the MPC alone.

    It is 1 / ((1 - saved) + t_policy / t_mpc): the policy runs at every step, and the MPC at the
    steps that are not saved.
    """
    return 1.0 / ((1.0 - saved) + policy_s / mpc_s)


def costs(results: Results, name: str) -> Costs:
    """The costs of a controller's flights beside the expert's on the same transits.

    The rows are those of `describe_steps`.
    """
    flights, best = results[name].flights, results[EXPERT].flights
    steps, solves = command_count(flights), _total(flights, "mpc_solves")
    mpc_s, policy_s = _median(best, "solve_s_median"), _median(flights, "policy_s_median")
    spent = sum(_total(flights, key) for key in ("solve_s", "policy_s", "decision_s"))
    if spent == 0.0 or mpc_s is None:
        return Costs(mpc_s=mpc_s)
    saved = 1.0 - solves / steps
    return Costs(
        saved=saved,
        mpc_s=mpc_s,
        policy_s=policy_s,
        solve_s=_total(flights, "solve_s") / solves if solves else None,
        step_s=spent / steps,
        gain_arithmetic=gain(saved, policy_s or 0.0, mpc_s),
        gain_measured=_total(best, "solve_s") / command_count(best) / (spent / steps),
    )


def _total(rows: Sequence[Row], key: str) -> float:
    return float(sum(row[key] for row in rows))


def _median(rows: Sequence[Row], key: str) -> float | None:
    values = [row[key] for row in rows if row[key] is not None]
    return statistics.median(values) if values else None


def blind_flights(result: Result) -> int:
    """Counts flights with a step at which no ray returned: the body was out of lidar range."""
    return sum(bool(row["blind_steps"]) for row in result.flights)


def checks_passed(result: Result) -> float | None:
    """The share of a hybrid's checks at which both forces agreed; None without checks."""
    checks = sum(row["checks"] for row in result.flights)
    return sum(row["agreed"] for row in result.flights) / checks if checks else None
