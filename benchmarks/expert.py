"""Shows the expert (MPC) over a set of transits: two costs, and plants that it does not expect.

Every variant flies the same transits from the same starts to the same goals, with the same noise.
`time_and_fuel` is the default cost, in a plant as the expert believes it; `weighted` is the paper's
cost. In the other variants the plant differs from the expert's model, each without and with the
estimator of unexpected acceleration. Δv is that of the plant's force. The last column is the share
of steps at which the expert commands less than 3 % of the thrust limit. Flights are kept in the
folder of `--out`: run the command again to finish what was interrupted, or to add transits.

    python benchmarks/expert.py [--transits 50] [--seed 10001] [--only NAME ...] [--workers N]
        [--out out/expert] [--markdown table.md]
"""

from collections.abc import Sequence

import numpy as np
from _campaign import campaign_parser, fly_with_bar, show

from proxops.diagrams.flight import Row
from proxops.diagrams.scenario import load_scenario
from proxops.studies.campaigns import Variant, describe_flight

MATCHED = "time_and_fuel"
MISMATCHES: dict[str, dict] = {
    "gravity x 0.8": {"truth.gravity": 0.8},
    "gravity x 1.2": {"truth.gravity": 1.2},
    "point mass believed": {"mpc.point_mass": True},
    "mass x 0.9": {"truth.mass": 0.9},
    "mass x 1.1": {"truth.mass": 1.1},
    "thrust x 0.9": {"truth.thrusters.scale": [0.9] * 3},
    "thrust x 1.1": {"truth.thrusters.scale": [1.1] * 3},
    "the paper's disturbance": {"disturbance": {}},
}
GAIN = 0.3
VARIANTS: dict[str, dict] = {
    MATCHED: {},
    f"{MATCHED}, estimator {GAIN}": {"mpc.estimator_gain": GAIN},
    "weighted": {"mpc.cost": "weighted"},
    **{
        name + (f", estimator {gain}" if gain else ""): {**wrong, "mpc.estimator_gain": gain}
        for name, wrong in MISMATCHES.items()
        for gain in (0.0, GAIN)
    },
}
HEADINGS = (
    "success", "end error, median (m)", "greatest (m)", "end speed, greatest (m/s)",
    "Δv, median (m/s)", "Δv over matched, median", "arrival, median (s)",
    "keep-out violations",
    "collisions", "least clearance (km)", "steps below 3 % of the thrust (%)",
)  # fmt: skip


def figures(rows: Sequence[Row], matched: Sequence[Row]) -> list[str]:
    """One line of the table; Δv and arrival are of the flights that arrived."""

    def values(name: str) -> np.ndarray:
        return np.array([row[name] for row in rows])

    def median(numbers: list[float], form: str) -> str:
        return format(np.median(numbers), form) if numbers else "–"

    arrived = [row for row in rows if row["arrival_time_s"] is not None]
    ratios = [
        row["delta_v_m_s"] / best["delta_v_m_s"]
        for row, best in zip(rows, matched, strict=True)
        if row["arrival_time_s"] is not None and best["arrival_time_s"] is not None
    ]
    return [
        f"{values('success').sum()}/{len(rows)}",
        f"{np.median(values('terminal_position_error_m')):.1f}",
        f"{values('terminal_position_error_m').max():.1f}",
        f"{values('terminal_speed_m_s').max():.3f}",
        median([row["delta_v_m_s"] for row in arrived], ".1f"),
        median(ratios, ".3f"),
        median([row["arrival_time_s"] for row in arrived], ".0f"),
        str(values("keep_out_violations").sum()),
        str(values("collided").sum()),
        f"{values('min_clearance_m').min() / 1e3:.2f}",
        f"{100.0 * np.average(values('small_command_share'), weights=values('steps')):.1f}",
    ]


def main() -> None:
    parser = campaign_parser(__doc__, "out/expert", transits=50, seed=10001)
    parser.add_argument("--only", nargs="*", default=[], metavar="NAME", help="besides the first")
    asked = parser.parse_args()
    unknown = set(asked.only) - set(VARIANTS)
    if unknown:
        raise SystemExit(f"expert.py: no variant {sorted(unknown)}: {list(VARIANTS)}")
    chosen = dict.fromkeys([MATCHED, *asked.only]) if asked.only else VARIANTS
    variants = [Variant(name, "mpc", VARIANTS[name]) for name in chosen]
    scenario = load_scenario(None, {"log_ranges": False}, on_true_state=True)
    rows = fly_with_bar(variants, scenario, asked, describe=describe_flight)
    lines = {name: figures(flown, rows[MATCHED]) for name, flown in rows.items()}
    show(f"{asked.transits} transits of seed {asked.seed}", HEADINGS, lines, asked.markdown)


if __name__ == "__main__":
    main()
