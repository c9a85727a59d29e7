"""Shows what runtime assurance costs good controllers, and what they do beyond its box of errors.

The MPC, the policy and the hybrid fly the same transits on navigation, in worlds that are drawn
from dispersions: without assurance; with it, told these dispersions as its bounds; and, with
`--twice`, with it in worlds that are twice as far off, of which neither assurance nor navigation is
told. Δv is over that of the same controller without assurance in the worlds as drawn, on the
transits in which both succeed. Flights are kept in the folder of `--out`: run the command again to
finish what was interrupted, or to add transits.

    python benchmarks/assured_transits.py [--controllers mpc policy hybrid]
        [--dispersions after_survey] [--twice] [--transits 20] [--seed 62] [--workers N]
        [--out out/assured-transits] [--markdown table.md]
"""

import functools
from collections.abc import Sequence

from _campaign import campaign_parser, fly_with_bar, show
from _farther_off import farther_off

from proxops.diagrams.flight import Row
from proxops.diagrams.scenario import is_blocked, load_scenario
from proxops.studies.campaigns import Variant
from proxops.studies.figures import delta_v_pairs

HEADINGS = (
    "success", "flights that entered", "least clearance (km)", "Δv over that without", "greatest",
    "greatest, blocked", "changed steps", "flights with any", "to keep out",
)  # fmt: skip


def figures(rows: Sequence[Row], without: Sequence[Row]) -> list[str]:
    """One line of the table."""
    flown = [row for row in rows if "unflyable" not in row]
    if not flown:
        return ["0/0", *["–"] * (len(HEADINGS) - 1)]
    changes = [row.get("interventions") for row in flown]
    kept_out = sum(row.get("interventions_keep_out") or 0 for row in flown)
    pairs = delta_v_pairs(rows, without)
    blocked = delta_v_pairs(
        *([row for row in group if of_blocked(row)] for group in (rows, without))
    )
    assured = changes[0] is not None
    return [
        f"{sum(row['success'] for row in flown)}/{len(flown)}",
        str(sum(row["keep_out_violations"] > 0 for row in flown)),
        f"{min(row['min_clearance_m'] for row in flown) / 1e3:.2f}",
        f"{(pairs[:, 0] / pairs[:, 1]).mean():.4f}" if len(pairs) else "–",
        f"{(pairs[:, 0] / pairs[:, 1]).max():.3f}" if len(pairs) else "–",
        f"{(blocked[:, 0] / blocked[:, 1]).max():.3f}" if len(blocked) else "–",
        str(sum(changes)) if assured else "–",
        str(sum(count > 0 for count in changes)) if assured else "–",
        str(kept_out) if assured else "–",
    ]


def of_blocked(row: Row) -> bool:
    """Whether the straight line of a flight's transit is blocked."""
    return is_blocked(row["transit"])


def main() -> None:
    parser = campaign_parser(__doc__, "out/assured-transits", transits=20, seed=62)
    usual = ["mpc", "policy", "hybrid"]
    parser.add_argument("--controllers", nargs="+", default=usual, metavar="NAME")
    parser.add_argument("--dispersions", default="after_survey")
    parser.add_argument("--twice", action="store_true", help="also twice as far off")
    asked = parser.parse_args()
    told = {"assurance": {"bounds": asked.dispersions}}
    lines = {}
    scenario = load_scenario(None, {"log_ranges": False, "dispersions": asked.dispersions})
    for controller in asked.controllers:
        variants = [
            Variant(controller, controller),
            Variant(f"{controller}, assured", controller, told),
        ]
        if asked.twice:
            name = f"{controller}, assured, twice as far off"
            twice = functools.partial(farther_off, times=2.0)
            variants.append(Variant(name, controller, told, world=twice))
        rows = fly_with_bar(variants, scenario, asked)
        lines |= {name: figures(flown, rows[controller]) for name, flown in rows.items()}
    title = f"Transits 0 … {asked.transits - 1} of seed {asked.seed}, worlds of {asked.dispersions}"
    show(title, HEADINGS, lines, asked.markdown)


if __name__ == "__main__":
    main()
