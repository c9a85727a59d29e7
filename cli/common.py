"""Functions and options that several commands use: consoles, output folders, tables."""

from __future__ import annotations

import contextlib
import logging
import os
import shlex
import sys
import time
import typing
from collections.abc import Iterator, Sequence
from pathlib import Path

import rich.progress
import typer
from rich.console import Console
from rich.progress import BarColumn, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.table import Table
from rich.text import Text

from proxops.assets import ASSETS
from proxops.diagrams.scenario import (
    Body,
    Scenario,
    dotted,
    given_keys,
    scenario_remarks,
    shipped_scenarios,
)
from proxops.systems.common import InputError, Progress

SHIPPED = {
    "body": sorted(path.stem for path in ASSETS.glob("*/*.yaml") if path.stem == path.parent.name),
    "dispersions": sorted(path.stem for path in (ASSETS / "dispersions").glob("*.yaml")),
}
"""Names that values of a scenario may have, by their keys."""
_CONTROLLERS = ("mpc", "policy", "hybrid", "pd", "zero", "policy:end-to-end", "hybrid:end-to-end")


def complete_controllers(incomplete: str) -> list[str]:
    """Completes a controller, or the last of several with commas between them."""
    before, comma, last = incomplete.rpartition(",")
    return [f"{before}{comma}{name}" for name in _CONTROLLERS if name.startswith(last)]


def complete_dispersions(incomplete: str) -> list[str]:
    """Completes the name of dispersions that ship."""
    return [name for name in SHIPPED["dispersions"] if name.startswith(incomplete)]


def complete_change(incomplete: str) -> list[str]:
    """Completes a key of a scenario, and a value, where there are few."""
    key, equals, _ = incomplete.partition("=")
    found = [
        f"{name}={value}"
        for name, described in dotted()
        if name == key or not equals
        for value in (SHIPPED.get(name, described.choices) if equals else [""])
        if equals or not described.sections or described.choices
    ]
    return [text for text in dict.fromkeys(found) if text.startswith(incomplete)]


def _scenario_file(path: Path | None) -> Path | None:
    """Says what may have been meant where a name is none of a scenario that ships."""
    known = path is None or path.exists() or str(path) in shipped_scenarios()
    name = "" if known else str(path)
    meant = [f"--set {key}={name}" for key, names in SHIPPED.items() if name in names]
    if name.partition(":")[0].partition(",")[0] in _CONTROLLERS:
        meant.append(f"--controller {name} (of evaluate: --controllers, no space after a comma)")
    if meant:
        raise InputError(f"there is no scenario {name}: did you mean {' or '.join(meant)}?")
    return path


ScenarioFile = typing.Annotated[
    Path | None,
    typer.Argument(
        help="Scenario file (YAML), or a scenario that ships: "
        f"{', '.join(shipped_scenarios())}. Default: Kleopatra.",
        callback=_scenario_file,
    ),
]
"""The argument of all commands that fly a scenario."""
Processes = typing.Annotated[
    int | None, typer.Option(min=1, help="Processes. Default: one for each core.")
]
SchedulerAddress = typing.Annotated[
    str | None, typer.Option(help="Address of a Dask scheduler; its workers then do the work.")
]
"""Options of all commands that fly many flights."""
ScenarioChanges = typing.Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        help="Change a scenario value: key.subkey=value. Repeatable.",
        autocompletion=complete_change,
    ),
]
DispersionsName = typing.Annotated[
    str | None,
    typer.Option(
        "--dispersions",
        help=f"Draw each flight's world from {', '.join(SHIPPED['dispersions'])}, or from a YAML "
        "file of your own.",
        autocompletion=complete_dispersions,
    ),
]
AsJson = typing.Annotated[
    bool, typer.Option("--json", help="Print the results as JSON, not as a table.")
]
"""Options of most commands."""


_SECONDS_PER_LINE = 600.0

EVALUATION_SEEDS = 10_000
"""Seeds from here on are for evaluation: nothing is to be trained on their transits."""


def typed_command() -> str:
    """The command as it was typed, for a report."""
    return shlex.join(["proxops", *sys.argv[1:]])


def with_dispersions(changes: list[str] | None, name: str | None) -> list[str]:
    """Gives the changes of a scenario with those that --dispersions asks for."""
    return [*(changes or []), *([] if name is None else [f"dispersions={name}"])]


def check_transits_drawn(scenario: Scenario, changes: list[str] | None) -> None:
    """Checks that a scenario does not ask for a transit of its own, where a set of them is flown.

    Raises:
      InputError: it gives a start and a goal, or a change names seed or number of the transit.
    """
    if scenario.transit.start_m is not None:
        raise InputError(
            "the scenario gives a start and a goal, but this command draws its transits: leave out "
            "transit.start_m and transit.goal_m, or use proxops fly"
        )
    for key in given_keys(changes or []):
        if key in ("transit.seed", "transit.index"):
            raise InputError(f"--set {key}: this command flies transits 0, 1, … of its --seed")


def coloured(good: bool | None) -> str:
    """The style of rich for success, failure, or neither."""
    return "" if good is None else "green" if good else "bold red"


console = Console(markup=False)
"""The console for results: standard output."""
status = Console(stderr=True, soft_wrap=True, markup=False)
"""The console for progress and remarks: standard error."""


class LogLines(logging.Handler):
    """Prints each record of a log as a line for people, on standard error."""

    def emit(self, record: logging.LogRecord) -> None:
        """Prints a record."""
        status.print(f"proxops: {record.getMessage()}")


@contextlib.contextmanager
def training_extra(instead: str = "") -> Iterator[None]:
    """Reports a missing extra `train`; use it around imports that need the extra.

    Args:
      instead: text at the end of the message, with another way to go on.

    Raises:
      InputError: the extra is not installed.
    """
    try:
        yield
    except ModuleNotFoundError as error:
        raise InputError(
            f"training needs {error.name}: run make train, or pip install 'proxops[train]'{instead}"
        ) from error


@contextlib.contextmanager
def work_bar(text: str = "") -> Iterator[Progress]:
    """Shows a bar for a long piece of work; gives the `Progress` that moves it.

    Without a terminal it prints a line every ten minutes in its place.
    """
    quiet, told = not status.is_terminal, time.monotonic()
    columns = (BarColumn(), TimeElapsedColumn(), TimeRemainingColumn())
    with rich.progress.Progress(
        *columns, TextColumn("{task.description}"), console=status, transient=True, disable=quiet
    ) as bar:
        task = bar.add_task(text, total=1.0)

        def progress(done: float, text: str) -> None:
            nonlocal told
            bar.update(task, completed=done, description=text)
            if quiet and time.monotonic() - told >= _SECONDS_PER_LINE:
                told = time.monotonic()
                status.print(f"{100 * done:.0f} % {text}")

        yield progress


def check_folder(folder: Path, option: str = "--out") -> None:
    """Raises `InputError` if `folder` cannot be created or written, before any work is done.

    Args:
      option: names the folder, or a file in it.
    """
    nearest = folder.absolute()
    # Unlike this, Path.exists raises if a parent is not accessible or a name is too long.
    while not os.path.exists(nearest):  # noqa: PTH110
        nearest = nearest.parent
    if not nearest.is_dir():
        raise InputError(f"{option} {folder}: {nearest} is a file, not a folder")
    if not os.access(nearest, os.W_OK | os.X_OK):
        raise InputError(f"{option} {folder}: no permission to write in {nearest}")


def print_remarks(scenario: Scenario, body: Body) -> None:
    """Tells of settings that spoil flights and may be a mistake."""
    for remark in scenario_remarks(scenario, body):
        status.print(f"Note: {remark}.")


def print_rows(
    title: str, *parts: Sequence[tuple[str, str] | tuple[str, str, bool | None]]
) -> None:
    """Prints parts of rows (name, value) as a table with a title, with a line between parts.

    A third entry of a row says whether its value is good.
    """
    table = Table(title=title, show_header=False, title_justify="left")
    table.add_column(style="bold")
    table.add_column(justify="right")
    for rows in parts:
        for name, value, *good in rows:
            table.add_row(name, Text(value, coloured(good[0] if good else None)))
        table.add_section()
    console.print(table)
