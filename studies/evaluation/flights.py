"""What an evaluation keeps of each flight, and the flights whose logs its report shows."""

from __future__ import annotations

import dataclasses as dc
import typing
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from proxops.diagrams.flight import Row
from proxops.diagrams.logs import FlightLog, commanded_forces
from proxops.diagrams.scenario import Scenario
from proxops.studies.evaluation.table import Result, Results
from proxops.studies.evaluation.variants import Logs, Variant, fly_logs
from proxops.training.reports import SMALL_COMMAND

PATHS = 4
"""Greatest number of transits whose paths are drawn."""
_WORST = 3
_REPLAYED = 5


def describe_flight(log: FlightLog, path: Path | None) -> Row:
    """Returns a flight's summary and its `small_command_share`.

    This is the share of steps at which the commanded force is below 3 % of the thrust limit (0.2 N
    of 7 N) in magnitude. `path` is not used; `run_campaign` gives it.
    """
    data, limit = log.dataset, log.scenario.spacecraft.thrust_limit_n
    commands = commanded_forces(data["force"].values, data["disturbance"].values, limit)[:-1]
    small = np.linalg.norm(commands, axis=1) < SMALL_COMMAND * limit
    return log.summary | {"small_command_share": float(small.mean())}


def worst_flights(rows: Sequence[Row], count: int = _WORST) -> list[Row]:
    """Returns the rows of the worst flights: first those that failed, then by the end error."""
    return sorted(rows, key=lambda row: (row["success"], -row["terminal_position_error_m"]))[:count]


def replayed_flights(result: Result) -> list[Row]:
    """Returns the five worst flights of a controller, whose replays belong to a report.

    There are none if all flights succeeded and nothing was dispersed.
    """
    rows = result["flights"]
    wanted = any(not row["success"] or row.get("dispersed") for row in rows)
    return worst_flights(rows, _REPLAYED) if wanted else []


def path_transits(results: Results) -> list[int]:
    """Returns the transits whose paths are drawn: the first ones that all controllers flew."""
    flown = [{row["transit"] for row in result["flights"]} for result in results.values()]
    return sorted(set.intersection(*flown))[:PATHS]


def shown_transits(results: Results) -> dict[str, list[int]]:
    """Returns, for each controller, the transits whose logs a report needs, in rising order."""
    shown = {}
    for name, result in results.items():
        wanted = {*path_transits(results), *(row["transit"] for row in replayed_flights(result))}
        if flew_a_policy(result["flights"]):
            wanted |= {row["transit"] for row in worst_flights(result["flights"])}
        shown[name] = sorted(wanted)
    return shown


def shown_logs(
    results: Results,
    scenario: Scenario,
    seed: int,
    folder: Path,
    *,
    frames: bool = False,
    **options: typing.Any,
) -> Logs:
    """Returns the logs of the flights that `shown_transits` names, flown again if need be.

    Args:
      results: by the controller's name.
      folder: a folder for these flights alone; or, if all logs were kept, that of all flights.
      frames: keeps lidar frames, as the logs in the folder of all flights do. The report does not
        need them, and they take most of the space.
      options: those of `run_campaign`.

    Raises:
      InputError: see `fly_logs`.
    """
    flown = dc.replace(scenario, log_ranges=scenario.log_ranges and frames)
    variants = [Variant(name, name) for name in results]
    return fly_logs(variants, flown, seed, shown_transits(results), folder, **options)


def flew_a_policy(rows: Sequence[Row]) -> bool:
    """Whether a controller flew a policy, or used a policy's estimates."""
    return any(row["policy_sha256"] is not None for row in rows)
