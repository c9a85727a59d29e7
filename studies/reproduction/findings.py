"""The findings of the paper's reproduction, from which its report is made."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from proxops.diagrams.logs import FlightLog
from proxops.diagrams.scenario import Body, Scenario
from proxops.studies.evaluation import EXPERT
from proxops.studies.reproduction import flights
from proxops.studies.reproduction.figures import path_errors
from proxops.studies.reproduction.stages import Stage
from proxops.systems.policy import PolicyBundle

SHOWN = (
    EXPERT, flights.POLICY, flights.PAPER_POLICY, flights.STRICT, flights.PAPER_GATE,
    flights.ADAPTIVE, flights.PAPER_HYBRID, flights.ZERO_STRICT,
)  # fmt: skip
"""The variants that are drawn."""
HYBRIDS = (flights.STRICT, flights.PAPER_GATE, flights.ADAPTIVE, flights.PAPER_HYBRID,
            flights.ZERO_STRICT)  # fmt: skip
"""The hybrids whose control effort is compared with the MPC's."""
STAGE_NAMES = {
    "lidar": "the learned lidar",
    "data-paper": "the paper's 400 flights",
    "policy-paper": "the policy by the paper's recipe",
    "data-full": "our flights",
    "policy-pilot": "our policy from them",
    "policy-dagger": "its rounds of DAgger",
}


@dataclass(frozen=True)
class Findings:
    """Everything that the report is made from."""

    command: str
    scenario: Scenario
    body: Body
    seed: int
    transit: int
    """Number of the transit that is drawn."""
    stages: Sequence[Stage]
    trained: Mapping[str, Stage]
    missing: Sequence[str]
    """Stages of training without a result, from this run or an earlier one."""
    policy: PolicyBundle
    results: Mapping[str, Mapping[str, Any]]
    """Entries of `results.json` by variant."""
    logs: Mapping[str, Mapping[int, FlightLog]]
    """Logs of the flights that are drawn, by variant and transit."""
    forces: Mapping[str, tuple[np.ndarray, np.ndarray]]
    """For each policy, forces along the MPC's flights: the MPC's and the policy's, (N, 3) in N."""
    efforts: Mapping[str, np.ndarray]
    """For each hybrid that is drawn, the MPC's command (N, 3) in N at the states of its flight."""

    @property
    def drawn(self) -> dict[str, FlightLog]:
        """The logs of the transit that is drawn, by variant."""
        return {name: self.logs[name][self.transit] for name in SHOWN if name in self.logs}


def error_figures(findings: Findings) -> dict[str, dict[str, float]]:
    """Figures of the distance in m from the MPC's position at the same time, by variant."""
    drawn = findings.drawn
    figures = {}
    for name, log in drawn.items():
        if name != EXPERT:
            _, errors = path_errors(drawn[EXPERT], log)
            figures[name] = {
                "median": float(np.median(errors)),
                "greatest": float(errors.max()),
                "end": float(errors[-1]),
            }
    return figures


def effort_figures(findings: Findings) -> dict[str, dict[str, float]]:
    """Figures of the difference in N from the MPC's command along the hybrids' own flights."""
    figures = {}
    for name, expert in findings.efforts.items():
        force = findings.drawn[name].dataset["force"].values[:-1]
        sizes = np.linalg.norm(force - expert, axis=1)
        sizes = sizes[np.isfinite(sizes)]
        if sizes.size:
            figures[name] = {
                "median": float(np.median(sizes)),
                "p95": float(np.percentile(sizes, 95)),
                "within_1_n": float(np.mean(sizes < 1.0)),
            }
    return figures
