"""Shows what the hybrid trades: its gates, limits and periods on the same transits.

Every variant flies the same transits from the same starts to the same goals, with the same noise.
`strict, 10` is the hybrid as the default scenario configures it: the strict gate, 1 N and 10°, a
check every 10 steps. The name of another variant says how it differs; a number is the period in
steps. In the variants `zero` a policy that commands no force stands in the policy's place: what the
policy has learned shows only in what its share has over that of zero.

Solves saved are steps at which the MPC was not asked. Δv is over the MPC's on the transits in which
both arrived. The time of a step is that of the whole controller, network and MPC together, and the
last column says how many times less that is than the MPC alone takes. Flights are kept in the
folder of `--out`: run the command again to finish what was interrupted, or to add transits.

    python benchmarks/hybrid.py [--policy BUNDLE] [--transits 20] [--seed 60] [--only NAME ...]
        [--workers N] [--out out/hybrid] [--markdown table.md] [--plot trade.png]
"""

from collections.abc import Sequence
from pathlib import Path

import matplotlib.figure
import numpy as np
from _campaign import campaign_parser, fly_with_bar, show

from proxops.assets import ASSETS
from proxops.diagrams.flight import Row
from proxops.diagrams.scenario import load_scenario
from proxops.studies.campaigns import Variant
from proxops.studies.figures import command_count, delta_v_pairs
from proxops.systems.common import write_whole

SHIPPED = ASSETS / "end_to_end"
MPC, POLICY = "MPC", "policy"
ADAPTIVE = {"hybrid.period_rule": "adaptive"}
GATES = ("strict", "paper", "printed")
HYBRIDS: dict[str, dict] = {
    **{f"{gate}, 10": {"hybrid.gate": gate} for gate in GATES},
    **{f"strict, 10, {force:g} N": {"hybrid.epsilon_magnitude_n": force} for force in (0.5, 2.0)},
    **{f"strict, 10, {angle:g}°": {"hybrid.epsilon_angle_deg": angle} for angle in (5.0, 20.0)},
    **{f"strict, {period}": {"hybrid.check_period": period} for period in (2, 5, 20, 50, 100)},
    **{f"{gate}, adaptive": {"hybrid.gate": gate, **ADAPTIVE} for gate in GATES[:2]},
}
ZEROS: dict[str, dict] = {
    **{f"zero: {gate}, 10": {"hybrid.gate": gate} for gate in GATES},
    "zero: strict, adaptive": ADAPTIVE,
}
VARIANTS: dict[str, dict] = {MPC: {}, POLICY: {}, **HYBRIDS, **ZEROS}
HEADINGS = (
    "success", "keep-out violations", "least clearance (km)", "policy share (%)",
    "before arrival (%)", "solves saved (%)", "Δv over the MPC's, mean", "greatest", "a step (ms)",
    "times less than the MPC",
)  # fmt: skip


def controller_of(variant: str, bundle: Path) -> str:
    """The controller of a variant by name."""
    if variant == MPC:
        return "mpc"
    if variant in ZEROS:
        return "proxops.diagrams.flight.hybrid_controller:zero_hybrid"
    return f"{'policy' if variant == POLICY else 'hybrid'}:{bundle}"


def solves_saved(rows: Sequence[Row]) -> float:
    """Share of steps at which the MPC was not asked."""
    return 1.0 - sum(row["mpc_solves"] for row in rows) / command_count(rows)


def delta_v_ratios(rows: Sequence[Row], matched: Sequence[Row]) -> list[float]:
    """Δv over the MPC's, of the transits in which both arrived."""
    return [spent / best for spent, best in delta_v_pairs(rows, matched)]


def figures(rows: Sequence[Row], matched: Sequence[Row]) -> list[str]:
    """One line of the table."""

    def mean(name: str) -> float:
        return float(np.mean([row[name] for row in rows if row[name] is not None]))

    ratios = delta_v_ratios(rows, matched)
    # Flight by flight and then the median: what else runs on the machine comes in bursts.
    speedups = [
        best["control_ms_mean"] / row["control_ms_mean"]
        for row, best in zip(rows, matched, strict=True)
    ]
    return [
        f"{sum(row['success'] for row in rows)}/{len(rows)}",
        str(sum(row["keep_out_violations"] for row in rows)),
        f"{min(row['min_clearance_m'] for row in rows) / 1e3:.2f}",
        f"{100.0 * mean('policy_share'):.1f}",
        f"{100.0 * mean('policy_share_to_arrival'):.1f}",
        f"{100.0 * solves_saved(rows):.1f}",
        f"{np.mean(ratios):.3f}" if ratios else "–",
        f"{np.max(ratios):.3f}" if ratios else "–",
        f"{np.median([row['control_ms_mean'] for row in rows]):.2f}",
        f"{np.median(speedups):.1f}",
    ]


def trade_plot(rows: dict[str, list[Row]], title: str) -> matplotlib.figure.Figure:
    """Solves saved against Δv over the MPC's, a point for each variant."""
    figure = matplotlib.figure.Figure(figsize=(9.0, 6.0), layout="constrained")
    axes = figure.subplots()
    for variant, flown in rows.items():
        ratios = delta_v_ratios(flown, rows[MPC])
        if not ratios:
            continue
        lost = 1.0 - np.mean([row["success"] for row in flown])
        place = 100.0 * solves_saved(flown), float(np.mean(ratios))
        kind = "C7" if variant in ZEROS else "C1" if "adaptive" in variant else "C0"
        axes.plot(*place, "o" if lost == 0.0 else "x", color=kind)
        text = variant if lost == 0.0 else f"{variant} ({100.0 * lost:.0f} % fail)"
        axes.annotate(text, place, xytext=(5, 3), textcoords="offset points", fontsize=8)
    axes.axhline(1.05, color="0.7", linestyle=":")
    axes.axvline(97.0, color="0.7", linestyle=":")
    axes.set(xlabel="solves saved (%)", ylabel="Δv over the MPC's, mean", title=title)
    axes.margins(x=0.15)
    return figure


def main() -> None:
    parser = campaign_parser(__doc__, "out/hybrid", transits=20, seed=60)
    parser.add_argument(
        "--policy", type=Path, default=SHIPPED, help="a policy's bundle; default: the pilot"
    )
    parser.add_argument("--only", nargs="*", metavar="NAME", help="variants besides the MPC")
    parser.add_argument("--plot", type=Path, help="also draw solves saved against Δv there")
    asked = parser.parse_args()
    unknown = set(asked.only or ()) - set(VARIANTS)
    if unknown:
        names = ", ".join(sorted(unknown))
        raise SystemExit(f"hybrid.py: no variant {names}: {list(VARIANTS)}")
    chosen = dict.fromkeys([MPC, *asked.only]) if asked.only else VARIANTS
    variants = [
        Variant(name, controller_of(name, asked.policy.resolve()), VARIANTS[name])
        for name in chosen
    ]
    rows = fly_with_bar(
        variants, load_scenario(None, {"log_ranges": False}, on_true_state=True), asked
    )
    lines = {name: figures(flown, rows[MPC]) for name, flown in rows.items()}
    title = f"{asked.transits} transits of seed {asked.seed}"
    show(title, HEADINGS, lines, asked.markdown)
    if asked.plot:
        write_whole(
            asked.plot, lambda path: trade_plot(rows, title).savefig(path, format="png", dpi=150)
        )


if __name__ == "__main__":
    main()
