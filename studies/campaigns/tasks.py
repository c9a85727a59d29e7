"""Surveys and missions, many of them: each in a folder of its own, which holds its row at the end.

They are no flights of a campaign: a survey has an estimator in place of a controller, and no log of
a flight, and a mission makes a map first.
"""

from __future__ import annotations

import dataclasses as dc
import json
import typing
from collections.abc import Sequence
from pathlib import Path

from proxops.diagrams.flight import Row, Workers, controller_label, provenance
from proxops.diagrams.scenario import (
    MissionConfig,
    Scenario,
    SurveyConfig,
    dispersed_values,
    dump_scenario,
    load_body,
    of_transit,
)
from proxops.studies.campaigns.describing import describe_flight
from proxops.studies.campaigns.variants import Variant
from proxops.systems.common import InputError, make_folder, write_json

if typing.TYPE_CHECKING:
    from proxops.diagrams.surveys import Surveyed

_ROW = "row.json"
# Errors of which the size counts.
_ERRORS = ("gravity_error", "rate_error", "pole_error_deg")


def makes_a_map(scenario: Scenario) -> bool:
    """Whether a scenario's task is a survey or a mission."""
    return isinstance(scenario.task, SurveyConfig | MissionConfig)


@dc.dataclass(frozen=True)
class TaskRun:
    """A survey or a mission in a world of its own."""

    name: str
    scenario: Scenario
    controller: str
    """Of a survey its estimator: see `run_survey`."""
    folder: Path
    """Takes all files that the task writes."""

    @property
    def identity(self) -> dict[str, str]:
        """What the row depends on."""
        body = load_body(self.scenario.body)
        origin = provenance(dc.replace(self.scenario, body=""), body, self.controller)
        return {"scenario": dump_scenario(self.scenario), "origin": str(origin)}

    def row(self) -> Row:
        """Its row; it is flown once a folder.

        Raises:
          InputError: the folder holds the row of another one.
        """
        path, identity = self.folder / _ROW, self.identity
        if not path.is_file():
            make_folder(self.folder)
            write_json(path, {"task": identity, "summary": self._flown()})
        content = json.loads(path.read_text(encoding="utf-8"))
        if content["task"] != identity:
            raise InputError(
                f"{path} is of another scenario, controller, body or version of proxops: give "
                "another output folder, or remove this file to fly it anew"
            )
        return content["summary"]

    def _flown(self) -> Row:
        # It imports matplotlib, which is slow, and each worker imports this module.
        from proxops.diagrams.surveys import run_mission, run_survey

        scenario, rules = self.scenario, self.scenario.transit
        row = {"controller": self.controller, "seed": rules.seed, "transit": rules.index}
        body = load_body(scenario.body)
        try:
            if isinstance(scenario.task, SurveyConfig):
                surveyed = run_survey(scenario, body, self.folder, estimator=self.controller)
                return row | _survey_row(surveyed)
            surveyed, log = run_mission(scenario, body, self.folder, self.controller)
        except InputError as error:  # It saw too little, or no place can be touched.
            return row | {"success": False, "ended_early": str(error)}
        log.to_netcdf(self.folder / "flight.nc")
        flown = {**describe_flight(log, None), **_figures(surveyed)}
        total = flown["delta_v_m_s"] + flown["survey_delta_v_m_s"]
        return flown | row | {"mission_delta_v_m_s": total}


def task_name(controller: str, seed: int, index: int) -> str:
    """The name of a survey's or a mission's folder."""
    return f"{controller_label(controller)}-{seed}-{index:05d}"


def fly_tasks(
    variants: Sequence[Variant],
    scenario: Scenario,
    seed: int,
    count: int,
    folder: Path,
    workers: Workers = Workers(),
) -> dict[str, list[Row]]:
    """Flies the surveys or missions 0 … count - 1 of a seed; gives their rows in order, by name.

    Args:
      variants: whose controllers fly the transits of missions, or estimate surveys.
      scenario: whose task `makes_a_map`; each has a world of its own, drawn from its dispersions.
      folder: takes a folder of each. What has ended there is not flown again.
      workers: fly, and report how many have ended.

    Raises:
      InputError: see `TaskRun.row`.
    """
    runs: dict[str, list[TaskRun]] = {}
    for each in variants:
        changed = each.applied_to(scenario)
        names = [task_name(each.name, seed, k) for k in range(count)]
        runs[each.name] = [
            TaskRun(name, of_transit(changed, seed, k), each.controller, (folder / name).resolve())
            for k, name in enumerate(names)
        ]
    pieces = [run for group in runs.values() for run in group]
    rows = iter(fly_runs(pieces, workers))
    return {name: [next(rows) for _ in group] for name, group in runs.items()}


def fly_runs(pieces: Sequence[TaskRun], workers: Workers = Workers()) -> list[Row]:
    """Flies surveys or missions of different names; gives their rows in order: see `fly_tasks`."""
    found: dict[str, Row] = {}
    for name, row in workers.results(pieces, TaskRun.row):
        found[name] = row
        good = sum(row["success"] for row in found.values())
        text = f"{len(found)} of {len(pieces)}, {len(found) - good} without success"
        workers.progress(len(found) / len(pieces), text)
    return [found[run.name] for run in pieces]


def _survey_row(surveyed: Surveyed) -> dict[str, typing.Any]:
    """The row of a survey: it succeeds with a map, and without a collision or an entry."""
    figures = surveyed.figures
    clean = not figures["collided"] and figures["keep_out_entries"] == 0
    return {
        "success": clean,
        "collided": figures["collided"],
        "keep_out_violations": figures["keep_out_entries"],
        **_figures(surveyed),
    }


def _figures(surveyed: Surveyed) -> dict[str, typing.Any]:
    """Figures of a survey as those of a row."""
    figures = surveyed.figures | {name: abs(surveyed.figures[name]) for name in _ERRORS}
    figures["wall_s"] = figures["flight_s"] + figures["estimation_s"]
    drawn = dispersed_values(surveyed.flight.world.scenario)
    return {"dispersed": drawn} | {f"survey_{name}": value for name, value in figures.items()}
