"""Tests runtime assurance against adversaries in worlds within its box: is it ever let in?

Flights start at random admitted states in the cube, at up to the speed limit along each axis: half
of them within 8 km of the keep-out ellipsoid, half at the edge of what is admitted. Adversaries,
truths and errors of the state are drawn for each flight; half of the truths have everything at an
end of its bounds. The motion is integrated with polyhedral gravity, by another method than the
assurance's own prediction, and clearance is computed ten times a step. Times are processor times of
the whole step. The program ends with an error if a flight enters the ellipsoid.

Every flight is a row that is appended to OUT/rows.jsonl. Run it again with the same options to
continue, with more flights too.

    python benchmarks/assurance.py --bounds after_survey [--flights 10000] [--processes 1]
    python benchmarks/assurance.py --bounds after_survey --search 10      # trains an adversary
    python benchmarks/assurance.py --bounds before_survey --end 20000     # the argument's end
"""

import argparse
import functools
import json
import math
import multiprocessing
import os
import sys
from dataclasses import replace
from pathlib import Path

for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ[name] = "1"

import numpy as np
from _adversaries import (
    ADVERSARIES,
    CONTROLLER_SHAPE,
    STATE_ERRORS,
    TRUTHS,
    adversarial_flight,
    small_controller,
)
from _assurance_end import sample_end
from _tables import Shown
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from proxops.diagrams.flight import Provenance, bounded_backup
from proxops.diagrams.scenario import (
    AssuranceConfig,
    Body,
    Scenario,
    dump_scenario,
    load_body,
    load_scenario,
    uncertainty_set,
)
from proxops.systems.assurance import AssuranceBounds, BackupBraking, InterventionReason
from proxops.systems.common import InputError, write_whole

# Errors of the state at Kleopatra with the default spacecraft, in m and m/s: four or more standard
# deviations of what the navigation reaches there. Elsewhere they go with length and thrust.
STATE = {
    "as_believed": (0.0, 0.0),
    "after_survey": (120.0, 0.3),
    "before_survey": (300.0, 0.5),
    "first_look": (600.0, 0.5),
}
_LONGEST, _ACCELERATION = 140e3, 0.07
# Upper ends in µs of the bins of step times.
_BINS = np.geomspace(1.0, 1e6, 241)
# Cross-entropy search: controllers in a round, the share that is kept, flights of each.
_POPULATION, _KEPT, _FLIGHTS_EACH = 24, 0.25, 8
_OUT = Path("out/assurance")


@functools.cache
def setting(scenario_file: str | None, bounds_name: str) -> tuple[Scenario, Body, BackupBraking]:
    """Scenario, body and the backup with the bounds that dispersions declare.

    It flies a step, so that what is compiled is there.
    """
    scenario = load_scenario(scenario_file)
    body = load_body(scenario.body)
    bounds = AssuranceBounds()
    if bounds_name != "as_believed":
        assured = replace(scenario, assurance=AssuranceConfig(bounds=bounds_name))
        bounds = uncertainty_set(assured, body)
    position, velocity = STATE[bounds_name]
    craft = scenario.spacecraft
    length = float(body.keep_out_semi_axes.max()) / _LONGEST
    push = craft.thrust_limit_n / craft.mass_kg / _ACCELERATION
    bounds = replace(
        bounds, position_m=length * position, velocity_m_s=math.sqrt(length * push) * velocity
    )
    try:
        backup = bounded_backup(scenario, body, bounds)
    except InputError as error:
        sys.exit(str(error))
    adversarial_flight(scenario, body, "zero", 0, steps=1, backup=backup)
    return scenario, body, backup


def drawn(seed: int, number: int) -> tuple[str, str, str]:
    """Adversary, truth and state errors of a flight."""
    random = np.random.default_rng([seed, number])
    truths = TRUTHS[1:]
    weights = np.array([2.0 if name in ("corner", "hurting") else 1.0 for name in truths])
    return (
        list(ADVERSARIES)[number % len(ADVERSARIES)],
        str(random.choice(truths, p=weights / weights.sum())),
        str(random.choice(STATE_ERRORS[1:])),
    )


def fly(work: tuple) -> dict:
    scenario_file, bounds_name, excess, seed, steps, number, assured = work
    scenario, body, backup = setting(scenario_file, bounds_name)
    adversary, truth, errors = drawn(seed, number)
    flight = adversarial_flight(
        scenario, body, adversary, seed + number, steps, assured,
        backup=backup, truth=truth, state_errors=errors, excess=excess,
    )  # fmt: skip
    micros, unchanged = flight.step_seconds * 1e6, flight.reasons == InterventionReason.NONE
    return {
        "number": number,
        "assured": assured,
        "adversary": adversary,
        "truth": truth,
        "errors": errors,
        "clearance": flight.clearance,
        "speed": flight.speed,
        "reasons": np.bincount(flight.reasons, minlength=5).tolist(),
        "times": np.bincount(np.searchsorted(_BINS, micros), minlength=242).tolist(),
        "unchanged": np.bincount(np.searchsorted(_BINS, micros[unchanged]), minlength=242).tolist(),
        "most": float(micros.max()),
    }


def percentile(rows: list[dict], which: str, share: float) -> float:
    counts = np.sum([row[which] for row in rows], axis=0)
    if not counts.any():
        return math.nan
    place = int(np.searchsorted(np.cumsum(counts), share * counts.sum()))
    return float(_BINS[min(place, len(_BINS) - 1)])


def report(title: str, rows: list[dict], speed_limit: float) -> int:
    """Prints a table by adversary, truth and state errors; returns the number of entries."""
    groups, lines = {"all": rows}, {}
    for key in ("adversary", "truth", "errors"):
        for name in sorted({row[key] for row in rows}):
            groups[f"{key}: {name}"] = [row for row in rows if row[key] == name]
    for name, some in groups.items():
        reasons = np.sum([row["reasons"] for row in some], axis=0)
        lines[name] = [
            str(len(some)), str(sum(row["clearance"] < 0.0 for row in some)),
            f"{min(row['clearance'] for row in some):.1f}",
            f"{max(row['speed'] for row in some) - speed_limit:.4f}",
            f"{reasons[3:].sum() / reasons.sum():.1%}", f"{reasons[2] / reasons.sum():.1%}",
            f"{percentile(some, 'unchanged', 0.5):.0f}", f"{percentile(some, 'times', 0.99):.0f}",
            f"{max(row['most'] for row in some):.0f}",
        ]  # fmt: skip
    headings = (
        "flights", "entries", "least clearance (m)", "speed over limit (m/s)", "keep-out (steps)",
        "speed (steps)", "median unchanged (µs)", "p99 (µs)", "most (µs)",
    )  # fmt: skip
    Shown(title, headings, lines).show()
    return sum(row["clearance"] < 0.0 for row in rows)


def read_rows(path: Path, header: dict) -> list[dict]:
    """The rows that an earlier run left; refuses those of other settings."""
    if not path.exists():
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(json.dumps(header) + "\n")
        return []
    # A line that was cut off when the program was stopped is flown again.
    text = path.read_text()
    lines = text[: text.rfind("\n") + 1].splitlines()
    if not lines or json.loads(lines[0]) != header:
        sys.exit(f"{path} holds flights of other settings: name another folder with --out")
    text = "\n".join(lines) + "\n"
    write_whole(path, lambda name: name.write_text(text))
    return [json.loads(line) for line in lines[1:]]


def search(options: argparse.Namespace) -> None:
    """Cross-entropy search for a small controller that gets closest to the ellipsoid."""
    scenario, body, backup = setting(options.scenario, options.bounds)
    random, shape = np.random.default_rng(options.seed), CONTROLLER_SHAPE
    middle, spread = np.zeros(shape), np.ones(shape)
    best, least = middle, math.inf
    for number in range(options.search):
        drawn_weights = middle + spread * random.normal(size=(_POPULATION, *shape))
        scores = []
        for weights in drawn_weights:
            found = []
            for k in range(_FLIGHTS_EACH):
                seed = options.seed + _FLIGHTS_EACH * number + k
                _, truth, errors = drawn(seed, 0)
                flight = adversarial_flight(
                    scenario, body, "zero", seed, options.steps, backup=backup, truth=truth,
                    state_errors=errors, adversary=small_controller(backup, weights),
                )  # fmt: skip
                found.append(flight.clearance)
            scores.append(np.mean(np.log(np.maximum(found, 0.1))))
            if min(found) < least:
                best, least = weights, min(found)
        order = np.argsort(scores)[: int(_KEPT * _POPULATION)]
        middle, spread = drawn_weights[order].mean(axis=0), drawn_weights[order].std(axis=0) + 0.05
        print(f"round {number}: best {min(scores):.2f}, least clearance {least:.1f} m", flush=True)
    print(np.array2string(middle, precision=2, separator=", "))
    print("closest:", np.array2string(best, precision=2, separator=", "))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--bounds", choices=list(STATE), default="after_survey")
    parser.add_argument("--scenario", help="YAML file, of another body")
    parser.add_argument("--flights", type=int, default=1000)
    parser.add_argument("--steps", type=int, default=600)
    parser.add_argument("--bare", type=int, default=0, help="of them without assurance too")
    parser.add_argument("--excess", type=float, default=1.0, help="the worlds' box over that told")
    parser.add_argument("--seed", type=int, default=10000)
    parser.add_argument("--processes", type=int, default=1)
    parser.add_argument("--out", type=Path, default=_OUT)
    parser.add_argument("--search", type=int, default=0, help="rounds of a search for an adversary")
    parser.add_argument("--end", type=int, default=0, help="states of which the end is sampled")
    options = parser.parse_args()
    if options.search:
        return search(options)
    if options.end:
        _, _, backup = setting(options.scenario, options.bounds)
        return sample_end(backup, options.bounds, options.end, options.seed)
    kept = ("bounds", "scenario", "steps", "excess", "seed")
    header = {key: getattr(options, key) for key in kept}
    scenario, body, _ = setting(options.scenario, options.bounds)
    # Flights of another version, or at a body or in a scenario that was changed, are not the same.
    header |= {"origin": str(Provenance.of(body)), "values": dump_scenario(scenario)}
    path = options.out / "rows.jsonl"
    rows = read_rows(path, header)
    done = {(row["number"], row["assured"]) for row in rows}
    given = (options.scenario, options.bounds, options.excess, options.seed, options.steps)
    work = [(*given, number, True) for number in range(options.flights)]
    work += [(*given, number, False) for number in range(options.bare)]
    work = [item for item in work if item[-2:] not in done]
    columns = (TextColumn("flying"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    context = multiprocessing.get_context("spawn")
    with (
        Progress(*columns) as progress,
        context.Pool(options.processes) as pool,
        path.open("a") as file,
    ):
        for row in progress.track(pool.imap_unordered(fly, work), total=len(work)):
            rows.append(row)
            file.write(json.dumps(row) + "\n")
            file.flush()
    limit = scenario.spacecraft.speed_limit_m_s
    title = f"{options.bounds}, {options.steps} steps each"
    bare = [row for row in rows if not row["assured"]]
    if bare:
        report(f"without assurance, {title}", bare, limit)
    if report(f"with assurance, {title}", [row for row in rows if row["assured"]], limit):
        sys.exit("runtime assurance let the spacecraft into the keep-out ellipsoid")
    return None


if __name__ == "__main__":
    main()
