"""Shows how much room is left beyond the declared errors: success against the scale of all errors.

A controller flies the same transits in the same worlds again and again; each time every error of
the truth is larger by another factor. Navigation and runtime assurance are told the dispersions as
they are declared, whatever the factor. What is measured before a flight (the spacecraft's mass, the
size of the lidar's noise) stays as drawn, and so does the specific impulse. Flights are kept in the
folder of `--out`: run the command again to finish what was interrupted, or to add transits.

    python benchmarks/error_scale.py [--controller hybrid] [--dispersions after_survey]
        [--unassured] [--scales 1 2 3 4 6] [--transits 60] [--seed 24700] [--workers N]
        [--out out/error-scale] [--markdown table.md]
"""

import functools
from collections.abc import Sequence

import numpy as np
from _campaign import campaign_parser, fly_with_bar, show
from _farther_off import farther_off

from proxops.diagrams.flight import Row
from proxops.diagrams.scenario import load_scenario
from proxops.studies.campaigns import Variant
from proxops.studies.figures import delta_v_pairs, exact_interval
from proxops.training.reports import interval_text

HEADINGS = (
    "success", "exact 95 % interval", "flights that entered", "least clearance (km)",
    "end error, median (m)", "greatest", "Δv over that at 1 × (both arrive)",
    "steps within 3σ of the navigation (%)", "flights changed to keep out",
)  # fmt: skip


def figures(rows: Sequence[Row], declared: Sequence[Row]) -> list[str]:
    """One line of the table; `declared` are the flights with errors as declared."""
    flown = [row for row in rows if "unflyable" not in row]
    if not flown:
        return ["0 of 0", *["–"] * (len(HEADINGS) - 1)]
    successes = sum(row["success"] for row in flown)
    ends = [row["terminal_position_error_m"] for row in flown]
    pairs = delta_v_pairs(rows, declared)
    # Of a flight, the share of steps of the worst component; the mean is over flights. In a flight
    # that never had a state, the navigation is right nowhere.
    within = np.mean([row.get("navigation_consistent", 0.0) for row in flown])
    changed = [row.get("interventions_keep_out") for row in flown]
    return [
        f"{successes} of {len(flown)}",
        interval_text(exact_interval(successes, len(flown)), " to "),
        str(sum(row["keep_out_violations"] > 0 for row in flown)),
        f"{min(row['min_clearance_m'] for row in flown) / 1e3:.2f}",
        f"{np.median(ends):.0f}",
        f"{np.max(ends):,.0f}",
        f"{pairs[:, 0].sum() / pairs[:, 1].sum():.3f}" if len(pairs) else "–",
        f"{100.0 * within:.1f}",
        "–" if changed[0] is None else str(sum(count > 0 for count in changed)),
    ]


def main() -> None:
    parser = campaign_parser(__doc__, "out/error-scale", transits=60, seed=24700)
    parser.add_argument("--controller", default="hybrid")
    parser.add_argument("--dispersions", default="after_survey")
    parser.add_argument("--unassured", action="store_true", help="without runtime assurance")
    parser.add_argument("--scales", type=float, nargs="+", default=[1.0, 2.0, 3.0, 4.0, 6.0])
    asked = parser.parse_args()
    told = {} if asked.unassured else {"assurance": {"bounds": asked.dispersions}}
    scenario = load_scenario(
        None, {"log_ranges": False, "gravity": "table", "dispersions": asked.dispersions}
    )
    scales = sorted({1.0, *asked.scales})  # The first is what the others are compared with.
    variants = [
        Variant(
            f"{asked.controller}{', alone' if asked.unassured else ''}, {times:g} ×",
            asked.controller,
            told,
            world=functools.partial(farther_off, times=times),
        )
        for times in scales
    ]
    rows = fly_with_bar(variants, scenario, asked)
    declared = rows[variants[0].name]
    lines = {
        f"{times:g} ×": figures(rows[each.name], declared)
        for times, each in zip(scales, variants, strict=True)
    }
    title = (
        f"{asked.controller}{'' if asked.unassured else ', assured'}: errors of "
        f"{asked.dispersions}, larger; transits 0 … {asked.transits - 1} of seed {asked.seed}"
    )
    show(title, HEADINGS, lines, asked.markdown)


if __name__ == "__main__":
    main()
