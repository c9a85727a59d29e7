"""The flights that a report looks into: which they are, their logs, and pages that replay them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from proxops.diagrams.flight import Row, Workers, controller_label
from proxops.diagrams.logs import FlightLog
from proxops.diagrams.meshcat import write_replay
from proxops.diagrams.scenario import Scenario
from proxops.studies.campaigns import Logs, Variant, describe_flight, fly_logs, task_name
from proxops.studies.figures import Result, Results
from proxops.systems.common import make_folder

_PATHS, _WORST, _REPLAYED = 4, 3, 5
_FOLDER = "worst"


def worst_flights(rows: Sequence[Row], count: int = _WORST) -> list[Row]:
    """Returns the rows of the worst flights: those that failed, then by the miss or end error.

    Surveys, and missions that ended with theirs, have no log of a flight, and are left out.
    """

    def rank(row: Row) -> tuple[bool, float]:
        return row["success"], -(row.get("touch_miss_m") or row["terminal_position_error_m"])

    flown = [row for row in rows if "terminal_position_error_m" in row]
    return sorted(flown, key=rank)[:count]


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
    return any(row.get("policy_sha256") is not None for row in result.flights)


def shown_transits(results: Results) -> dict[str, list[int]]:
    """Returns, for each controller, the transits whose logs a report needs, in rising order."""
    shown = {}
    for name, result in results.items():
        wanted = {*path_transits(results), *(row["transit"] for row in replayed_flights(result))}
        if flew_a_policy(result):
            wanted |= {row["transit"] for row in worst_flights(result.flights)}
        shown[name] = sorted(wanted)
    return shown


def may_be_shown(rows: Mapping[str, Row]) -> set[str]:
    """The names of flights, of some whose rows are given by name, that a report may show.

    They are the first four and the five worst of each controller. A campaign keeps their logs as it
    goes (`keep_logs` of `run_campaign`), so that few are flown again for the report.
    """
    names = {(row["controller"], row["transit"]): name for name, row in rows.items()}
    chosen = set()
    for controller in {controller for controller, _ in names}:
        own = [row for row in rows.values() if row["controller"] == controller]
        first = sorted(own, key=lambda row: row["transit"])[:_PATHS]
        chosen |= {(controller, row["transit"]) for row in (*first, *worst_flights(own, _REPLAYED))}
    return {names[each] for each in chosen}


def shown_logs(
    results: Results, scenario: Scenario, seed: int, folder: Path, workers: Workers
) -> Logs:
    """Returns the logs of the flights that `shown_transits` names, flown again if they are gone.

    Args:
      folder: that of all flights.
    """
    variants = [Variant(name, name) for name in results]
    return fly_logs(
        variants, scenario, seed, shown_transits(results), folder,
        describe=describe_flight, workers=workers,
    )  # fmt: skip


def mission_logs(results: Results, folder: Path) -> Logs:
    """Returns the logs of the worst missions of each controller, which belong to a report.

    Args:
      folder: that of all missions, which has a folder of each.
    """
    return {
        name: {
            row["transit"]: FlightLog.load(
                folder / task_name(name, row["seed"], row["transit"]) / "flight.nc"
            )
            for row in worst_flights(result.flights, _REPLAYED)
        }
        for name, result in results.items()
    }


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
