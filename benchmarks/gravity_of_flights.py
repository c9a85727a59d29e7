"""Flies the same transits with exact gravity and with gravity from the table, and compares them.

All are told the true state, so that gravity alone differs. For each controller the table has the
flights that succeed with either, and how far apart both flights are at most: anywhere before the
first of them ends, and at their ends. Flights are kept in the folder of `--out`.

    python benchmarks/gravity_of_flights.py [--controllers mpc policy hybrid] [--transits 50]
        [--seed 10000] [--workers N] [--out out/gravity-of-flights] [--markdown table.md]
"""

import numpy as np
from _campaign import campaign_parser, logs_with_bar, show

from proxops.diagrams.logs import FlightLog
from proxops.diagrams.scenario import load_scenario
from proxops.studies.campaigns import Variant

WAYS = ("exact", "table")
HEADINGS = ("success, exact", "success, table", "apart on the way (m)", "apart at the end (m)")


def apart(exact: FlightLog, table: FlightLog) -> tuple[float, float]:
    """Greatest distance in m on the way that both flew, and the distance of their ends."""
    one, other = (log.dataset["state"].values[:, :3] for log in (exact, table))
    steps = min(len(one), len(other)) - 1  # The last row is the end, at a time of its own.
    way = np.linalg.norm(one[:steps] - other[:steps], axis=1).max()
    return float(way), float(np.linalg.norm(one[-1] - other[-1]))


def main() -> None:
    parser = campaign_parser(__doc__, "out/gravity-of-flights", transits=50, seed=10_000)
    known = ["mpc", "policy", "hybrid"]
    parser.add_argument("--controllers", nargs="+", default=known, metavar="NAME")
    asked = parser.parse_args()
    scenario = load_scenario(None, ["log_ranges=false", "navigation=!TrueState {}"])
    variants = [
        Variant(f"{who}-{way}", who, {"gravity": way}) for who in asked.controllers for way in WAYS
    ]
    logs = logs_with_bar(variants, scenario, asked)
    lines = {}
    for who in asked.controllers:
        exact, table = (logs[f"{who}-{way}"] for way in WAYS)
        far = np.array([apart(exact[number], table[number]) for number in exact])
        won = [sum(log.summary["success"] for log in each.values()) for each in (exact, table)]
        lines[who] = [f"{count} of {len(exact)}" for count in won]
        lines[who] += [f"{distance:.2g}" for distance in far.max(axis=0)]
    show(f"Gravity, exact and from the table, seed {asked.seed}", HEADINGS, lines, asked.markdown)


if __name__ == "__main__":
    main()
