"""The report of an evaluation: controllers beside each other, what drives failure, the worst."""

from __future__ import annotations

import itertools
import typing
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from proxops.diagrams.flight import Row, Workers
from proxops.diagrams.logs import length_text, outcome, three_digits
from proxops.diagrams.scenario import (
    ArrivalConfig,
    MissionConfig,
    Scenario,
    SurveyConfig,
    TouchAndGoConfig,
    load_body,
)
from proxops.studies.campaigns import Logs, makes_a_map, task_name
from proxops.studies.figures import (
    EXPERT,
    LEAST_FLIGHTS,
    FigureRow,
    Result,
    Results,
    arrival_text,
    delta_v_pairs,
    figure_rows,
    told_from_chance,
)
from proxops.studies.report.plots import (
    OUTPUT_NAMES,
    Looks,
    controller_looks,
    plot_delta_v,
    plot_drivers,
    plot_end_errors,
    plot_flights,
    plot_paths,
    plot_scatter,
    strongest,
)
from proxops.studies.report.shown_flights import (
    flew_a_policy,
    mission_logs,
    path_transits,
    replay_page,
    replayed_flights,
    shown_logs,
    worst_flights,
    write_worst,
)
from proxops.training.reports import (
    DASH,
    Block,
    Cell,
    Folded,
    Link,
    Mark,
    Section,
    Table,
    Text,
    number_text,
    picture,
    write_report,
)

_MOST_LINES = 30
_DRIVERS_CAPTION = (
    "Blue: above chance. Hatched: the greatest index of all quantities where the outcomes are "
    "shuffled among the flights, as the median of 19 shuffles; dashed: the greatest of the 19, "
    "which chance exceeds in one ranking of 20. Lines are 90 % intervals: what the index would be "
    "with other flights."
)


def write_evaluation(
    out: Path,
    results: Results,
    scenario: Scenario,
    seed: int,
    *,
    provenance: Mapping[str, str],
    workers: Workers,
) -> None:
    """Writes the report of an evaluation, and pages that replay the worst flights.

    Args:
      out: a folder; its folder `flights` has the flights, and logs of those that are shown. What
        has no log is flown again.
      provenance: the command as it was typed, and what else tells where the results come from.
    """
    body = load_body(scenario.body).config.name
    count = len(next(iter(results.values())).rows)
    arrival = None if isinstance(scenario.task, SurveyConfig) else scenario.arrival
    head = [Text(f"{success_text(scenario)}."), *figure_blocks(results, arrival)]
    origin = {name: text for name, text in provenance.items() if name != "command"}
    if makes_a_map(scenario):
        logs = mission_logs(results, out / "flights")
        more = [*_drivers_and_worst(results, logs), Section("One by one", _tasks(results))]
    else:
        logs = shown_logs(results, scenario, seed, out / "flights", workers)
        more = evaluation_sections(results, logs, scenario.arrival)
    write_worst(out, results, logs)
    sections = [
        Section(f"{count} of seed {seed}", head),
        *more,
        Section(
            "Where this comes from",
            [
                Text(provenance["command"], code=True),
                Text(", ".join(f"{name} {text}" for name, text in origin.items()) + "."),
            ],
        ),
    ]
    write_report(out, f"{body}: {', '.join(results)}", sections)


def _tasks(results: Results) -> list[Block]:
    """A line for each survey or mission; the folder `flights` has a folder of each."""
    lines = [
        [
            task_name(name, row["seed"], row["transit"]),
            Mark(row.get("ended_early") or outcome(row), row["success"]),
            number_text(row.get("survey_map_rms_of_size"), ".3%"),
            number_text(row.get("touch_miss_m"), ".2f"),
        ]
        for name, result in results.items()
        for row in result.rows
    ]
    return _table(["folder", "what happened", "map, rms over its size", "miss (m)"], lines)


def evaluation_sections(results: Results, logs: Logs, arrival: ArrivalConfig) -> list[Section]:
    """Makes the report below its head.

    Args:
      logs: they include those of the flights that `shown_transits` names.
    """
    looks = controller_looks(list(results))
    sections = [
        Section("Worlds that can't be flown", _unflyable(results)),
        Section("How flights end", _end_errors(results, arrival, looks)),
        Section("Fuel against the expert's", _delta_v(results, looks)),
        Section("Paths", _paths(path_transits(results), logs, looks)),
        *_drivers_and_worst(results, logs),
        Section("Flights without success", _failures(results)),
    ]
    return [section for section in sections if section.blocks]


def _drivers_and_worst(results: Results, logs: Logs) -> list[Section]:
    sections = [
        Section("What drives failure", driver_blocks(results)),
        *(
            Section(f"Worst flights of {name}", _worst(f"worst-{k}", name, result, logs))
            for k, (name, result) in enumerate(results.items())
        ),
    ]
    return [section for section in sections if section.blocks]


def success_text(scenario: Scenario) -> str:
    """Says what a success is, as the start of a sentence."""
    if isinstance(scenario.task, SurveyConfig):
        return "Success is a map, without a collision or an entry of the keep-out ellipsoid"
    arrival, task = scenario.arrival, scenario.task
    touches = isinstance(task, TouchAndGoConfig) or (
        isinstance(task, MissionConfig) and "touch_and_go" in task.phases
    )
    goal = "home" if touches else "the goal"
    clean = "a touch by the head alone" if touches else "no keep-out violation"
    return (
        f"Success is arrival within {arrival_text(arrival)} of {goal} by {arrival.deadline_s:g} s, "
        f"to stay there for {arrival.dwell_s:g} s, with no collision and {clean}"
    )


def figure_blocks(results: Results, arrival: ArrivalConfig | None) -> list[Block]:
    """Makes the table of the first ten figures, a column for each controller; folded, all others.

    Only what a table shows is explained below it.
    """
    rows = figure_rows(results, arrival)
    first = [row for row in rows if row.group]
    lines: list[Sequence[Cell]] = []
    for group, each in itertools.groupby(first, lambda row: row.group):
        lines += [[group], *map(_marked, each)]
    others = [row for row in rows if not row.group]
    return [
        Table(["", *results], lines),
        *_notes(first),
        Folded(
            f"{len(others)} more figures",
            [Table(["", *results], [_marked(row) for row in others]), *_notes(others)],
        ),
    ]


def _marked(row: FigureRow) -> list[Cell]:
    cells = [
        text if good is None else Mark(text, good)
        for text, good in zip(row.cells, row.good, strict=True)
    ]
    return [row.label, *cells]


def _notes(rows: Sequence[FigureRow]) -> list[Text]:
    notes = dict.fromkeys(note for row in rows for note in row.notes)
    return [Text(" ".join(notes))] if notes else []


def driver_blocks(results: Results) -> list[Block]:
    """Says what drives failure; nothing where nothing was dispersed."""
    return [
        block
        for k, (name, result) in enumerate(results.items())
        for block in _drivers(k, name, result)
    ]


def _table(head: Sequence[str], lines: Sequence[Sequence[Cell]]) -> list[Block]:
    """A table of the first lines; it says how many are left out."""
    left = len(lines) - _MOST_LINES
    more = [Text(f"{left} more are in results.json.")] if left > 0 else []
    return [Table(head, lines[:_MOST_LINES]), *more] if lines else []


def _unflyable(results: Results) -> list[Block]:
    worlds: dict[tuple[int, str], list[str]] = {}
    for name, result in results.items():
        for row in result.unflyable_worlds:
            worlds.setdefault((row["transit"], row["unflyable"]), []).append(name)
    lines = [
        [str(transit), "all" if len(names) == len(results) else ", ".join(names), reason]
        for (transit, reason), names in sorted(worlds.items())
    ]
    said = [Text("They are counted apart, and are in no other figure.")] if lines else []
    return [*said, *_table(["transit", "controllers", "why"], lines)]


def _end_errors(results: Results, arrival: ArrivalConfig, looks: Looks) -> list[Block]:
    errors = {
        name: np.array([row["terminal_position_error_m"] for row in result.flights])
        for name, result in results.items()
        if result.flights
    }
    if not errors:
        return []
    caption = "Share of flights that end within a distance of the goal; dashed: arrival's radius."
    figure = plot_end_errors(errors, arrival.radius_m, looks)
    return [picture("end-errors", figure, caption)]


def _delta_v(results: Results, looks: Looks) -> list[Block]:
    if EXPERT not in results:
        return []
    best = results[EXPERT].rows
    found = {
        name: delta_v_pairs(result.rows, best) for name, result in results.items() if name != EXPERT
    }
    pairs = {name: each for name, each in found.items() if len(each)}
    caption = "Each dot is a transit in which both succeeded; their number is in brackets."
    return [picture("delta-v", plot_delta_v(pairs, looks), caption)] if pairs else []


def _paths(transits: Sequence[int], logs: Logs, looks: Looks) -> list[Block]:
    if not transits:
        return []
    shown = {name: [flown[transit] for transit in transits] for name, flown in logs.items()}
    caption = "The first transits in the frame that turns with the body; a cross is a collision."
    return [picture("paths", plot_paths(shown, looks), caption)]


def _drivers(number: int, name: str, result: Result) -> list[Block]:
    if result.sensitivity is None:
        return []
    rankings = {output: ranked for output, ranked in result.sensitivity.items() if ranked}
    if not rankings:
        few = result.transits < LEAST_FLIGHTS
        why = f"fewer than {LEAST_FLIGHTS} flights" if few else "all flights ended alike"
        return [Text(f"{name}: nothing can be told, {why}.")]
    sentences = [f"{name}."]
    for output, label in ((each, OUTPUT_NAMES[each]) for each in result.sensitivity):
        told = "too few flights, or all alike"
        if output in rankings:
            names = told_from_chance(rankings[output])
            told = ", ".join(names) or "nothing that is told from chance"
        sentences.append(f"{label}: {told}.")
    blocks: list[Block] = [
        Text(" ".join(sentences)),
        picture(f"drivers-{number}", plot_drivers(rankings), f"{name}. {_DRIVERS_CAPTION}"),
    ]
    if quantities := strongest(rankings):
        caption = f"{name}. Each mark is a flight; crosses are flights without success."
        figure = plot_scatter(result.flights, quantities)
        blocks.append(picture(f"scatter-{number}", figure, caption))
    return blocks


def _worst(figure: str, name: str, result: Result, logs: Logs) -> list[Block]:
    """A controller's worst flights: replays, what was drawn, and plots if it flew a policy."""
    replayed = replayed_flights(result)
    lines = [
        [
            Link(f"transit {row['transit']}", replay_page(name, row)),
            Mark(outcome(row), row["success"]),
            length_text(row["terminal_position_error_m"]),
            length_text(row["min_clearance_m"]),
            f"{three_digits(row['delta_v_m_s'])} m/s",
        ]
        for row in replayed
    ]
    head = ["replay", "what happened", "end error", "least clearance", "Δv"]
    blocks = [*_table(head, lines), *_drawn(replayed)]
    if flew_a_policy(result):
        worst = worst_flights(result.flights)
        flights = [logs[name][row["transit"]] for row in worst]
        titles = [
            f"transit {row['transit']}: {outcome(row)}, "
            f"{length_text(row['terminal_position_error_m'])} off at the end"
            for row in worst
        ]
        caption = "Green: the limits and the time of arrival; blue: the keep-out ellipsoid."
        if all("estimate" in log.dataset for log in flights):
            caption = f"Distance to the goal, true (solid) and estimated (dashed). {caption}"
        blocks.append(picture(figure, plot_flights(flights, titles), caption))
    return blocks


def _drawn(rows: Sequence[Row]) -> list[Block]:
    """What was drawn of the worlds of some flights."""
    names = dict.fromkeys(name for row in rows for name in row.get("dispersed", {}))
    lines = [[name, *(_value(row["dispersed"].get(name)) for row in rows)] for name in names]
    head = ["", *(f"transit {row['transit']}" for row in rows)]
    return [Folded("What was drawn of their worlds", [Table(head, lines)])] if lines else []


def _value(value: typing.Any) -> str:
    if isinstance(value, Sequence) and not isinstance(value, str):
        return f"({', '.join(_value(part) for part in value)})"
    if isinstance(value, float):
        return f"{value:.4g}"
    return DASH if value is None else str(value)


def _failures(results: Results) -> list[Block]:
    lines = [
        [
            row["controller"],
            str(row["transit"]),
            Mark(outcome(row), good=False),
            length_text(row["terminal_position_error_m"]),
            f"{three_digits(row['terminal_speed_m_s'])} m/s",
            length_text(row["min_clearance_m"]),
        ]
        for result in results.values()
        for row in result.flights
        if not row["success"]
    ]
    head = ["controller", "transit", "what happened", "end error", "end speed", "least clearance"]
    return _table(head, lines)
