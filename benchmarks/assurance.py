"""Tests runtime assurance against adversaries: does it ever let the spacecraft in?

Flights start at random admitted states in the cube, half of them within 8 km of the keep-out
ellipsoid, at up to the speed limit along each axis. Four adversaries fly in turn. The motion is
integrated with polyhedral gravity, by another method than the assurance's own prediction, and
clearance is computed ten times a step. Some flights are flown without assurance too, to show that
the adversaries do harm. Times are processor times of the whole step. The program ends with an error
if there is a violation.

    python benchmarks/assurance.py [--flights 1000] [--steps 600] [--bare 100] [--processes 1]
"""

import argparse
import functools
import multiprocessing
import os
import sys
from typing import NamedTuple

for name in ("OMP_NUM_THREADS", "NUMBA_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ[name] = "1"

import numpy as np
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from proxops.diagrams.flight import ADVERSARIES, adversarial_flight
from proxops.diagrams.logs import INTERVENTION_TOLERANCE, KEEP_OUT_TOLERANCE
from proxops.diagrams.scenario import load_body, load_scenario

NAMES = list(ADVERSARIES)


class Row(NamedTuple):
    """One flight: clearance in m, speed in m/s, share of steps changed, times of steps in s."""

    number: int
    assured: bool
    clearance: float
    speed: float
    changed: float
    seconds: np.ndarray


@functools.cache
def world():
    """Scenario and body; flies a step, so that what is compiled is there."""
    scenario = load_scenario()
    body = load_body(scenario.body)
    adversarial_flight(scenario, body, NAMES[0], 0, steps=1)
    return scenario, body


def fly(work: tuple[int, int, int, bool]) -> Row:
    number, seed, steps, assured = work
    scenario, body = world()
    name = NAMES[number % len(NAMES)]
    flight = adversarial_flight(scenario, body, name, seed + number, steps, assured)
    change = np.linalg.norm(flight.forces - flight.commands, axis=1)
    changed = float(np.mean(change > INTERVENTION_TOLERANCE))
    return Row(number, assured, flight.clearance, flight.speed, changed, flight.step_seconds)


def report(title: str, rows: list[Row], speed_limit: float) -> int:
    """Prints a table by adversary; returns the number of flights with a violation."""
    table = Table(title=title)
    headings = ("", "flights", "violations", "least clearance (m)", "speed over limit (m/s)")
    for heading in (*headings, "steps changed", "median (µs)", "p99 (µs)", "most (µs)"):
        table.add_column(heading, justify="left" if not heading else "right")
    in_all = 0
    for name in [*NAMES, "all"]:
        some = [row for row in rows if name in ("all", NAMES[row.number % len(NAMES)])]
        if not some:
            continue
        in_all = sum(row.clearance < -KEEP_OUT_TOLERANCE for row in some)
        seconds = np.concatenate([row.seconds for row in some]) * 1e6
        table.add_row(
            name, str(len(some)), str(in_all),
            f"{min(row.clearance for row in some):.1f}",
            f"{max(row.speed for row in some) - speed_limit:.4f}",
            f"{np.mean([row.changed for row in some]):.1%}",
            *(f"{np.percentile(seconds, q):.0f}" for q in (50, 99, 100)),
        )  # fmt: skip
    Console(width=120).print(table)
    return in_all


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--flights", type=int, default=1000)
    parser.add_argument("--steps", type=int, default=600)
    parser.add_argument("--bare", type=int, default=100, help="of them without assurance too")
    parser.add_argument("--seed", type=int, default=10000)
    parser.add_argument("--processes", type=int, default=1)
    options = parser.parse_args()
    work = [(number, options.seed, options.steps, True) for number in range(options.flights)]
    work += [(number, options.seed, options.steps, False) for number in range(options.bare)]
    rows = []
    columns = (TextColumn("flying"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    context = multiprocessing.get_context("spawn")
    with Progress(*columns) as progress, context.Pool(options.processes) as pool:
        for row in progress.track(pool.imap_unordered(fly, work), total=len(work)):
            rows.append(row)
    limit = world()[0].spacecraft.speed_limit_m_s
    length = f"{options.steps} steps each"
    if options.bare:
        report(f"without assurance, {length}", [row for row in rows if not row.assured], limit)
    if report(f"with assurance, {length}", [row for row in rows if row.assured], limit):
        sys.exit("runtime assurance let the spacecraft into the keep-out ellipsoid")


if __name__ == "__main__":
    main()
