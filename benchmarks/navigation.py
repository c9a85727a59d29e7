"""Shows what the navigation knows: its times, acquisition, accuracy and honesty, and flights on it.

Sections, of which `--only` chooses:

- `step`: processor time of a step while following, as believed and in a world of `after_survey`,
  and of a step that acquires, all on one thread of this process.
- `acquisition`: poses in a cube around each body, 1.15 times as wide as that of the transits, with
  the attitude off by 1 degree about a random axis. A pose is right if the first position that the
  navigation gives is off by less than 1 % of the body's size; it has up to three frames.
- `accuracy`: the MPC on navigation at each body, the attitude off by 1 degree: errors after 20
  control steps (200 s at Kleopatra), whether the covariance says how large they are (NEES, NIS,
  shares within three standard deviations), and confident lies: steps at which it follows with an
  error beyond six standard deviations.
- `dispersed`: the same in worlds of `after_survey` and `before_survey`.
- `hard`: one hardship a line.
- `truth`: the MPC on navigation against the MPC on the true state, on the same transits.

Bodies are `kleopatra`, those that are generated, mesh files in km (2,000 kg/m^3, 6 h), and YAML
files of bodies. Flights are kept in the folder of `--out`: run the command again to finish what was
interrupted, or to add transits. Poses are not kept.

    python benchmarks/navigation.py [--only accuracy hard …] [--transits 20] [--seed 7001]
        [--poses 2000] [--bodies kleopatra two-ellipsoids rock.obj …] [--workers N]
        [--out out/navigation] [--markdown tables.md]
"""

import argparse
import functools
import os
from collections.abc import Callable, Sequence
from pathlib import Path

for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ[name] = "1"

import numpy as np
from _bodies import GENERATED, KLEOPATRA, scenario_at
from _campaign import campaign_parser, fly_with_bar, workers_with_bar
from _kept import keep
from _navigation_flights import (
    COMPONENTS,
    LIE,
    consistency,
    describe_navigation,
    lists,
    pooled,
    turned,
)
from _navigation_poses import (
    ACQUIRING,
    RIGHT,
    WRONG,
    Found,
    Poses,
    acquire_poses,
    following_times,
)
from _tables import Shown, write_markdown

from proxops.diagrams.flight import Row
from proxops.diagrams.scenario import Scenario, dump_scenario, load_scenario
from proxops.studies.campaigns import Variant
from proxops.studies.figures import delta_v_pairs
from proxops.systems.common import InputError

BODIES = (KLEOPATRA, *GENERATED)
TIMED_POSES, TIMED_FLIGHTS = 200, 2
# Poses that one worker tries at once.
BATCH = 100
ON_TRUTH = {"navigation": {"_tag": "!TrueState"}}
DISPERSIONS = ("after_survey", "before_survey")
HARD: dict[str, Variant] = {
    each.name: each
    for each in (
        Variant("attitude off by 1 degree", "mpc", world=turned),
        Variant(
            "frames a step late, told", "mpc",
            {"truth.lidar.latency_steps": 1, "navigation.frame_delay_steps": 1},
        ),
        Variant("frames a step late, not told", "mpc", {"truth.lidar.latency_steps": 1}),
        Variant("20 % false returns", "mpc", {"truth.lidar.false_returns": 0.2}),
        Variant("range 100 km", "mpc", {"lidar.max_range_m": 100e3}),
    )
}  # fmt: skip
FLIGHT_HEADINGS = (
    "success", "collisions", "Δv, median (m/s)", "following (%)", "position, median (m)",
    "p95 (m)", "over size", "velocity (m/s)", "attitude (deg)", "lies / steps",
)  # fmt: skip
HONESTY_HEADINGS = (
    "NEES / 9", "95 % bounds at a step", "steps inside (%)", "NIS / returns", "frames inside (%)",
)  # fmt: skip


flown = functools.partial(fly_with_bar, describe=describe_navigation)


def flight_figures(rows: Sequence[Row]) -> list[str]:
    """One line of a table with `FLIGHT_HEADINGS`: errors are medians over the steps."""
    fit = [row for row in rows if "unflyable" not in row]
    spent = [row["delta_v_m_s"] for row in fit if row["success"]]
    position = pooled(fit, "position")
    sizes = [row["size_m"] for row in fit]
    worst = pooled(fit, "worst", start=0)
    following = [row["following"] for row in fit if "following" in row]
    return [
        f"{sum(row['success'] for row in fit)}/{len(fit)}",
        str(sum(row["collided"] for row in fit)),
        number(median(spent), ".1f"),
        number(100.0 * float(np.mean(following)) if following else np.nan, ".2f"),
        number(median(position), ".3g"),
        number(float(np.percentile(position, 95)) if position.size else np.nan, ".3g"),
        number(median(position) / sizes[0] if sizes else np.nan, ".2g"),
        number(median(pooled(fit, "velocity")), ".2g"),
        number(median(pooled(fit, "attitude")), ".2g"),
        f"{(worst > LIE).sum()}/{worst.size}",
    ]


def honesty_figures(rows: Sequence[Row]) -> list[str]:
    """One line of a table with `HONESTY_HEADINGS`."""
    found = consistency(rows)
    return [
        number(found["nees"], ".2f"),
        f"{number(found['low'], '.2f')}–{number(found['high'], '.2f')}",
        number(100.0 * found["nees_inside"], ".0f"),
        number(found["nis"], ".4f"),
        number(100.0 * found["nis_inside"], ".1f"),
    ]


def shares_inside(rows: Sequence[Row]) -> list[str]:
    """For each component, the share (%) of all steps with an error within three deviations."""
    fit = [row for row in rows if "inside" in row.get("steps", ())]
    if not fit:
        return ["–"] * len(COMPONENTS)
    # Each flight counts by the steps at which it followed.
    weights = [np.isfinite(each).sum() for each in lists(fit, "nees")]
    shares = np.average([row["steps"]["inside"] for row in fit], axis=0, weights=weights)
    return [number(100.0 * share, ".2f") for share in shares]


def median(values: Sequence[float] | np.ndarray) -> float:
    return float(np.median(values)) if len(values) else np.nan


def number(value: float, form: str) -> str:
    return format(value, form) if np.isfinite(value) else "–"


def flight_tables(title: str, rows: dict[str, list[Row]]) -> list[Shown]:
    """Errors and honesty of flights, by line; prints flights that failed, and those with lies."""
    for name, group in rows.items():
        for row in group:
            for told in remarks(row):
                print(f"{name}, transit {row['transit']}: {told}")

    def table(text: str, headings: Sequence[str], figures: Callable) -> Shown:
        return Shown(text, headings, {name: figures(group) for name, group in rows.items()})

    return [
        table(title, FLIGHT_HEADINGS, flight_figures),
        table(f"{title}: errors against covariance", HONESTY_HEADINGS, honesty_figures),
        table(f"{title}: steps within three standard deviations (%)", COMPONENTS, shares_inside),
    ]


def remarks(row: Row) -> list[str]:
    """What went wrong in a flight."""
    if "unflyable" in row:
        return [row["unflyable"]]
    found = []
    if not row["success"]:
        distance = f"{row['terminal_position_error_m']:.0f} m from the goal"
        found.append(f"no success, {'it collided' if row['collided'] else distance}")
    worst = lists([row], "worst", start=0)
    lies = np.flatnonzero(worst[0] > LIE) if worst else np.zeros(0)
    if lies.size:
        most = f"{np.nanmax(worst[0]):.1f} standard deviations"
        found.append(f"{lies.size} lies from step {lies[0]} to {lies[-1]}, up to {most}")
    return found


# What is changed in the scenario, by the label of the line.
FOLLOWED: dict[str, dict[str, str]] = {
    "following": {},
    "following, gravity: table": {"gravity": "table"},
    "following, after_survey": {"dispersions": "after_survey"},
}


def step(asked: argparse.Namespace) -> list[Shown]:
    lines = {}
    for label, own in FOLLOWED.items():
        flights = range(min(asked.transits, TIMED_FLIGHTS))
        spans = [following_times(own, index, asked.seed) for index in flights]
        lines[label] = _times(np.concatenate(spans))
        keep({f"a navigation step, {label} (ms)": 1e3 * np.median(np.concatenate(spans))})
    count = min(asked.poses, TIMED_POSES)
    text = dump_scenario(load_scenario())
    acquire_poses(Poses("warm up", text, asked.seed, count, 1))
    found = acquire_poses(Poses("timed", text, asked.seed, 0, count))
    lines["acquiring"] = _times(np.array([each.first_s for each in found]))
    return [
        Shown("a step on one thread", ("steps", "median (ms)", "p99 (ms)", "worst (ms)"), lines)
    ]


def _times(spans: np.ndarray) -> list[str]:
    values = (np.median(spans), np.percentile(spans, 99), spans.max())
    return [str(spans.size), *(f"{1e3 * value:.3f}" for value in values)]


def acquisition(asked: argparse.Namespace) -> list[Shown]:
    pieces = [
        Poses(
            f"{body} {first}",
            dump_scenario(scenario),
            asked.seed,
            first,
            min(BATCH, asked.poses - first),
        )
        for body, scenario in _scenarios(asked).items()
        for first in range(0, asked.poses, BATCH)
    ]
    found: dict[str, list[Found]] = {body: [] for body in asked.bodies}
    with workers_with_bar(asked) as workers:
        for done, (name, part) in enumerate(workers.results(pieces, acquire_poses)):
            found[name.rpartition(" ")[0]] += part
            workers.progress((done + 1) / len(pieces), f"{done + 1} of {len(pieces)} batches")
    lines = {}
    for body, each in found.items():
        counts = [sum(one.outcome == kind for one in each) for kind in (RIGHT, ACQUIRING, WRONG)]
        first = sum(one.outcome == RIGHT and one.frames == 1 for one in each)
        errors = [one.error for one in each if one.outcome == RIGHT]
        lines[_label(body)] = [
            *map(str, counts), f"{100.0 * counts[0] / len(each):.2f}", str(first),
            number(median(errors), ".2g"),
        ]  # fmt: skip
        for one in sorted(each, key=lambda one: one.index):
            if one.outcome != RIGHT:
                place = ", ".join(f"{x:.0f}" for x in one.position)
                print(f"{body}, pose {one.index} at ({place}) m: {one.outcome}, {one.error:.3g}")
    headings = (*("right", "acquiring", "wrong"), "right (%)", "by one frame", "error over size")
    return [Shown(f"acquisition at {asked.poses} poses", headings, lines)]


def accuracy(asked: argparse.Namespace) -> list[Shown]:
    rows = {}
    for body, scenario in _scenarios(asked).items():
        # The name of Kleopatra's flights is that of the same flights of other sections.
        name = HARD["attitude off by 1 degree"].name
        name = name if body == KLEOPATRA else f"{_label(body)}, {name}"
        variant = Variant(name, "mpc", world=turned)
        [rows[_label(body)]] = flown([variant], scenario, asked).values()
    return flight_tables(f"{_flights(asked)}, attitude off by 1 degree", rows)


def dispersed(asked: argparse.Namespace) -> list[Shown]:
    variants = [Variant(name, "mpc", {"dispersions": name}) for name in DISPERSIONS]
    return flight_tables(_flights(asked), flown(variants, _plain(), asked))


def hard(asked: argparse.Namespace) -> list[Shown]:
    variants = [HARD[name] for name in asked.cases]
    return flight_tables(_flights(asked), flown(variants, _plain(), asked))


def truth(asked: argparse.Namespace) -> list[Shown]:
    on_truth = Variant("on the true state", "mpc", ON_TRUTH)
    on_navigation = [
        Variant("on navigation", "mpc"),
        HARD["attitude off by 1 degree"],
    ]
    rows = flown([on_truth, *on_navigation], _plain(), asked)
    lines = {on_truth.name: [_successes(rows[on_truth.name]), "1", "1", "1"]}
    for each in on_navigation:
        pairs = delta_v_pairs(rows[each.name], rows[on_truth.name])
        ratios = pairs[:, 0] / pairs[:, 1]
        together = float(np.divide(*pairs.sum(axis=0))) if len(pairs) else np.nan
        most = float(ratios.max()) if len(pairs) else np.nan
        figures = (together, median(ratios), most)
        lines[each.name] = [_successes(rows[each.name]), *(number(x, ".4f") for x in figures)]
    headings = ("success", "Δv over that on the truth, sums", "median", "greatest")
    return [Shown(f"{_flights(asked)}, against the MPC on the true state", headings, lines)]


def _successes(rows: Sequence[Row]) -> str:
    return f"{sum(row['success'] for row in rows)}/{len(rows)}"


def _scenarios(asked: argparse.Namespace) -> dict[str, Scenario]:
    """The scenario at each body, by the body as it is asked for."""
    return {body: scenario_at(body, asked.out / "bodies") for body in asked.bodies}


def _label(body: str) -> str:
    """A body's name in tables and files: that of its file without the folder."""
    return Path(body).stem


def _plain() -> Scenario:
    return load_scenario(None, {"log_ranges": False})


def _flights(asked: argparse.Namespace) -> str:
    return f"the MPC on navigation, {asked.transits} transits of seed {asked.seed}"


SECTIONS: dict[str, Callable[[argparse.Namespace], list[Shown]]] = {
    each.__name__: each for each in (step, acquisition, accuracy, dispersed, hard, truth)
}


def main() -> None:
    parser = campaign_parser(__doc__, "out/navigation", transits=20, seed=7001)
    parser.add_argument("--only", nargs="+", choices=SECTIONS, default=list(SECTIONS))
    parser.add_argument("--poses", type=int, default=2000, help="of each body")
    parser.add_argument(
        "--bodies", nargs="+", default=list(BODIES), metavar="BODY", help="for poses and accuracy"
    )
    parser.add_argument("--cases", nargs="+", choices=HARD, default=list(HARD), help="of `hard`")
    asked = parser.parse_args()
    tables = []
    try:
        for section in asked.only:
            for table in SECTIONS[section](asked):
                table.show()
                tables.append(table)
    except InputError as error:
        raise SystemExit(str(error)) from error
    write_markdown(tables, asked.markdown)


if __name__ == "__main__":
    main()
