"""The parts of a report about dispersed worlds: what drives failure, and the worst flights."""

from __future__ import annotations

import typing
from collections.abc import Sequence
from pathlib import Path

from proxops.diagrams.flight import Row, controller_label
from proxops.diagrams.logs import length_text, three_digits
from proxops.diagrams.meshcat import write_replay
from proxops.studies.evaluation.driver_figures import (
    OUTPUT_NAMES,
    plot_drivers,
    plot_scatter,
    strongest,
)
from proxops.studies.evaluation.flights import replayed_flights
from proxops.studies.evaluation.sensitivity import LEAST_FLIGHTS, told_from_chance
from proxops.studies.evaluation.table import Result, Results, outcome
from proxops.studies.evaluation.variants import Logs
from proxops.systems.common import make_folder
from proxops.training.reports import DASH, Block, Link, Section, Table, Text, picture

_FOLDER = "worst"
_MOST_WORLDS_TOLD = 30
_DRIVERS_CAPTION = (
    "Blue: above chance. Hatched: the greatest index of all quantities where the outcomes are "
    "shuffled among the flights, as the median of 19 shuffles; dashed: the greatest of the 19, "
    "which chance exceeds in one ranking of 20. Lines are 90 % intervals: what the index would be "
    "with other flights."
)
_SCATTER_CAPTION = "Each mark is a flight; crosses are flights without success."


def write_worst(folder: Path, results: Results, logs: Logs) -> None:
    """Writes a replay page of each of the worst flights of each controller, `worst/NAME.html`.

    The report links to them. Each page is written completely or not at all.

    Args:
      folder: of the report.
      results: by the controller's name.
      logs: they include those of `replayed_flights`.

    Raises:
      InputError: the folder cannot be made or written.
    """
    for name, result in results.items():
        worst = replayed_flights(result)
        shown = {folder / _page(name, row) for row in worst}
        # Those of an earlier run are no longer linked.
        for old in (folder / _FOLDER).glob(f"{controller_label(name)}-{'[0-9]' * 5}.html"):
            if old not in shown:
                old.unlink()
        for row in worst:
            make_folder(folder / _FOLDER)
            write_replay(logs[name][row["transit"]], folder / _page(name, row))


def driver_sections(results: Results) -> list[Section]:
    """Makes the section that says what drives failure; none where nothing was dispersed."""
    blocks: list[Block] = []
    for k, (name, result) in enumerate(results.items()):
        if "sensitivity" in result:
            blocks += _drivers(k, name, result)
    return [Section("What drives failure", blocks)] if blocks else []


def unflyable_sections(results: Results) -> list[Section]:
    """Makes the section that lists the worlds that could not be flown; none without such worlds."""
    worlds: dict[tuple[int, str], list[str]] = {}
    for name, result in results.items():
        for row in result["unflyable_worlds"]:
            worlds.setdefault((row["transit"], row["unflyable"]), []).append(name)
    if not worlds:
        return []
    lines = [
        [str(transit), "all" if len(names) == len(results) else ", ".join(names), reason]
        for (transit, reason), names in sorted(worlds.items())
    ]
    blocks: list[Block] = [
        Text("They are counted apart, and are in no other figure."),
        Table(["transit", "controllers", "why"], lines[:_MOST_WORLDS_TOLD]),
    ]
    if len(lines) > _MOST_WORLDS_TOLD:
        blocks.append(Text(f"{len(lines) - _MOST_WORLDS_TOLD} more are in results.json."))
    return [Section("Worlds that can't be flown", blocks)]


def worst_tables(name: str, result: Result) -> list[Block]:
    """Makes the table of a controller's worst flights, linked to their replays, and of their draws.

    It is empty if no flight of the controller is replayed.
    """
    worst = replayed_flights(result)
    if not worst:
        return []
    lines = [
        [
            Link(f"transit {row['transit']}", _page(name, row)),
            outcome(row),
            length_text(row["terminal_position_error_m"]),
            length_text(row["min_clearance_m"]),
            f"{three_digits(row['delta_v_m_s'])} m/s",
        ]
        for row in worst
    ]
    head = ["replay", "what happened", "end error", "least clearance", "Δv"]
    return [Table(head, lines), *_drawn(worst)]


def _page(name: str, row: Row) -> str:
    return f"{_FOLDER}/{controller_label(name)}-{row['transit']:05d}.html"


def _drawn(rows: Sequence[Row]) -> list[Block]:
    names = dict.fromkeys(name for row in rows for name in row.get("dispersed", {}))
    if not names:
        return []
    lines = [[name, *(_value(row["dispersed"].get(name)) for row in rows)] for name in names]
    return [Table(["what was drawn", *(f"transit {row['transit']}" for row in rows)], lines)]


def _value(value: typing.Any) -> str:
    if isinstance(value, Sequence) and not isinstance(value, str):
        return f"({', '.join(_value(part) for part in value)})"
    if isinstance(value, float):
        return f"{value:.4g}"
    return DASH if value is None else str(value)


def _drivers(number: int, name: str, result: Result) -> list[Block]:
    rankings = {output: ranked for output, ranked in result["sensitivity"].items() if ranked}
    if not rankings:
        few = result["transits"] < LEAST_FLIGHTS
        why = f"fewer than {LEAST_FLIGHTS} flights" if few else "all flights ended alike"
        return [Text(f"{name}: nothing can be told, {why}.")]
    sentences = [f"{name}."]
    for output, label in OUTPUT_NAMES.items():
        if output not in rankings:
            sentences.append(f"{label}: too few flights, or all alike.")
            continue
        told = ", ".join(told_from_chance(rankings[output])) or "nothing that is told from chance"
        sentences.append(f"{label}: {told}.")
    blocks: list[Block] = [
        Text(" ".join(sentences)),
        picture(f"drivers-{number}", plot_drivers(rankings), f"{name}. {_DRIVERS_CAPTION}"),
    ]
    if quantities := strongest(rankings):
        figure = plot_scatter(result["flights"], quantities)
        blocks.append(picture(f"scatter-{number}", figure, f"{name}. {_SCATTER_CAPTION}"))
    return blocks
