"""Shows at which bodies and spacecraft the policy for any body flies well, and where it does not.

The policy and the MPC fly the same transits on navigation at the members of a family that it never
saw: generated bodies, each with a spacecraft of its own. Members are then split into thirds, from
least to greatest, by each of these proportions:

- hover share: the greatest force that hovering over the keep-out ellipsoid takes, over the limit;
- elongation: the longest over the shortest semi-axis of the keep-out ellipsoid;
- wasted: the share of the ellipsoid's volume that is not body, large at concave ones;
- spin: centrifugal over gravitational acceleration at the long end, 1 at break-up;
- speed, period: of the spacecraft, over sqrt(L a) and sqrt(L / a) of thrust and body.

Flights are kept in the folder of `--out`: run the command again to finish what was interrupted, or
to add members or transits.

    python benchmarks/any_body_map.py [--family 21] [--members 40] [--policy BUNDLE]
        [--transits 3] [--seed 60] [--workers N] [--out out/any-body-map]
        [--markdown table.md] [--map map.png]
"""

import argparse
import dataclasses as dc
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import matplotlib.pyplot as plt
import numpy as np
from _campaign import campaign_parser, show, workers_with_bar
from matplotlib.ticker import NullLocator

from proxops.diagrams.flight import Row, run_groups
from proxops.diagrams.scenario import Body, Scenario, change_scenario, load_body, load_scenario
from proxops.studies.evaluation import Variant, delta_v_pairs, variant_flights
from proxops.systems.common import write_whole
from proxops.systems.gravity import GRAVITATIONAL_CONSTANT
from proxops.training.recipes import spacecraft_numbers, write_family

# Where the axes have numbers.
_TICKS = (0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0)
PARTS = ("least third", "middle", "greatest third")
HEADINGS = (
    "from", "to", "success", "flights that entered", "late or away", "Δv over the MPC's, mean",
)  # fmt: skip


class Member(NamedTuple):
    """A body with a spacecraft, and how the policy flew there."""

    proportions: Mapping[str, float]
    rows: Sequence[Row]
    expert: Sequence[Row]

    @property
    def ratios(self) -> np.ndarray:
        """Δv over the MPC's of the flights in which both arrived."""
        pairs = delta_v_pairs(self.rows, self.expert)
        return pairs[:, 0] / pairs[:, 1] if len(pairs) else np.empty(0)

    @property
    def successes(self) -> int:
        return sum(row["success"] for row in self.rows)


def proportions(scenario: Scenario, body: Body) -> dict[str, float]:
    """The proportions of a body and its spacecraft, by name."""
    axes, numbers = np.sort(body.keep_out_semi_axes), spacecraft_numbers(scenario, body)
    length = float(np.abs(body.shape.vertices).max())
    pull = GRAVITATIONAL_CONSTANT * body.gravity_field.mass / length**2
    return {
        "hover share": numbers.hover_share,
        "elongation": float(axes[2] / axes[0]),
        "wasted": 1.0 - body.shape.volume / (4.0 / 3.0 * np.pi * float(np.prod(axes))),
        "spin": body.spin_rate**2 * length / pull,
        "speed": numbers.speed,
        "period": numbers.period,
    }


def flown(asked: argparse.Namespace) -> list[Member]:
    """All members, flown by both."""
    paths = write_family(asked.out / "family", asked.family, asked.members)
    # A few members lie a little outside what the shipped policy learned.
    tried = {"policy.beyond_family": True}
    scenarios = [change_scenario(load_scenario(path), tried) for path in paths]
    bundle = f":{Path(asked.policy).resolve()}" if asked.policy else ""
    variants = Variant("mpc", "mpc"), Variant("policy", f"policy{bundle}")
    groups = {}
    for number, scenario in enumerate(scenarios):
        for each in variants:
            flights = variant_flights(each, scenario, asked.seed, range(asked.transits))
            own = [dc.replace(flight, name=f"{number:05d}-{flight.name}") for flight in flights]
            groups[f"{each.name} {number}"] = own
    with workers_with_bar(asked) as workers:
        rows = run_groups(groups, asked.out / "flights", workers=workers)
    return [
        Member(
            proportions(scenario, load_body(scenario.body)),
            rows[f"policy {number}"],
            rows[f"mpc {number}"],
        )
        for number, scenario in enumerate(scenarios)
    ]


def figures(members: Sequence[Member], values: Sequence[float]) -> list[str]:
    """One line of the table."""
    rows = [row for member in members for row in member.rows]
    won = sum(member.successes for member in members)
    broken = sum(row["keep_out_violations"] > 0 or row["collided"] for row in rows)
    ratios = np.concatenate([member.ratios for member in members])
    return [
        f"{min(values):.3g}",
        f"{max(values):.3g}",
        f"{won}/{len(rows)}",
        str(broken),
        str(len(rows) - won - broken),
        f"{ratios.mean():.3f}" if ratios.size else "–",
    ]


def by_thirds(members: Sequence[Member]) -> dict[str, list[str]]:
    """Lines of the table, by proportion and third."""
    lines = {}
    for name in members[0].proportions:
        order = sorted(members, key=lambda member: member.proportions[name])
        for part, chosen in zip(PARTS, np.array_split(np.arange(len(order)), 3), strict=True):
            own = [order[k] for k in chosen]
            values = [member.proportions[name] for member in own]
            if own:
                lines[f"{name}, {part}"] = figures(own, values)
    everything = [member.proportions["hover share"] for member in members]
    return lines | {"all, by hover share": figures(members, everything)}


def draw(members: Sequence[Member], path: Path) -> None:
    """A map of Δv over hover share and elongation; members with failures have a cross."""
    figure, axes = plt.subplots(1, 2, figsize=(10.0, 4.2), layout="constrained")
    pairs = (("hover share", "elongation"), ("speed", "wasted"))
    cost = [float(member.ratios.mean()) if member.ratios.size else np.nan for member in members]
    failed = [member.successes < len(member.rows) for member in members]
    for axis, (across, up) in zip(axes, pairs, strict=True):
        x = np.array([member.proportions[across] for member in members])
        y = np.array([member.proportions[up] for member in members])
        dots = axis.scatter(x, y, c=cost, s=60, cmap="viridis", vmin=1.0, vmax=1.2)
        axis.scatter(x[failed], y[failed], marker="x", s=110, c="tab:red", label="a flight failed")
        axis.set(xlabel=across, ylabel=up)
        axis.set_xscale("log")
        ticks = [tick for tick in _TICKS if x.min() <= tick <= x.max()]
        axis.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
        axis.xaxis.set_minor_locator(NullLocator())
    axes[0].legend()
    figure.colorbar(dots, ax=axes, label="Δv over the MPC's")
    write_whole(path, lambda name: figure.savefig(name, dpi=120, format="png"))


def main() -> None:
    parser = campaign_parser(__doc__, "out/any-body-map", transits=3, seed=60)
    parser.add_argument("--family", type=int, default=21, help="seed of the family")
    parser.add_argument("--members", type=int, default=40)
    parser.add_argument("--policy", help="a policy's bundle; default: the one that ships")
    parser.add_argument("--map", type=Path, help="draw the map there, as PNG")
    asked = parser.parse_args()
    members = flown(asked)
    title = f"The policy at {len(members)} bodies of family {asked.family}, {asked.transits} each"
    show(title, HEADINGS, by_thirds(members), asked.markdown)
    if asked.map is not None:
        draw(members, asked.map)


if __name__ == "__main__":
    main()
