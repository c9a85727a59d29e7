"""Tables that the benchmarks print, and write as Markdown."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from rich.console import Console
from rich.table import Table

from proxops.systems.common import write_whole
from proxops.training import reports


class Shown(NamedTuple):
    """A table."""

    title: str
    headings: Sequence[str]
    """Of all columns but the first."""
    lines: Mapping[str, Sequence[str]]
    """Cells by the label at the start of each line."""

    def show(self) -> None:
        """Prints it."""
        table = Table("", title=self.title, title_justify="left")
        table.columns[0].no_wrap = True
        for heading in self.headings:
            table.add_column(heading, justify="right")
        for name, line in self.lines.items():
            table.add_row(name, *line)
        Console(width=160).print(table)


def write_markdown(tables: Sequence[Shown], path: Path | None) -> None:
    """Writes tables as Markdown, if a file is named."""
    if path is None:
        return
    parts = []
    for each in tables:
        rows = [[name, *line] for name, line in each.lines.items()]
        table = reports.markdown_table(reports.Table(["", *each.headings], rows))
        parts += [f"## {each.title}", "", *table, ""]
    write_whole(path, lambda file: file.write_text("\n".join(parts)))
