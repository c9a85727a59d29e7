"""Shows what the hybrid's schedule of checks alone keeps out: its policy is an adversary.

The gate is opened so far that any force agrees with the MPC's: the adversary flies between all
checks, the MPC at the checks, and the adaptive period is as long as it can be. The adversaries are
those that test runtime assurance, which is off here. Each flies the same transits with the adaptive
period and with fixed ones. A flight counts as inside if it enters the keep-out ellipsoid. Flights
are kept in the folder of `--out`.

    python benchmarks/hybrid_safety.py [--transits 10] [--seed 61] [--duration 4000] [--workers N]
        [--out out/hybrid-safety] [--markdown table.md]
"""

import functools
from collections.abc import Callable, Sequence

import numpy as np
from _adversaries import ADVERSARIES
from _campaign import campaign_parser, fly_with_bar, show
from pydrake.systems.framework import Diagram, LeafSystem

from proxops.diagrams.flight import Row, make_backup, make_hybrid
from proxops.diagrams.scenario import AssuranceConfig, Body, Scenario, load_scenario
from proxops.studies.campaigns import Variant
from proxops.studies.figures import command_count

# Limit of the gate in N; thrust is at most 7 N per axis.
OPEN = 1e3
RULES: dict[str, dict] = {
    "adaptive": {"hybrid.period_rule": "adaptive"},
    "every 10": {},
    "every 30": {"hybrid.check_period": 30},
}
HEADINGS = ("flights inside", "least clearance (km)", "solves (%)")


class Hostile(LeafSystem):
    """An adversary as a system: force (3) in N by state (6)."""

    def __init__(self, adversary: Callable[[np.ndarray], np.ndarray]):
        super().__init__()
        self._adversary = adversary
        self._state_port = self.DeclareVectorInputPort("state", 6)
        self.DeclareVectorOutputPort("force", 3, self._calc)

    def _calc(self, context, output):
        output.SetFromVector(self._adversary(self._state_port.Eval(context)))


def hostile_hybrid(name: str, scenario: Scenario, body: Body) -> Diagram:
    """A hybrid whose policy is the adversary of a name."""
    backup = make_backup(scenario, body, AssuranceConfig())
    adversary = ADVERSARIES[name](backup, np.random.default_rng(scenario.transit.index))
    return make_hybrid(scenario, body, Hostile(adversary))


# A controller is named MODULE:FACTORY, so each adversary has a factory.
zero = functools.partial(hostile_hybrid, "zero")
at_the_body = functools.partial(hostile_hybrid, "at the body")
random = functools.partial(hostile_hybrid, "random")
sign_flipped = functools.partial(hostile_hybrid, "sign flipped")
along_the_surface = functools.partial(hostile_hybrid, "along the surface")
searched = functools.partial(hostile_hybrid, "searched")


def figures(rows: Sequence[Row]) -> list[str]:
    """One line of the table."""
    solves = sum(row["mpc_solves"] for row in rows) / command_count(rows)
    return [
        f"{sum(row['keep_out_violations'] > 0 for row in rows)}/{len(rows)}",
        f"{min(row['min_clearance_m'] for row in rows) / 1e3:.2f}",
        f"{100.0 * solves:.0f}",
    ]


def main() -> None:
    parser = campaign_parser(__doc__, "out/hybrid-safety", transits=10, seed=61)
    parser.add_argument("--duration", type=float, default=4000.0, help="of each flight, in s")
    asked = parser.parse_args()
    settings = {"arrival.deadline_s": asked.duration, "hybrid.epsilon_magnitude_n": OPEN}
    variants = [
        Variant(f"{rule}, {name}", f"hybrid_safety:{name.replace(' ', '_')}", changes)
        for rule, changes in RULES.items()
        for name in ADVERSARIES
    ]
    rows = fly_with_bar(
        variants, load_scenario(None, {"log_ranges": False} | settings, on_true_state=True), asked
    )
    lines = {name: figures(flown) for name, flown in rows.items()}
    title = f"{asked.transits} transits of seed {asked.seed}, {asked.duration:g} s each"
    show(title, HEADINGS, lines, asked.markdown)


if __name__ == "__main__":
    main()
