"""Flights of the paper's reproduction: the variants that are compared, and forces along flights."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from proxops.diagrams.flight import make_mpc
from proxops.diagrams.logs import FlightLog, commanded_forces
from proxops.diagrams.scenario import Scenario
from proxops.studies.campaigns import Variant
from proxops.studies.figures import EXPERT
from proxops.systems.policy import PolicyBundle, policy_answer
from proxops.training.data import plans_along

POLICY, PAPER_POLICY = "policy", "policy, paper's recipe"
STRICT, PAPER_GATE, PRINTED = "hybrid, strict gate", "hybrid, paper's gate", "hybrid, printed gate"
ADAPTIVE = "hybrid, adaptive"
PAPER_HYBRID = "hybrid, paper's gate and recipe"
ZERO_STRICT, ZERO_PAPER = "always zero, strict gate", "always zero, paper's gate"
ZERO_ADAPTIVE = "always zero, adaptive"
"""Names of controllers in the report."""
HYBRIDS = (STRICT, PAPER_GATE, ADAPTIVE, PAPER_HYBRID, ZERO_STRICT)
"""The hybrids whose control effort is compared with the MPC's."""
DRAWN_VARIANTS = (EXPERT, POLICY, PAPER_POLICY, *HYBRIDS)
"""The variants whose paths are drawn."""

_ZERO_HYBRID = "proxops.diagrams.flight.hybrid_controller:zero_hybrid"


def paper_variants(policy: Path, paper_policy: Path | None, scenario: Scenario) -> list[Variant]:
    """Makes all variants that are compared, the expert first.

    Args:
      policy, paper_policy: folders of the bundles of our policy and of the paper's, if there is
        one.
      scenario: the one that all share. Its gate, period rule and assurance give way to those of
        each variant; the assured policy keeps the scenario's settings of assurance, if it has any.
    """
    plain = {"hybrid.gate": "strict", "hybrid.period_rule": "fixed", "assurance": None}
    papers = plain | {"hybrid.gate": "paper"}
    printed = plain | {"hybrid.gate": "printed"}
    adaptive = plain | {"hybrid.period_rule": "adaptive"}
    assured = {key: value for key, value in plain.items() if key != "assurance"}
    if scenario.assurance is None:
        assured["assurance"] = {}
    hybrid = f"hybrid:{policy}"
    flown = [
        Variant(EXPERT, "mpc", plain),
        Variant(POLICY, f"policy:{policy}", plain),
        Variant("policy, assured", f"policy:{policy}", assured),
        Variant(STRICT, hybrid, plain),
        Variant(PAPER_GATE, hybrid, papers),
        Variant(PRINTED, hybrid, printed),
        Variant(ADAPTIVE, hybrid, adaptive),
        Variant(ZERO_STRICT, _ZERO_HYBRID, plain),
        Variant(ZERO_PAPER, _ZERO_HYBRID, papers),
        Variant(ZERO_ADAPTIVE, _ZERO_HYBRID, adaptive),
        Variant("zero", "zero", plain),
        Variant("PD, true state", "pd", plain),
    ]
    if PolicyBundle.load(policy).estimates:
        flown.append(Variant("PD, policy's estimate", f"pd:{policy}", plain))
    if paper_policy is not None:
        flown[2:2] = [Variant(PAPER_POLICY, f"policy:{paper_policy}", plain)]
        flown.append(Variant(PAPER_HYBRID, f"hybrid:{paper_policy}", papers))
    return flown


def expert_forces(log: FlightLog) -> np.ndarray:
    """Returns the MPC's commands (N, 3) in N at the states of another controller's flight.

    They are solved after the flight, at its true states, without its deadline and the push that the
    MPC estimates in flight; NaN where the solver finds no plan.
    """
    scenario = log.scenario
    program = make_mpc(scenario, log.body).program
    states, target = log.dataset["state"].values[:-1], log.dataset["target"].values[0]
    period, cold = scenario.control_period_s, scenario.mpc.cold_iterations
    plans = plans_along(program, states, target, period, cold)
    nothing = np.full(3, np.nan)
    return np.array([nothing if plan is None else plan.forces[0] for plan in plans])


def policy_forces(bundle: PolicyBundle, log: FlightLog) -> np.ndarray:
    """Returns a policy's forces (N, 3) in N along another controller's flight.

    The log must hold the lidar's frames. The policy sees the flight from its start and keeps its
    memory from step to step, as if it flew.
    """
    data = log.dataset
    ranges = data["ranges"].values[:-1].reshape(len(data["time"]) - 1, -1)
    limit = log.scenario.spacecraft.thrust_limit_n
    # A policy is told the command, without what disturbed it.
    commanded = commanded_forces(data["force"].values, data["disturbance"].values, limit)
    applied = np.vstack([np.zeros(3), commanded[:-2]])
    memory = np.zeros(bundle.memory)
    forces = np.empty((len(ranges), 3))
    for k, frame in enumerate(ranges):
        target = data["target"].values[k]
        answer = policy_answer(bundle, frame, target, applied[k], memory, limit)
        forces[k], memory = answer.force, answer.memory
    return forces


def forces_along(bundle: PolicyBundle, logs: Sequence[FlightLog]) -> tuple[np.ndarray, np.ndarray]:
    """Returns the MPC's forces along its own flights and the policy's there, (K, 3) in N each."""
    wanted = np.concatenate([log.dataset["mpc_force"].values[:-1] for log in logs])
    said = np.concatenate([policy_forces(bundle, log) for log in logs])
    asked = np.isfinite(wanted).all(axis=1)
    return wanted[asked], said[asked]
