"""What the schedule of checks alone keeps out: a policy that means harm, and agrees at every check.

The gate is opened so far that any force agrees, and nearly as equals: the policy flies between all
checks, the MPC at them, and the adaptive period is as long as it ever is. The adversaries are
those of runtime assurance, which is off. Each flies the same transits with the adaptive period and
with fixed ones. A flight counts if it enters the keep-out ellipsoid.

    python benchmarks/hybrid_safety.py [--transits 10] [--seed 61] [--duration 4000]
"""

import argparse
import os

for name in ("OMP_NUM_THREADS", "NUMBA_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ[name] = "1"

import numpy as np
from pydrake.systems.framework import LeafSystem
from rich.console import Console
from rich.progress import track
from rich.table import Table

from proxops.diagrams.flight import ADVERSARIES, Adversary, fly, make_backup, make_hybrid
from proxops.diagrams.scenario import AssuranceConfig, load_body, load_scenario

# Of the gate, in N: thrust is at most 7 N per axis.
OPEN = 1e3
RULES: dict[str, dict] = {
    "adaptive": {"hybrid.period_rule": "adaptive"},
    "every 10": {},
    "every 30": {"hybrid.check_period": 30},
}


class Hostile(LeafSystem):
    """An adversary as a system: force (3) in N by state (6)."""

    def __init__(self, adversary: Adversary):
        super().__init__()
        self._adversary = adversary
        self._state_port = self.DeclareVectorInputPort("state", 6)
        self.DeclareVectorOutputPort("force", 3, self._calc)

    def _calc(self, context, output):
        output.SetFromVector(self._adversary(self._state_port.Eval(context)))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--transits", type=int, default=10)
    parser.add_argument("--seed", type=int, default=61)
    parser.add_argument("--duration", type=float, default=4000.0, help="s")
    asked = parser.parse_args()
    console, body = Console(stderr=True), load_body("kleopatra")
    table = Table(
        title=f"{asked.transits} transits of seed {asked.seed}, {asked.duration:g} s each"
    )
    for heading in ("period", "adversary", "flights inside", "least clearance (km)", "solves (%)"):
        table.add_column(heading)
    for rule, settings in RULES.items():
        for name, adversary in ADVERSARIES.items():
            rows = []
            for index in track(range(asked.transits), f"{rule}, {name}", console=console):
                wanted = {
                    "transit.seed": asked.seed, "transit.index": index, "log_ranges": False,
                    "arrival.deadline_s": asked.duration, "hybrid.epsilon_magnitude_n": OPEN,
                }  # fmt: skip
                scenario = load_scenario(None, wanted | settings)
                backup = make_backup(scenario, body, AssuranceConfig())
                hostile = Hostile(adversary(backup, np.random.default_rng(index)))
                hybrid = make_hybrid(scenario, body, hostile)
                rows.append(fly(scenario, hybrid, body=body).summary)
            solves = sum(row["mpc_solves"] for row in rows) / sum(row["steps"] for row in rows)
            table.add_row(
                rule,
                name,
                f"{sum(row['keep_out_violations'] > 0 for row in rows)}/{len(rows)}",
                f"{min(row['min_clearance_m'] for row in rows) / 1e3:.2f}",
                f"{100.0 * solves:.0f}",
            )
    Console(width=100).print(table)


if __name__ == "__main__":
    main()
