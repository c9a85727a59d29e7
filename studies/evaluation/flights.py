"""The flights of an evaluation: each controller's on the same transits, and those worth a look."""

from __future__ import annotations

import dataclasses as dc
import typing
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from proxops.diagrams.flight import run_campaign, run_groups, transit_flights
from proxops.diagrams.logs import FlightLog
from proxops.diagrams.scenario import Scenario
from proxops.studies.evaluation.evaluation import EXPERT, Row, aggregate
from proxops.studies.evaluation.table import Results

Logs = Mapping[tuple[str, int], FlightLog]
"""Logs by controller and transit."""

PATHS = 4
"""Transits whose paths are drawn: the first of the set."""
_WORST = 3


def fly_controllers(
    controllers: Sequence[str],
    scenario: Scenario,
    seed: int,
    count: int,
    folder: Path,
    *,
    keep_logs: bool = False,
    progress: Callable[[Row], None] | None = None,
    workers: int | None = None,
    scheduler: str | None = None,
) -> dict[str, dict[str, typing.Any]]:
    """Flies transits 0 … count - 1 of a seed with each controller; their entries of `results.json`.

    What was flown before into the same folder is not flown again; see `run_campaign` for this and
    for the arguments. If the MPC is among the controllers, the others are compared with it.
    """
    by_name = run_groups(
        {name: transit_flights(scenario, name, seed, count) for name in controllers},
        folder,
        keep_logs=keep_logs,
        workers=workers,
        scheduler=scheduler,
        progress=progress,
    )
    expert = by_name.get(EXPERT)
    return {
        name: aggregate(flown, None if name == EXPERT else expert)
        for name, flown in by_name.items()
    }


def worst_flights(rows: Sequence[Row], count: int = _WORST) -> list[Row]:
    """Rows of the worst flights: those without success first, then by the error at the end."""
    return sorted(rows, key=lambda row: (row["success"], -row["terminal_position_error_m"]))[:count]


def shown_transits(results: Results) -> dict[str, list[int]]:
    """Numbers of the transits of each controller whose logs a report needs, in rising order."""
    shown = {}
    for name, result in results.items():
        rows = result["flights"]
        wanted = {row["transit"] for row in rows[:PATHS]}
        if flew_a_policy(rows):
            wanted |= {row["transit"] for row in worst_flights(rows)}
        shown[name] = sorted(wanted)
    return shown


def shown_logs(
    results: Results,
    scenario: Scenario,
    seed: int,
    folder: Path,
    *,
    frames: bool = False,
    workers: int | None = None,
    scheduler: str | None = None,
) -> Logs:
    """Logs of the flights that `shown_transits` names.

    Flights repeat bit for bit, so these few are flown again, once, rather than all logs kept.

    Args:
      folder: of these flights alone; or, if all logs were kept, of all.
      frames: with lidar frames, as in the latter; they change nothing, and take most of the room.
    """
    flown = dc.replace(scenario, log_ranges=scenario.log_ranges and frames)
    flights = {}
    for name, transits in shown_transits(results).items():
        everything = transit_flights(flown, name, seed, max(transits) + 1)
        flights |= {(name, transit): everything[transit] for transit in transits}
    run_campaign(
        list(flights.values()), folder, keep_logs=True, workers=workers, scheduler=scheduler
    )
    return {key: FlightLog.load(folder / f"{flight.name}.nc") for key, flight in flights.items()}


def flew_a_policy(rows: Sequence[Row]) -> bool:
    """Whether a controller flew a policy, or what it estimates."""
    return any(row["policy_sha256"] is not None for row in rows)
