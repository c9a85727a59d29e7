"""The report of an evaluation: the controllers beside each other, and why flights fail."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from importlib import metadata

import numpy as np

from proxops.diagrams.flight import Row
from proxops.diagrams.logs import length_text, three_digits
from proxops.diagrams.scenario import Scenario
from proxops.studies.evaluation.evaluation import EXPERT, delta_v_pairs, every_row
from proxops.studies.evaluation.figures import (
    Looks,
    controller_looks,
    plot_delta_v,
    plot_end_errors,
    plot_flights,
    plot_paths,
)
from proxops.studies.evaluation.flights import flew_a_policy, path_transits, worst_flights
from proxops.studies.evaluation.monte_carlo_report import (
    driver_sections,
    unflyable_sections,
    worst_tables,
)
from proxops.studies.evaluation.table import Results, arrival_text, figure_rows, outcome
from proxops.studies.evaluation.variants import Logs
from proxops.training.reports import Picture, Section, Table, Text, picture

_MOST_FAILURES_TOLD = 30


@dataclass(frozen=True)
class Evaluation:
    """Everything that the report of an evaluation is made from."""

    command: str
    """The command as it was typed."""
    body: str
    seed: int
    scenario: Scenario
    results: Results
    logs: Logs
    """They include those of the flights that `shown_transits` names."""


def evaluation_sections(evaluation: Evaluation) -> list[Section]:
    """Makes the report, which `write_report` writes."""
    results, logs = evaluation.results, evaluation.logs
    looks = controller_looks(list(results))
    sections = [_head(evaluation), *unflyable_sections(results)]
    if any(result["flights"] for result in results.values()):
        sections.append(Section("How flights end", [_end_errors(evaluation, looks)]))
    if (compared := _delta_v(results, looks)) is not None:
        sections.append(Section("Fuel against the expert's", [compared]))
    if transits := path_transits(results):
        sections.append(Section("Paths", [_paths(transits, logs, looks)]))
    sections += driver_sections(results)
    for k, (name, result) in enumerate(results.items()):
        blocks = worst_tables(name, result)
        if flew_a_policy(result["flights"]):
            blocks += _worst(f"worst-{k}", name, result["flights"], logs)
        if blocks:
            sections.append(Section(f"Worst flights of {name}", blocks))
    failures = [
        row for result in results.values() for row in result["flights"] if not row["success"]
    ]
    if failures:
        sections.append(Section("Flights without success", _failures(failures)))
    return sections


def _head(evaluation: Evaluation) -> Section:
    arrival, results = evaluation.scenario.arrival, evaluation.results
    lines = [[label, *cells] for label, cells in figure_rows(results, arrival)]
    count = len(every_row(next(iter(results.values()))))
    return Section(
        f"{count} transits of seed {evaluation.seed}",
        [
            Text(evaluation.command, code=True),
            Text(
                f"{evaluation.body}, proxops {metadata.version('proxops')}. Success is arrival "
                f"within {arrival_text(arrival)} of the goal by {arrival.deadline_s:g} s, to stay "
                f"there for {arrival.dwell_s:g} s, with no collision and no keep-out violation. "
                "Intervals are Wilson's, unless they are called exact (Clopper and Pearson's). "
                "Δv and arrival count the flights that succeeded; Δv over the expert's counts the "
                "transits in which both succeeded. “Delta-v, p99, at most” is an upper bound of "
                "that percentile with 90 % confidence; it needs 230 flights that succeeded. "
                "Position off and velocity off are errors of a policy's estimates: medians over "
                "flights of each flight's median and p95."
            ),
            Table(["", *results], lines),
        ],
    )


def _end_errors(evaluation: Evaluation, looks: Looks) -> Picture:
    errors = {
        name: np.array([row["terminal_position_error_m"] for row in result["flights"]])
        for name, result in evaluation.results.items()
        if result["flights"]
    }
    caption = "Share of flights that end within a distance of the goal; dashed: arrival's radius."
    radius = evaluation.scenario.arrival.radius_m
    return picture("end-errors", plot_end_errors(errors, radius, looks), caption)


def _delta_v(results: Results, looks: Looks) -> Picture | None:
    if EXPERT not in results:
        return None
    best = every_row(results[EXPERT])
    pairs = {
        name: delta_v_pairs(every_row(result), best)
        for name, result in results.items()
        if name != EXPERT
    }
    pairs = {name: found for name, found in pairs.items() if len(found)}
    if not pairs:
        return None
    caption = "Each dot is a transit in which both succeeded; their number is in brackets."
    return picture("delta-v", plot_delta_v(pairs, looks), caption)


def _paths(transits: Sequence[int], logs: Logs, looks: Looks) -> Picture:
    shown = {name: [flown[transit] for transit in transits] for name, flown in logs.items()}
    caption = "The first transits in the frame that turns with the body; a cross is a collision."
    return picture("paths", plot_paths(shown, looks), caption)


def _worst(figure: str, name: str, rows: Sequence[Row], logs: Logs) -> list[Text | Picture]:
    worst = worst_flights(rows)
    flights = [logs[name][row["transit"]] for row in worst]
    titles = [
        f"transit {row['transit']}: {outcome(row)}, "
        f"{length_text(row['terminal_position_error_m'])} off at the end"
        for row in worst
    ]
    caption = "Green: the limits and the time of arrival; blue: the keep-out ellipsoid."
    if all("estimate" in log.dataset for log in flights):
        caption = f"Distance to the goal, true (solid) and estimated (dashed). {caption}"
    return [picture(figure, plot_flights(flights, titles), caption)]


def _failures(failures: Sequence[Row]) -> list[Text | Table]:
    lines = [
        [
            row["controller"],
            str(row["transit"]),
            outcome(row),
            length_text(row["terminal_position_error_m"]),
            f"{three_digits(row['terminal_speed_m_s'])} m/s",
            length_text(row["min_clearance_m"]),
        ]
        for row in failures[:_MOST_FAILURES_TOLD]
    ]
    head = ["controller", "transit", "what happened", "end error", "end speed", "least clearance"]
    left = len(failures) - len(lines)
    more = [Text(f"{left} more are in results.json.")] if left else []
    return [Table(head, lines), *more]
