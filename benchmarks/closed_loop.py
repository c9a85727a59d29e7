"""Compares controllers in closed loop: variants fly the same transits with the same noise.

    python benchmarks/closed_loop.py STUDY [--only LINE …] [--transits N] [--seed N] [--workers N]
        [--out FOLDER] [--markdown table.md]

| study | asks |
|---|---|
| any_body | how policy and hybrids fly beside the MPC at bodies that they never saw |
| hybrid | what gates, limits and periods of the hybrid trade |
| schedule | whether the hybrid's checks alone keep an adversary out; assurance is off |
| expert | what the MPC's two costs spend, and how it flies in plants that it does not expect |
| assured | what runtime assurance costs, and how it flies in worlds twice as far off as declared |
| error_scale | how success falls as every error grows beyond what is declared |
| other_forms | what errors do whose form nobody on board is told |
| one_at_a_time | what a controller withstands: each dispersed quantity at 1, 2, 3 times its bound |

`closed_loop.py STUDY --help` lists a study's own options. Unless a study says otherwise, all fly on
the navigation's state. Δv is over that of a reference variant, on the transits in which both
arrived; times of a step are those of the whole controller, without the navigation's. Flights stay
in the folder of `--out`: the same command goes on after an interruption, or adds transits.
"""

import argparse
import dataclasses as dc
import difflib
import functools
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import _worlds
import numpy as np
from _adversaries import ADVERSARIES
from _bodies import GENERATED, KLEOPATRA, scenario_at
from _campaign import add_campaign_options, fly_with_bar
from _tables import Shown, write_markdown
from pydrake.systems.framework import Diagram, LeafSystem

from proxops.assets import ASSETS
from proxops.diagrams.flight import Row, make_backup, make_hybrid
from proxops.diagrams.scenario import (
    AssuranceConfig,
    Body,
    Scenario,
    dump_scenario,
    is_blocked,
    load_body,
    load_dispersions,
    load_scenario,
)
from proxops.studies.campaigns import Variant, describe_flight
from proxops.studies.figures import Result, command_count, delta_v_pairs
from proxops.studies.figures.results import aggregate
from proxops.systems.common import InputError, make_folder, write_whole
from proxops.training.reports import DASH, interval_text, number_text

ADAPTIVE = {"hybrid.period_rule": "adaptive"}


class Study(NamedTuple):
    """What is flown, and what is shown of it."""

    scenario: Scenario
    lines: Mapping[str, tuple[Variant, str]]
    """By name: a variant, and the name of the variant that it is compared with."""
    columns: Sequence[str]
    """Names of `COLUMNS`."""


# ---------------------------------------------------------------------------------------- columns


def _ratios(rows: Sequence[Row], beside: Sequence[Row]) -> np.ndarray:
    pairs = delta_v_pairs(rows, beside)
    return pairs[:, 0] / pairs[:, 1] if len(pairs) else np.empty(0)


def _of(result: Result, name: str) -> np.ndarray:
    return np.array([row[name] for row in result.flights if row.get(name) is not None])


def _number(statistic: Callable, values: Sequence[float] | np.ndarray, form: str) -> str:
    return format(statistic(values), form) if len(values) else DASH


def _broke(row: Row) -> bool:
    return row["keep_out_violations"] > 0 or row["collided"]


def _arrived(result: Result, name: str) -> list[float]:
    return [row[name] for row in result.flights if row["arrival_time_s"] is not None]


def _faster(rows: Sequence[Row], beside: Sequence[Row]) -> list[float]:
    """Flight by flight: what else runs on the machine comes in bursts."""
    return [
        other["control_ms_mean"] / row["control_ms_mean"]
        for row, other in zip(rows, beside, strict=True)
        if "unflyable" not in row and "unflyable" not in other
    ]


def _blocked(rows: Sequence[Row]) -> list[Row]:
    return [row for row in rows if is_blocked(row["transit"])]


def _solves(result: Result) -> float:
    """Share of steps at which the MPC was asked, in %."""
    asked = [row for row in result.flights if row.get("mpc_solves") is not None]
    return 100.0 * sum(row["mpc_solves"] for row in asked) / command_count(asked)


# Of the result of the rows, all rows, and the rows of the reference.
COLUMNS: dict[str, Callable[[Result, Sequence[Row], Sequence[Row]], str]] = {
    "success": lambda r, a, b: f"{r.successes}/{r.transits}",
    "exact 95 % interval": lambda r, a, b: interval_text(r.success_rate_exact_interval, " to "),
    "success (2 km)": lambda r, a, b: f"{r.successes_2km}/{r.transits}",
    "flights that entered": lambda r, a, b: str(sum(map(_broke, r.flights))),
    "late or away": lambda r, a, b: str(
        sum(not row["success"] and not _broke(row) for row in r.flights)
    ),
    "collisions": lambda r, a, b: str(r.collisions),
    "keep-out violations": lambda r, a, b: str(r.keep_out_violations),
    "unflyable": lambda r, a, b: str(r.unflyable),
    "least clearance (km)": lambda r, a, b: number_text(r.min_clearance_m, ".2f", 1e-3),
    "least clearance (% of size)": lambda r, a, b: _number(
        min, [100.0 * row["min_clearance_m"] / row["size_m"] for row in r.flights], ".2f"
    ),
    "end error, median (m)": lambda r, a, b: number_text(r.terminal_position_error_m_median, ".1f"),
    "p95 (m)": lambda r, a, b: number_text(r.terminal_position_error_m_p95, ".1f"),
    "greatest (m)": lambda r, a, b: number_text(r.terminal_position_error_m_max, ".1f"),
    "end speed, greatest (m/s)": lambda r, a, b: number_text(r.terminal_speed_m_s_max, ".3f"),
    "Δv, median (m/s)": lambda r, a, b: _number(np.median, _arrived(r, "delta_v_m_s"), ".1f"),
    "Δv over the reference's, mean": lambda r, a, b: _number(np.mean, _ratios(a, b), ".4f"),
    "median": lambda r, a, b: number_text(r.expert_delta_v_ratio_median, ".3f"),
    "greatest": lambda r, a, b: _number(max, _ratios(a, b), ".3f"),
    "greatest, blocked": lambda r, a, b: _number(max, _ratios(_blocked(a), _blocked(b)), ".3f"),
    "Δv of all, over the reference's": lambda r, a, b: number_text(r.expert_delta_v_ratio, ".3f"),
    "arrival, median (s)": lambda r, a, b: _number(
        np.median, _arrived(r, "arrival_time_s"), ".0f"
    ),
    "steps below 3 % of the thrust (%)": lambda r, a, b: number_text(
        r.small_command_share, ".1f", 100.0
    ),
    "policy share (%)": lambda r, a, b: number_text(r.policy_share, ".1f", 100.0),
    "before arrival (%)": lambda r, a, b: number_text(r.policy_share_to_arrival, ".1f", 100.0),
    "solves (%)": lambda r, a, b: f"{_solves(r):.0f}",
    "solves saved (%)": lambda r, a, b: (
        f"{100.0 - _solves(r):.1f}" if len(_of(r, "mpc_solves")) else DASH
    ),
    "a step (ms)": lambda r, a, b: _number(np.median, _of(r, "control_ms_mean"), ".2f"),
    "times less than the reference": lambda r, a, b: _number(np.median, _faster(a, b), ".1f"),
    "navigation off, median (m)": lambda r, a, b: number_text(
        r.navigation_position_error_m_median, ".1f"
    ),
    # Of a flight, the share of steps of the worst component. In a flight that never had a state,
    # the navigation is right nowhere.
    "steps within 3σ of the navigation (%)": lambda r, a, b: _number(
        np.mean, [100.0 * row.get("navigation_consistent", 0.0) for row in r.flights], ".1f"
    ),
    "changed steps": lambda r, a, b: _number(sum, _of(r, "interventions"), "d"),
    "flights with any": lambda r, a, b: _number(sum, _of(r, "interventions") > 0, "d"),
    "to keep out": lambda r, a, b: _number(sum, _of(r, "interventions_keep_out"), "d"),
    "flights changed to keep out": lambda r, a, b: _number(
        sum, _of(r, "interventions_keep_out") > 0, "d"
    ),
}  # fmt: skip


def figures(columns: Sequence[str], rows: Sequence[Row], beside: Sequence[Row]) -> list[str]:
    """One line of a table; a world that cannot be flown is counted as `unflyable` alone."""
    result = aggregate(rows, beside)
    return [COLUMNS[name](result, rows, beside) for name in columns]


# ---------------------------------------------------------------------------------------- studies


def any_body(asked: argparse.Namespace, scenario: Scenario) -> Study:
    bundle = f":{Path(asked.policy).resolve()}" if asked.policy else ""
    assured = {"assurance": {}}
    variants = [
        Variant("MPC", "mpc"),
        Variant("policy", f"policy{bundle}"),
        Variant("hybrid", f"hybrid{bundle}"),
        Variant("adaptive", f"hybrid{bundle}", ADAPTIVE),
        Variant("policy, assured", f"policy{bundle}", assured),
        Variant("hybrid, assured", f"hybrid{bundle}", assured),
    ]
    columns = (
        "success", "flights that entered", "late or away", "least clearance (% of size)",
        "Δv over the reference's, mean", "greatest", "policy share (%)", "solves saved (%)",
        "a step (ms)", "times less than the reference",
    )  # fmt: skip
    return Study(scenario, _beside("MPC", variants), columns)


def hybrid(asked: argparse.Namespace, scenario: Scenario) -> Study:
    gates = "strict", "paper", "printed"
    changes = {
        **{f"{gate}, 10": {"hybrid.gate": gate} for gate in gates},
        **{f"strict, 10, {n:g} N": {"hybrid.epsilon_magnitude_n": n} for n in (0.5, 2.0)},
        **{f"strict, 10, {angle:g}°": {"hybrid.epsilon_angle_deg": angle} for angle in (5.0, 20.0)},
        **{f"strict, {steps}": {"hybrid.check_period": steps} for steps in (2, 5, 20, 50, 100)},
        **{f"{gate}, adaptive": {"hybrid.gate": gate, **ADAPTIVE} for gate in gates[:2]},
    }
    # What the policy has learned shows only in what its share has over that of no force at all.
    zero = "proxops.diagrams.flight.hybrid_controller:zero_hybrid"
    zeros = {f"{gate}, 10": {"hybrid.gate": gate} for gate in gates} | {
        "strict, adaptive": ADAPTIVE
    }
    bundle = Path(asked.policy or ASSETS / "end_to_end").resolve()
    variants = [
        Variant("MPC", "mpc"),
        Variant("policy", f"policy:{bundle}"),
        *(Variant(line, f"hybrid:{bundle}", changed) for line, changed in changes.items()),
        *(Variant(f"zero: {line}", zero, changed) for line, changed in zeros.items()),
    ]
    columns = (
        "success", "keep-out violations", "least clearance (km)", "policy share (%)",
        "before arrival (%)", "solves saved (%)", "Δv over the reference's, mean", "greatest",
        "a step (ms)", "times less than the reference",
    )  # fmt: skip
    return Study(scenario, _beside("MPC", variants), columns)


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


# A controller is named MODULE:FACTORY, so each adversary has a factory of its name.
for _name in ADVERSARIES:
    globals()[_name.replace(" ", "_")] = functools.partial(hostile_hybrid, _name)


def schedule(asked: argparse.Namespace, scenario: Scenario) -> Study:
    """The gate is open, so that any force agrees: the MPC flies at the checks alone."""
    rules = {"adaptive": ADAPTIVE, "every 10": {}, "every 30": {"hybrid.check_period": 30}}
    # Thrust is at most 7 N per axis.
    open_gate = {"arrival.deadline_s": asked.duration, "hybrid.epsilon_magnitude_n": 1e3}
    variants = [
        Variant(f"{rule}, {name}", f"closed_loop:{name.replace(' ', '_')}", open_gate | changes)
        for rule, changes in rules.items()
        for name in ADVERSARIES
    ]
    columns = "flights that entered", "least clearance (km)", "solves (%)"
    return Study(scenario, {each.name: (each, each.name) for each in variants}, columns)


def expert(asked: argparse.Namespace, scenario: Scenario) -> Study:
    mismatches = {
        "gravity x 0.8": {"truth.gravity": 0.8},
        "gravity x 1.2": {"truth.gravity": 1.2},
        "point mass believed": {"mpc.point_mass": True},
        "mass x 0.9": {"truth.mass": 0.9},
        "mass x 1.1": {"truth.mass": 1.1},
        "thrust x 0.9": {"truth.thrusters.scale": [0.9] * 3},
        "thrust x 1.1": {"truth.thrusters.scale": [1.1] * 3},
        "the paper's disturbance": {"disturbance": {}},
    }
    matched, gain = "time_and_fuel", {"mpc.estimator_gain": 0.3}
    variants = [
        Variant(matched, "mpc"),
        Variant(f"{matched}, estimator 0.3", "mpc", gain),
        Variant("weighted", "mpc", {"mpc.cost": "weighted"}),
    ]
    for name, wrong in mismatches.items():
        variants += [Variant(name, "mpc", wrong | {"mpc.estimator_gain": 0.0})]
        variants += [Variant(f"{name}, estimator 0.3", "mpc", wrong | gain)]
    columns = (
        "success", "end error, median (m)", "greatest (m)", "end speed, greatest (m/s)",
        "Δv, median (m/s)", "median", "arrival, median (s)", "keep-out violations", "collisions",
        "least clearance (km)", "steps below 3 % of the thrust (%)",
    )  # fmt: skip
    return Study(scenario, _beside(matched, variants), columns)


def assured(asked: argparse.Namespace, scenario: Scenario) -> Study:
    told = {"assurance": {"bounds": asked.dispersions}}
    twice = functools.partial(_worlds.farther_off, times=2.0)
    lines = {}
    for name in asked.controllers:
        for variant in (
            Variant(name, name),
            Variant(f"{name}, assured", name, told),
            Variant(f"{name}, assured, twice as far off", name, told, world=twice),
        ):
            lines[variant.name] = variant, name
    columns = (
        "success", "flights that entered", "least clearance (km)", "Δv over the reference's, mean",
        "greatest", "greatest, blocked", "changed steps", "flights with any", "to keep out",
    )  # fmt: skip
    return Study(scenario, lines, columns)


def error_scale(asked: argparse.Namespace, scenario: Scenario) -> Study:
    told = {} if asked.unassured else {"assurance": {"bounds": asked.dispersions}}
    variants = [
        Variant(f"{times:g} ×", asked.controller, told,
                world=functools.partial(_worlds.farther_off, times=times))
        for times in sorted({1.0, *asked.scales})
    ]  # fmt: skip
    columns = (
        "success", "exact 95 % interval", "flights that entered", "least clearance (km)",
        "end error, median (m)", "greatest (m)", "Δv of all, over the reference's",
        "steps within 3σ of the navigation (%)", "flights changed to keep out",
    )  # fmt: skip
    return Study(scenario, _beside("1 ×", variants), columns)


def other_forms(asked: argparse.Namespace, scenario: Scenario) -> Study:
    told = {"assurance": {"bounds": asked.dispersions}}
    forms = _worlds.other_forms(scenario, load_body(scenario.body), asked.out / "surfaces")
    variants = [
        Variant(name, asked.controller, told,
                world=functools.partial(_worlds.changed_world, changed=changed))
        for name, changed in {"as told": {}, **forms}.items()
    ]  # fmt: skip
    columns = (
        "success", "exact 95 % interval", "keep-out violations", "least clearance (km)",
        "end error, median (m)", "greatest (m)", "Δv over the reference's, mean",
        "navigation off, median (m)", "steps within 3σ of the navigation (%)",
    )  # fmt: skip
    return Study(scenario, _beside("as told", variants), columns)


def one_at_a_time(asked: argparse.Namespace, scenario: Scenario) -> Study:
    """The navigation is told the dispersions, in every line the same, but in the last three."""
    told, controller = asked.dispersions, asked.controller
    plain, body = dc.replace(scenario, dispersions=None), load_body(scenario.body)
    nominal = functools.partial(_worlds.as_believed, dispersions=told)
    variants = [Variant("nominal", controller, world=nominal)]
    for quantity in _worlds.quantities(load_dispersions(told)):
        for multiple in (1, 2, 3) if quantity.has_multiples else (1,):
            clipped = quantity.is_clipped(plain, body, multiple)
            name = f"{quantity.main.key} x {multiple}{' (at its limit)' if clipped else ''}"
            world = functools.partial(
                _worlds.one_off, dispersions=told, quantity=quantity, multiple=multiple
            )
            variants.append(Variant(name, controller, world=world))
    for name in ("after_survey", "before_survey"):
        variants.append(Variant(f"all of {name}", controller, {"dispersions": name}))
    variants.append(Variant("the paper's disturbance", controller, {"disturbance": {}}))
    columns = (
        "success", "success (2 km)", "collisions", "keep-out violations", "unflyable",
        "end error, median (m)", "p95 (m)", "Δv, median (m/s)",
    )  # fmt: skip
    return Study(plain, _beside("nominal", variants), columns)


def _beside(reference: str, variants: Sequence[Variant]) -> dict[str, tuple[Variant, str]]:
    return {each.name: (each, reference) for each in variants}


# ---------------------------------------------------------------------------------------- running


class Setup(NamedTuple):
    """A study, how much it flies by default, and which options it has with which defaults."""

    study: Callable[[argparse.Namespace, Scenario], Study]
    transits: int
    seed: int
    options: Mapping[str, object]
    settings: Mapping[str, object] = {}
    """Keys and values that it changes in the default scenario."""
    on_true_state: bool = False


STUDIES = {
    each.study.__name__: each
    for each in (
        Setup(any_body, 20, 60, {"bodies": None, "policy": "", "dispersions": None}),
        Setup(hybrid, 20, 60, {"policy": ""}, on_true_state=True),
        Setup(schedule, 10, 61, {"duration": 4000.0}, on_true_state=True),
        Setup(expert, 50, 10001, {}, on_true_state=True),
        Setup(
            assured, 20, 62,
            {"controllers": ["mpc", "policy", "hybrid"], "dispersions": "after_survey"},
        ),
        Setup(
            error_scale, 60, 24700,
            {"controller": "hybrid", "dispersions": "after_survey", "unassured": False,
             "scales": [1.0, 2.0, 3.0, 4.0, 6.0]},
            {"gravity": "table"},
        ),
        Setup(other_forms, 40, 8800, {"controller": "hybrid", "dispersions": "after_survey"}),
        Setup(one_at_a_time, 40, 10001, {"controller": "policy", "dispersions": "after_survey"}),
    )
}  # fmt: skip
OPTIONS: dict[str, dict] = {
    "bodies": {
        "nargs": "+",
        "metavar": "BODY",
        "help": "kleopatra, SEED:NUMBER of a random body, a body's YAML file, a mesh file in km, "
        f"or one of {', '.join(GENERATED)}; default: the generated ones, and ten random ones",
    },
    "policy": {"metavar": "BUNDLE", "help": "a policy's bundle; default: one that ships"},
    "controller": {"metavar": "NAME"},
    "controllers": {"metavar": "NAME", "nargs": "+"},
    "dispersions": {"metavar": "NAME", "help": "worlds to draw from, by name or YAML file"},
    "duration": {"type": float, "metavar": "SECONDS", "help": "of each flight"},
    "scales": {"type": float, "nargs": "+", "metavar": "TIMES"},
    "unassured": {"action": "store_true", "help": "without runtime assurance"},
}


def options() -> argparse.Namespace:
    """The options of the command line; ends the program if one is wrong."""
    plain = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=plain)
    studies = parser.add_subparsers(dest="study", required=True, metavar="STUDY")
    for name, setup in STUDIES.items():
        own = studies.add_parser(name, description=setup.study.__doc__)
        add_campaign_options(own, f"out/{name}", setup.transits, setup.seed)
        own.add_argument("--only", nargs="+", metavar="LINE", help="lines; default: all")
        own.add_argument("--set", action="append", default=[], metavar="KEY=VALUE")
        for option, usual in setup.options.items():
            own.add_argument(f"--{option}", default=usual, **OPTIONS[option])
    return parser.parse_args()


def scenario_of(body: str | None, asked: argparse.Namespace) -> Scenario:
    """The scenario at a body (None: the default), with what study and command line change.

    Raises:
      InputError: there is no such body, or a change is wrong.
    """
    setup, path = STUDIES[asked.study], None
    if body is not None:
        folder = asked.out / "bodies"
        path = folder / f"{label(body)}.scenario.yaml"
        text = dump_scenario(scenario_at(body, folder))
        make_folder(folder)
        write_whole(path, lambda file: file.write_text(text, encoding="utf-8"))
    settings = {"log_ranges": False, **setup.settings}
    changes = [*(f"{key}={value}" for key, value in settings.items()), *asked.set]
    if getattr(asked, "dispersions", None) is not None:
        changes.append(f"dispersions={asked.dispersions}")
    return load_scenario(path, changes, on_true_state=setup.on_true_state)


def label(body: str) -> str:
    """A body's name, as part of the name of a file."""
    return Path(body).stem.replace(":", "-")


def chosen(study: Study, only: Sequence[str] | None) -> list[Variant]:
    """The variants of the lines that are asked for, and those that they are compared with.

    `truth.gravity` stands for all lines `truth.gravity x …`.

    Raises:
      InputError: there is no such line.
    """
    if only is None:
        return [variant for variant, _ in study.lines.values()]
    wanted = set()
    for name in only:
        found = {each for each in study.lines if name in (each, each.partition(" x ")[0])}
        if not found:
            [near] = difflib.get_close_matches(name, study.lines, n=1, cutoff=0.0)
            raise InputError(f"--only: there is no line {name!r}; the nearest is {near!r}")
        wanted |= found | {study.lines[each][1] for each in found}
    return [variant for name, (variant, _) in study.lines.items() if name in wanted]


def table(study: Study, flown: Mapping[str, Mapping[str, list[Row]]]) -> dict[str, list[str]]:
    """The lines of each body, then those of all bodies together if there are several.

    Args:
      flown: rows by body (an empty name for the scenario's own) and name of the line.
    """
    every = dict(flown)
    if len(flown) > 1:
        names = next(iter(flown.values()))
        every["all bodies"] = {
            name: [row for rows in flown.values() for row in rows[name]] for name in names
        }
    return {
        f"{body}, {name}" if body else name: figures(
            study.columns, rows, lines[study.lines[name][1]]
        )
        for body, lines in every.items()
        for name, rows in lines.items()
    }


def main() -> None:
    asked = options()
    setup, flown, study = STUDIES[asked.study], {}, None
    bodies = [None]
    if "bodies" in setup.options:
        random = [f"20:{number}" for number in range(10)]
        bodies = asked.bodies or [KLEOPATRA, *random, *GENERATED]
    try:
        for body in bodies:
            scenario = scenario_of(body, asked)
            study = setup.study(asked, scenario)
            own = argparse.Namespace(**vars(asked))
            own.out = asked.out / label(body) if body else asked.out
            rows = fly_with_bar(
                chosen(study, asked.only), study.scenario, own, describe=describe_flight
            )
            size = float(load_body(scenario.body).keep_out_semi_axes.max())
            flown[label(body) if body else ""] = {
                name: [row | {"size_m": size} for row in own] for name, own in rows.items()
            }
    except InputError as error:
        raise SystemExit(str(error)) from error
    assert study is not None
    title = f"{asked.study}: transits 0 … {asked.transits - 1} of seed {asked.seed}"
    found = Shown(title, study.columns, table(study, flown))
    found.show()
    write_markdown([found], asked.markdown)


if __name__ == "__main__":
    main()
