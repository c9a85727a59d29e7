"""Shows what each part of our policy buys, in closed loop.

All variants fly the same transits. Without further options these are flown, all from what ships:

- `mpc`: the expert, with the true state;
- `policy`: the pilot that ships;
- `bare law`: the guidance law of least effort inside the policy, with all learned corrections zero,
  on the true state. It does not know the keep-out ellipsoid, so it fails where that is in the way;
- `bare law on the policy's estimate`: the same law on the state that the shipped policy estimates.

With `--data`, `--pilot` and `--dagger` the ladder from a coarse position to the whole pilot is
flown too. Parts are taken out of the trained pilot, and each variant is exported as a bundle. The
last one has the map of the surface, on a finer grid, in place of the field that was learned.
These options need PyTorch. Flights are kept in the folder of `--out`: run the command again to
finish what was interrupted.

    python benchmarks/ablation.py [--data out/full --pilot out/pilot --dagger out/dagger]
        [--paper out/paper-policy] [--transits 40] [--seed 50] [--workers N]
        [--out out/ablation] [--markdown table.md]

`--pilot` is the folder that `proxops train` wrote, `--dagger` the one that `proxops dagger` wrote
from it, `--paper` the one of `proxops train --recipe paper`.
"""

import argparse
from collections.abc import Sequence
from pathlib import Path

from _campaign import campaign_parser, fly_with_bar, show

from proxops.diagrams.flight import Row
from proxops.diagrams.scenario import is_blocked, load_scenario
from proxops.studies.campaigns import Variant
from proxops.studies.figures import Result, aggregate_all
from proxops.training.reports import number_text

SHIPPED = (
    Variant("mpc", "mpc"),
    Variant("policy", "policy:end-to-end"),
    Variant("bare law", "_bare_law:on_true_state"),
    Variant("bare law on the policy's estimate", "_bare_law:on_estimate"),
)
HEADINGS = (
    "success", "clear transits", "blocked transits", "collisions", "flights that entered",
    "Δv over the MPC's", "end error, median (km)", "p95 (km)", "position error, median (m)",
    "velocity error, median (m/s)",
)  # fmt: skip


def pilot_variants(asked: argparse.Namespace) -> list[Variant]:
    """The variants of a trained pilot, if one is named."""
    folders = (asked.data, asked.pilot, asked.dagger)
    if folders == (None, None, None):
        return []
    if None in folders:
        raise SystemExit("ablation.py: --data, --pilot and --dagger belong together")
    # PyTorch takes a while to import, and nothing else here needs it.
    from _pilot_variants import pilot_bundles

    bundles = pilot_bundles(
        asked.data / "flights", asked.pilot, asked.dagger, asked.out / "bundles"
    )
    return [Variant(name, f"policy:{folder.resolve()}") for name, folder in bundles.items()]


def arrivals(rows: Sequence[Row]) -> str:
    """How many flights succeeded, of how many."""
    return f"{sum(row['success'] for row in rows)}/{len(rows)}"


def cells(result: Result) -> list[str]:
    """One line of the table."""
    rows = result.flights
    return [
        arrivals(rows),
        arrivals([row for row in rows if not is_blocked(row["transit"])]),
        arrivals([row for row in rows if is_blocked(row["transit"])]),
        str(result.collisions),
        str(sum(row["keep_out_violations"] > 0 for row in rows)),
        number_text(result.expert_delta_v_ratio, ".3f"),
        number_text(result.terminal_position_error_m_median, ".3f", 1e-3),
        number_text(result.terminal_position_error_m_p95, ".3f", 1e-3),
        number_text(result.estimate_position_error_m_median, ".0f"),
        number_text(result.estimate_velocity_error_m_s_median, ".3f"),
    ]


def main() -> None:
    parser = campaign_parser(__doc__, "out/ablation", transits=40, seed=50)
    for name in ("data", "pilot", "dagger", "paper"):
        parser.add_argument(f"--{name}", type=Path, help="folder; see above")
    asked = parser.parse_args()
    variants = list(SHIPPED)
    if asked.paper is not None:
        variants.append(
            Variant("the paper's policy", f"policy:{(asked.paper / 'bundle').resolve()}")
        )
    variants += pilot_variants(asked)
    rows = fly_with_bar(
        variants, load_scenario(None, {"log_ranges": False}, on_true_state=True), asked
    )
    lines = {name: cells(result) for name, result in aggregate_all(rows).items()}
    show(f"{asked.transits} transits of seed {asked.seed}", HEADINGS, lines, asked.markdown)


if __name__ == "__main__":
    main()
