"""What the paper's reproduction found, from which its report is made."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from proxops.diagrams.logs import FlightLog
from proxops.diagrams.scenario import Body, Scenario
from proxops.studies.evaluation import EXPERT
from proxops.studies.reproduction import flights as flights
from proxops.studies.reproduction.figures import path_errors
from proxops.studies.reproduction.stages import Stage
from proxops.systems.policy import PolicyBundle

SHOWN = (
    EXPERT, flights.POLICY, flights.PAPER_POLICY, flights.STRICT, flights.PAPER_GATE,
    flights.ADAPTIVE, flights.PAPER_HYBRID, flights.ZERO_STRICT,
)  # fmt: skip
"""Who is drawn, of those that fly."""
HYBRIDS = (flights.STRICT, flights.PAPER_GATE, flights.ADAPTIVE, flights.PAPER_HYBRID,
            flights.ZERO_STRICT)  # fmt: skip
"""Whose effort is compared."""
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
    """All that the report is made from."""

    command: str
    scenario: Scenario
    body: Body
    seed: int
    transit: int
    """The one that is drawn."""
    stages: Sequence[Stage]
    trained: Mapping[str, Stage]
    missing: Sequence[str]
    """Stages of training that neither ran nor had run."""
    policy: PolicyBundle
    results: Mapping[str, Mapping[str, Any]]
    """As `evaluate` gives them."""
    logs: Mapping[str, Mapping[int, FlightLog]]
    """As `fly_shown` gives them."""
    forces: Mapping[str, tuple[np.ndarray, np.ndarray]]
    """Of each policy along the MPC's flights: the MPC's (N, 3) and its own, in N."""
    efforts: Mapping[str, np.ndarray]
    """Of each hybrid that is drawn: what the MPC would command (N, 3) along its flight, in N."""

    @property
    def drawn(self) -> dict[str, FlightLog]:
        """The logs of the transit that is drawn."""
        return {name: self.logs[name][self.transit] for name in SHOWN if name in self.logs}


def error_figures(findings: Findings) -> dict[str, dict[str, float]]:
    """Distances in m from where the MPC is at the same time, of those that are drawn."""
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
    """Differences in N from what the MPC would command along the hybrids' own flights."""
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
