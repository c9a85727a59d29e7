"""Flies the policy for any body, and its hybrids, at bodies that it never saw, beside the MPC.

Nobody sees the truth: all fly on the navigation's state, unless `--true-state` says otherwise. At
each body every controller flies the same transits, with the same noise. Δv is over the MPC's, on
the transits in which both arrived. The time of a step is that of the whole controller without the
navigation's, and the last column says how many times less that is than the MPC's.
Flights are kept in the folder of `--out`: run the command again to finish what was interrupted, or
to add transits.

    python benchmarks/any_body.py [--bodies kleopatra 20:0 … two-ellipsoids FILE.obj …]
        [--only policy hybrid …] [--dispersions after_survey] [--set KEY=VALUE …] [--true-state]
        [--transits 20] [--seed 60] [--workers N] [--out out/any-body-flights]
        [--markdown table.md]

A body is `kleopatra`, SEED:NUMBER of a random body, `two-ellipsoids`, `lumpy-ball`,
`three-one-one`, a body's YAML file, or a mesh file in km. Give each kind of dispersions and each
policy a folder of its own.
"""

import argparse
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from _bodies import GENERATED, KLEOPATRA, scenario_at
from _campaign import Lines, campaign_parser, fly_with_bar, show

from proxops.diagrams.flight import Row
from proxops.diagrams.scenario import Scenario, dump_scenario, load_body, load_scenario
from proxops.studies.campaigns import Variant
from proxops.studies.figures import command_count, delta_v_pairs
from proxops.systems.common import InputError, make_folder, write_whole

MPC = "MPC"
ASSURED = {"assurance": {}}
# A controller, and its changes to the scenario.
VARIANTS: dict[str, tuple[str, dict]] = {
    MPC: ("mpc", {}),
    "policy": ("policy", {}),
    "hybrid": ("hybrid", {}),
    "adaptive": ("hybrid", {"hybrid.period_rule": "adaptive"}),
    "policy, assured": ("policy", ASSURED),
    "hybrid, assured": ("hybrid", ASSURED),
}
RANDOM = [f"20:{number}" for number in range(10)]
HEADINGS = (
    "success", "flights that entered", "late or away", "least clearance (% of size)",
    "Δv over the MPC's, mean", "greatest", "policy share (%)", "solves saved (%)", "a step (ms)",
    "times less than the MPC",
)  # fmt: skip


def figures(rows: Sequence[Row], expert: Sequence[Row], sizes: Sequence[float]) -> list[str]:
    """One line of the table; `sizes` are the longest semi-axes in m of the rows' bodies."""
    flown = [row for row in rows if "unflyable" not in row]
    if not flown:
        return ["0/0", *["–"] * (len(HEADINGS) - 1)]
    broken = sum(row["keep_out_violations"] > 0 or row["collided"] for row in flown)
    won = sum(row["success"] for row in flown)
    room = min(
        row["min_clearance_m"] / size
        for row, size in zip(rows, sizes, strict=True)
        if "unflyable" not in row
    )
    ratios = [spent / best for spent, best in delta_v_pairs(rows, expert)]
    speedups = [
        best["control_ms_mean"] / row["control_ms_mean"]
        for row, best in zip(rows, expert, strict=True)
        if "unflyable" not in row and "unflyable" not in best
    ]
    shares = [row["policy_share"] for row in flown if row.get("policy_share") is not None]
    asked = [row for row in flown if row.get("mpc_solves") is not None]
    solves = sum(row["mpc_solves"] for row in asked)
    return [
        f"{won}/{len(flown)}",
        str(broken),
        str(len(flown) - won - broken),
        f"{100.0 * room:.2f}",
        f"{np.mean(ratios):.3f}" if ratios else "–",
        f"{np.max(ratios):.3f}" if ratios else "–",
        f"{100.0 * np.mean(shares):.1f}" if shares else "–",
        f"{100.0 * (1.0 - solves / command_count(asked)):.1f}" if asked else "–",
        f"{np.median([row['control_ms_mean'] for row in flown]):.2f}",
        f"{np.median(speedups):.1f}",
    ]


def table(flown: Mapping[str, Mapping[str, Sequence[Row]]], sizes: Mapping[str, float]) -> Lines:
    """The figures of each variant at each body, then at all bodies together if there are several.

    Args:
      flown: the rows of each variant by its name, by body.
      sizes: longest semi-axis in m of each body.
    """
    lines = {
        f"{body}, {name}": figures(rows, variants[MPC], [sizes[body]] * len(rows))
        for body, variants in flown.items()
        for name, rows in variants.items()
    }
    if len(flown) > 1:
        together = {
            name: [row for variants in flown.values() for row in variants[name]]
            for name in next(iter(flown.values()))
        }
        each = [sizes[body] for body, variants in flown.items() for _ in variants[MPC]]
        for name, rows in together.items():
            lines[f"all bodies, {name}"] = figures(rows, together[MPC], each)
    return lines


def options() -> argparse.Namespace:
    """The options of the command line; ends the program if one is wrong."""
    parser = campaign_parser(__doc__, "out/any-body-flights", transits=20, seed=60)
    known = [KLEOPATRA, *RANDOM, *GENERATED]
    parser.add_argument("--bodies", nargs="+", default=known, metavar="BODY")
    usual = ["policy", "hybrid", "adaptive"]
    parser.add_argument("--only", nargs="+", choices=VARIANTS, default=usual, metavar="NAME")
    parser.add_argument("--policy", help="a policy's bundle; default: the one that ships")
    parser.add_argument("--dispersions", help="name or file of the worlds to draw from")
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE")
    parser.add_argument("--true-state", action="store_true", help="all are told the true state")
    return parser.parse_args()


def scenario_of(body: str, asked: argparse.Namespace) -> Scenario:
    """The scenario at a body, with the changes that the command line asks for.

    Raises:
      InputError: there is no such body, or a change is wrong.
    """
    changes = list(asked.set)
    if asked.dispersions is not None:
        changes.append(f"dispersions={asked.dispersions}")
    if asked.true_state:
        changes.append("navigation=!TrueState {}")
    folder = asked.out / "bodies"
    path, text = folder / f"{label(body)}.scenario.yaml", scenario_at(body, folder)
    make_folder(folder)
    write_whole(path, lambda file: file.write_text(dump_scenario(text), encoding="utf-8"))
    return load_scenario(path, changes)


def label(body: str) -> str:
    """A body's name, as part of the name of a file."""
    return Path(body).stem.replace(":", "-")


def table_of_flights(variants: Sequence[Variant], asked: argparse.Namespace) -> Lines:
    """Flies all variants at all bodies as the command line asks; wrong input ends the program."""
    flown, sizes = {}, {}
    for body in asked.bodies:
        try:
            scenario = scenario_of(body, asked)
        except InputError as error:
            raise SystemExit(f"{body}: {error}") from error
        own = argparse.Namespace(**vars(asked) | {"out": asked.out / label(body)})
        flown[label(body)] = fly_with_bar(variants, scenario, own)
        sizes[label(body)] = float(load_body(scenario.body).keep_out_semi_axes.max())
    return table(flown, sizes)


def main() -> None:
    asked = options()
    bundle = f":{Path(asked.policy).resolve()}" if asked.policy else ""
    variants = []
    for name in dict.fromkeys([MPC, *asked.only]):
        controller, changes = VARIANTS[name]
        variants.append(Variant(name, controller if name == MPC else controller + bundle, changes))
    lines = table_of_flights(variants, asked)
    world, state = asked.dispersions or "as believed", "navigation"
    if asked.true_state:
        state = "the true state"
    title = f"Transits 0 … {asked.transits - 1} of seed {asked.seed} on {state}, {world}"
    show(title, HEADINGS, lines, asked.markdown)


if __name__ == "__main__":
    main()
