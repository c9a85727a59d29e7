"""Flights of the paper's reproduction: who flies, what is kept of each, and those to be drawn."""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from proxops.diagrams.flight import (
    Flight,
    Row,
    make_controller,
    run_campaign,
    run_groups,
    transit_flights,
)
from proxops.diagrams.logs import FlightLog
from proxops.diagrams.scenario import AssuranceConfig, Scenario
from proxops.studies.evaluation import EXPERT, aggregate
from proxops.systems.policy import PolicyBundle, policy_answer
from proxops.training.data import plans_along

POLICY, PAPER_POLICY = "policy", "policy, paper's recipe"
STRICT, PAPER_GATE, PRINTED = "hybrid, strict gate", "hybrid, paper's gate", "hybrid, printed gate"
ADAPTIVE = "hybrid, adaptive"
PAPER_HYBRID = "hybrid, paper's gate and recipe"
ASSURED = "policy, assured"
ZERO_STRICT, ZERO_PAPER = "always zero, strict gate", "always zero, paper's gate"
ZERO_ADAPTIVE = "always zero, adaptive"
"""Names of controllers in the report."""

_TIMES = {"solve": "solve_time", "policy": "policy_time", "decision": "decision_time"}
_ZERO_HYBRID = "proxops.diagrams.flight.hybrid_controller:zero_hybrid"


@dc.dataclass(frozen=True)
class Variant:
    """A controller and the settings that it flies with."""

    name: str
    controller: str
    """As `named_controller` knows it."""
    gate: str = "strict"
    period_rule: str = "fixed"
    assured: bool = False

    def scenario(self, scenario: Scenario) -> Scenario:
        """The scenario that it flies, made from the one that all fly."""
        hybrid = dc.replace(scenario.hybrid, gate=self.gate, period_rule=self.period_rule)
        assurance = (scenario.assurance or AssuranceConfig()) if self.assured else None
        return dc.replace(scenario, hybrid=hybrid, assurance=assurance)


def variants(policy: Path, paper_policy: Path | None) -> list[Variant]:
    """All that are compared, the expert first.

    Args:
      policy, paper_policy: folders of the bundles of our policy and of the paper's, if there is
        one.
    """
    hybrid = f"hybrid:{policy}"
    flown = [
        Variant(EXPERT, "mpc"),
        Variant(POLICY, f"policy:{policy}"),
        Variant(ASSURED, f"policy:{policy}", assured=True),
        Variant(STRICT, hybrid),
        Variant(PAPER_GATE, hybrid, gate="paper"),
        Variant(PRINTED, hybrid, gate="printed"),
        Variant(ADAPTIVE, hybrid, period_rule="adaptive"),
        Variant(ZERO_STRICT, _ZERO_HYBRID),
        Variant(ZERO_PAPER, _ZERO_HYBRID, gate="paper"),
        Variant(ZERO_ADAPTIVE, _ZERO_HYBRID, period_rule="adaptive"),
        Variant("zero", "zero"),
        Variant("PD, true state", "pd"),
    ]
    if PolicyBundle.load(policy).estimates:
        flown.append(Variant("PD, policy's estimate", f"pd:{policy}"))
    if paper_policy is not None:
        flown[2:2] = [Variant(PAPER_POLICY, f"policy:{paper_policy}")]
        flown.append(Variant(PAPER_HYBRID, f"hybrid:{paper_policy}", gate="paper"))
    return flown


def evaluate(
    flown: Sequence[Variant],
    scenario: Scenario,
    seed: int,
    count: int,
    folder: Path,
    *,
    workers: int | None = None,
    scheduler: str | None = None,
    progress: Callable[[Row], None] | None = None,
) -> dict[str, dict[str, Any]]:
    """Transits 0 … count - 1 of a seed by each variant: their entries of `results.json` by name.

    One campaign, so that the processes are started once; see `run_campaign`.
    """
    groups = run_groups(
        {each.name: _variant_flights(each, scenario, seed, range(count)) for each in flown},
        folder,
        describe=describe_flight,
        workers=workers,
        scheduler=scheduler,
        progress=progress,
    )
    return {
        name: aggregate(group, None if name == EXPERT else groups[EXPERT])
        for name, group in groups.items()
    }


def describe_flight(log: FlightLog, path: Path | None) -> Row:
    """A flight's summary, how long it saw nothing, its checks, and what all its steps cost.

    `blind_steps` counts the steps at which no ray returned; None if the log has no frames. `checks`
    counts those of a hybrid, `agreed` those that passed. Wall times in s of the MPC's solves,
    of the network and of deciding between them: `solve_s`, `policy_s`, `decision_s` of all, and
    `solve_s_median`, … of one, None if there is none.
    """
    data = log.dataset
    blind = None
    if "ranges" in data:
        seen = np.isfinite(data["ranges"].values[:-1]).any(axis=(1, 2))
        blind = int(np.sum(~seen))
    times: dict[str, float | None] = {}
    for name, column in _TIMES.items():
        taken = data[column].values if column in data else np.zeros(0)
        taken = taken[np.isfinite(taken)]
        times[f"{name}_s"] = float(taken.sum())
        times[f"{name}_s_median"] = float(np.median(taken)) if taken.size else None
    agreement = data["agreement"].values[:-1] if "agreement" in data else np.zeros(0)
    checks = {
        "checks": int(np.isfinite(agreement).sum()), "agreed": int((agreement == 1.0).sum())
    }  # fmt: skip
    return log.summary | {"blind_steps": blind, **checks, **times}


def fly_shown(
    flown: Sequence[Variant],
    scenario: Scenario,
    seed: int,
    transits: Mapping[str, Sequence[int]],
    folder: Path,
    *,
    workers: int | None = None,
    scheduler: str | None = None,
) -> None:
    """Logs a few transits: flights repeat bit for bit, so they are reflown.

    Args:
      transits: the numbers of each variant that is to be shown, by its name.
    """
    flights = [
        flight
        for each in flown
        for flight in _variant_flights(each, scenario, seed, transits.get(each.name, ()))
    ]
    run_campaign(flights, folder, keep_logs=True, workers=workers, scheduler=scheduler)


def shown_logs(
    folder: Path, seed: int, transits: Mapping[str, Sequence[int]]
) -> dict[str, dict[int, FlightLog]]:
    """What `fly_shown` logged, by name and number."""
    return {
        name: {k: FlightLog.load(folder / f"{_flight_name(name, seed, k)}.nc") for k in numbers}
        for name, numbers in transits.items()
    }


def _flight_name(name: str, seed: int, index: int) -> str:
    return f"{label(name)}-{seed}-{index:05d}"


def _variant_flights(
    variant: Variant, scenario: Scenario, seed: int, transits: Sequence[int]
) -> list[Flight]:
    if not len(transits):
        return []
    everything = transit_flights(
        variant.scenario(scenario), variant.controller, seed, max(transits) + 1
    )
    return [
        dc.replace(everything[index], name=_flight_name(variant.name, seed, index))
        for index in transits
    ]


def label(name: str) -> str:
    """A variant's name as it may stand in a file's."""
    words = "".join(letter if letter.isalnum() else " " for letter in name.replace("'", ""))
    return "-".join(words.split())


def expert_forces(log: FlightLog) -> np.ndarray:
    """What the MPC would command (N, 3), in N, at every step of a flight of somebody else.

    Solved after the flight, at its true states; NaN where the solver finds nothing.
    """
    scenario = log.scenario
    program = make_controller(scenario, log.body).program
    states, target = log.dataset["state"].values[:-1], log.dataset["target"].values[0]
    period, cold = scenario.control_period_s, scenario.mpc.cold_iterations
    plans = plans_along(program, states, target, period, cold)
    nothing = np.full(3, np.nan)
    return np.array([nothing if plan is None else plan.forces[0] for plan in plans])


def policy_forces(bundle: PolicyBundle, log: FlightLog) -> np.ndarray:
    """What a policy says (N, 3), in N, along a flight of somebody else whose log has its frames.

    It sees the flight from its start, and remembers, as if it flew along.
    """
    data = log.dataset
    ranges = data["ranges"].values[:-1].reshape(len(data["time"]) - 1, -1)
    applied = np.vstack([np.zeros(3), data["force"].values[:-2]])
    memory = np.zeros(bundle.memory)
    forces = np.empty((len(ranges), 3))
    limit = log.scenario.spacecraft.thrust_limit_n
    for k, frame in enumerate(ranges):
        target = data["target"].values[k]
        answer = policy_answer(bundle, frame, target, applied[k], memory, limit)
        forces[k], memory = answer.force, answer.memory
    return forces


def forces_along(bundle: PolicyBundle, logs: Sequence[FlightLog]) -> tuple[np.ndarray, np.ndarray]:
    """The MPC's forces (K, 3) along its flights, where it was asked, and the policy's, in N."""
    wanted = np.concatenate([log.dataset["mpc_force"].values[:-1] for log in logs])
    said = np.concatenate([policy_forces(bundle, log) for log in logs])
    asked = np.isfinite(wanted).all(axis=1)
    return wanted[asked], said[asked]
