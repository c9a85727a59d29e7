"""What the benchmarks that fly campaigns share: a bar while they fly, and their table."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from proxops.diagrams.flight import Workers
from proxops.systems.common import InputError, write_whole

Lines = Mapping[str, Sequence[str]]
"""Cells of a table, by what stands at the start of each line."""


@contextmanager
def flying(processes: int | None) -> Iterator[Workers]:
    """Shows a bar; gives the workers that move it. Wrong input ends the program."""
    columns = BarColumn(), TimeRemainingColumn(), TextColumn("{task.description}")
    with Progress(*columns, console=Console(stderr=True)) as bar:
        task = bar.add_task("flying", total=1.0)
        try:
            yield Workers(
                processes,
                progress=lambda done, text: bar.update(task, completed=done, description=text),
            )
        except InputError as error:
            raise SystemExit(str(error)) from error


def show(title: str, headings: Sequence[str], lines: Lines, markdown: Path | None) -> None:
    """Prints the table, and writes it as Markdown too where it is wanted."""
    table = Table(title=title)
    table.add_column("", no_wrap=True)
    for heading in headings:
        table.add_column(heading, justify="right")
    for name, line in lines.items():
        table.add_row(name, *line)
    Console(width=160).print(table)
    if markdown is not None:
        rows = [["variant", *headings], ["---", *(len(headings) * ["---:"])]]
        rows += [[name, *line] for name, line in lines.items()]
        text = "".join("| " + " | ".join(row) + " |\n" for row in rows)
        write_whole(markdown, lambda path: path.write_text(text))
