"""The flights that a report looks into: which they are, their logs, and pages that replay them."""

from __future__ import annotations

import dataclasses as dc
from collections.abc import Sequence
from pathlib import Path

from proxops.diagrams.flight import Row, Workers, controller_label
from proxops.diagrams.meshcat import write_replay
from proxops.diagrams.scenario import Scenario
from proxops.studies.campaigns import Logs, Variant, fly_logs
from proxops.studies.figures import Result, Results
from proxops.systems.common import make_folder

_PATHS, _WORST, _REPLAYED = 4, 3, 5
_FOLDER = "worst"


def outcome(row: Row) -> str:
    """How a flight ended, in a few words."""
    if row["collided"]:
        return "collision"
    if row["keep_out_violations"]:
        return "inside the keep-out"
    if row["success"]:
        return "arrived"
    return "no arrival" if row["arrival_time_s"] is None else "arrived too late"


def worst_flights(rows: Sequence[Row], count: int = _WORST) -> list[Row]:
    """Returns the rows of the worst flights: first those that failed, then by the end error."""
    return sorted(rows, key=lambda row: (row["success"], -row["terminal_position_error_m"]))[:count]


def replayed_flights(result: Result) -> list[Row]:
    """Returns the five worst flights of a controller, whose replays belong to a report.

    There are none if all flights succeeded and nothing was dispersed.
    """
    wanted = any(not row["success"] or row.get("dispersed") for row in result.flights)
    return worst_flights(result.flights, _REPLAYED) if wanted else []


def path_transits(results: Results) -> list[int]:
    """Returns the transits whose paths are drawn: the first four that all controllers flew."""
    flown = [{row["transit"] for row in result.flights} for result in results.values()]
    return sorted(set.intersection(*flown))[:_PATHS]


def flew_a_policy(result: Result) -> bool:
    """Whether a controller flew a policy, or used a policy's estimates."""
    return any(row["policy_sha256"] is not None for row in result.flights)


def shown_transits(results: Results) -> dict[str, list[int]]:
    """Returns, for each controller, the transits whose logs a report needs, in rising order."""
    shown = {}
    for name, result in results.items():
        wanted = {*path_transits(results), *(row["transit"] for row in replayed_flights(result))}
        if flew_a_policy(result):
            wanted |= {row["transit"] for row in worst_flights(result.flights)}
        shown[name] = sorted(wanted)
    return shown


def shown_logs(
    results: Results, scenario: Scenario, seed: int, folder: Path, frames: bool, workers: Workers
) -> Logs:
    """Returns the logs of the flights that `shown_transits` names, flown again if need be.

    Args:
      folder: a folder for these flights alone; or, if all logs were kept, that of all flights.
      frames: keeps lidar frames, as the logs in the folder of all flights do. The report does not
        need them, and they take most of the space.
    """
    flown = dc.replace(scenario, log_ranges=scenario.log_ranges and frames)
    variants = [Variant(name, name) for name in results]
    return fly_logs(variants, flown, seed, shown_transits(results), folder, workers=workers)


def replay_page(name: str, row: Row) -> str:
    """The page that replays a flight of a controller, relative to the folder of the report."""
    return f"{_FOLDER}/{controller_label(name)}-{row['transit']:05d}.html"


def write_worst(folder: Path, results: Results, logs: Logs) -> None:
    """Writes a replay page of each of the worst flights of each controller, `worst/NAME.html`.

    Args:
      folder: of the report, which links to them.
      logs: they include those of `replayed_flights`.
    """
    for name, result in results.items():
        worst = replayed_flights(result)
        shown = {folder / replay_page(name, row) for row in worst}
        # Those of an earlier run are no longer linked.
        for old in (folder / _FOLDER).glob(f"{controller_label(name)}-{'[0-9]' * 5}.html"):
            if old not in shown:
                old.unlink()
        for row in worst:
            make_folder(folder / _FOLDER)
            write_replay(logs[name][row["transit"]], folder / replay_page(name, row))
