"""Shows what flights of a campaign cost, from one flight to many and on one to many workers.

Each campaign flies transits of a seed with `run_campaign`, with their logs, in a new folder. Its
wall time has the start of the workers in it; its processor time is that of this process and of all
workers. What a million flights would take is arithmetic: a million times what one flight of the
line takes. Nothing else should run.

    python benchmarks/costs.py [--controllers mpc policy hybrid] [--flights 1 10 100]
        [--workers 1 2 4 8] [--seed 10000] [--set gravity=table …] [--markdown FILE]
"""

import argparse
import resource
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

from _campaign import show

from proxops.diagrams.flight import Workers, run_campaign, transit_flights
from proxops.diagrams.scenario import Scenario, load_scenario
from proxops.systems.common import InputError

A_MILLION, A_DAY = 1e6, 86_400.0
HEADINGS = (
    "wall time a flight (s)", "a thousand (min)", "processor time a flight (s)", "its log (MB)",
    "a million: days of one core", "a million: logs (TB)",
)  # fmt: skip


class Cost(NamedTuple):
    """What a campaign took, for each of its flights."""

    wall_s: float
    processor_s: float
    log_bytes: float


def processor_time() -> float:
    """Processor time in s of this process and of its children that have ended."""
    usage = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(each.ru_utime + each.ru_stime for each in usage)


def campaign(scenario: Scenario, controller: str, seed: int, flights: int, workers: int) -> Cost:
    """Flies a campaign in a folder that is gone afterwards."""
    wanted = transit_flights(scenario, controller, seed, flights)
    with tempfile.TemporaryDirectory() as folder:
        wall, spent = time.perf_counter(), processor_time()
        run_campaign(wanted, Path(folder), keep_logs=True, workers=Workers(workers))
        wall, spent = time.perf_counter() - wall, processor_time() - spent
        size = sum(file.stat().st_size for file in Path(folder).rglob("*.nc"))
    return Cost(wall / flights, spent / flights, size / flights)


def cells(cost: Cost) -> list[str]:
    """A line of the table."""
    return [
        f"{cost.wall_s:.2f}",
        f"{cost.wall_s * 1e3 / 60.0:.1f}",
        f"{cost.processor_s:.2f}",
        f"{cost.log_bytes / 1e6:.2f}",
        f"{cost.processor_s * A_MILLION / A_DAY:.1f}",
        f"{cost.log_bytes * A_MILLION / 1e12:.2f}",
    ]


def options() -> argparse.Namespace:
    """The options of the command line; ends the program if one is wrong."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--controllers", nargs="+", default=["mpc", "policy", "hybrid"])
    parser.add_argument("--flights", nargs="+", type=int, default=[1, 10, 100])
    parser.add_argument("--workers", nargs="+", type=int, default=[1, 2, 4, 8])
    parser.add_argument("--seed", type=int, default=10_000)
    parser.add_argument("--set", nargs="+", default=[], metavar="KEY=VALUE")
    parser.add_argument("--markdown", type=Path, help="also write the table there")
    return parser.parse_args()


def main() -> None:
    asked, lines = options(), {}
    try:
        scenario = load_scenario(None, asked.set)
        for controller in asked.controllers:
            campaign(scenario, controller, asked.seed, 1, 1)  # Compiles what is not compiled yet.
            for count in asked.flights:
                for workers in sorted({min(each, count) for each in asked.workers}):
                    cost = campaign(scenario, controller, asked.seed, count, workers)
                    name = f"{controller}, {count} flights, {workers} workers"
                    lines[name] = cells(cost)
                    print(name, *lines[name], flush=True)
    except InputError as error:
        raise SystemExit(str(error)) from error
    show(f"transits of seed {asked.seed}, with their logs", HEADINGS, lines, asked.markdown)


if __name__ == "__main__":
    main()
